"""Words of older releases for `train`."""

import pytest

from socialiq.cli.words import forwarded


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("train d.safetensors --out x", "train iq-learn d.safetensors --out x"),
        ("train d.safetensors --learner cql --out x", "train cql d.safetensors --out x"),
        ("train --learner=sac --out x", "train sac --out x"),
        ("train d.npz --learner mine.py:My --out x", "train own mine.py:My d.npz --out x"),
        ("compare priors --from results", "reproduce compare-priors --from results"),
        ("improve-dial d.safetensors --out x", "train improve-dial d.safetensors --out x"),
        ("train-dial crossing7 --out x --data d", "train dial d --world crossing7 --out x"),
        ("train-dial merge --preset=online", "train dial --world merge --preset=online"),
        (
            "train-dial w.safetensors --data d --preset offline-regularised --out x",
            "train offline-dial d --world w.safetensors --out x",
        ),
        (
            "train-dial w.safetensors --data d --practice 5 --practice-episodes 9",
            "train practised-dial d --world w.safetensors --rounds 5 --episodes 9",
        ),
    ],
)
def test_old_words_are_forwarded_with_one_line(old, new, capsys):
    assert forwarded(old.split()) == new.split()
    line = capsys.readouterr().err
    assert line == f"socialiq: these words are now: socialiq {' '.join(new.split()[:4])} ...\n"


@pytest.mark.parametrize(
    "words", ["train cql d", "train --help", "train", "train clq d", "solve x"]
)
def test_other_words_stay(words, capsys):
    assert forwarded(words.split()) == words.split()
    assert capsys.readouterr().err == ""
