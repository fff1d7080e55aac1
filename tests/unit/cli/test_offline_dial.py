"""`train offline-dial`: a dial from demonstrations alone."""

import dataclasses
import json

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.callbacks import Stopped
from socialiq.learners.dial import offline
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import RewardPair

SMALL = ["--updates", "10", "--hidden", "8"]


@pytest.fixture(name="crossing", scope="module")
def crossing_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "mixed.safetensors"
    assert main(["collect", "crossing5", "--episodes", "3", "--out", str(path)]) == 0
    return path


def test_a_dial_of_a_gridworld(crossing, tmp_path, capsys):
    out = tmp_path / "run"
    arguments = ["train", "offline-dial", str(crossing), "--world", "crossing5", *SMALL]
    capsys.readouterr()
    assert main([*arguments, "--seed", "3", "4", "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [one["seed"] for one in printed["dials"]] == [3, 4]
    record = json.loads((out / "run.json").read_text())
    assert record["preset"] == "offline-regularised"
    assert record["structure"]["one_hot"] and record["structure"]["hidden"] == [8]
    assert (out / "metrics.csv").read_text().startswith("seed,stage,updates,loss")
    assert DialPolicy.load(out / "dial_1.safetensors").high == 90.0


@pytest.mark.slow
def test_a_dial_of_the_intersection(tmp_path):
    """From random rows of its sizes: 10 vehicles of 7 numbers, 3 actions."""
    rng = np.random.default_rng(0)
    data = Demonstrations.of(
        observation=rng.normal(size=(20, 70)),
        action=rng.integers(0, 3, 20),
        next_observation=rng.normal(size=(20, 70)),
        ending=np.tile([0, 0, 0, 0, 3], 4),
        rewards=RewardPair(rng.normal(size=20), rng.normal(size=20)),
        episode=np.repeat(np.arange(4), 5),
        n_actions=3,
    )
    files.save(tmp_path / "data.safetensors", data)
    out = tmp_path / "run"
    arguments = ["train", "offline-dial", str(tmp_path / "data.safetensors"), *SMALL]
    assert main([*arguments, "--world", "intersection", "--out", str(out)]) == 0
    dial = DialPolicy.load(out / "dial_0.safetensors")
    assert dial.turned.view is not None
    policy = dial.at(30.0)
    assert policy.predict(np.zeros(70))[0] in (0, 1, 2)


@pytest.mark.parametrize("made_before", [False, True])
def test_a_training_that_is_stopped_leaves_nothing(crossing, tmp_path, monkeypatch, made_before):
    def interrupted(*_given):
        raise Stopped("stopped after 10 of 20 updates; nothing was saved")

    monkeypatch.setattr(offline, "train", interrupted)
    out = tmp_path / "run"
    if made_before:
        out.mkdir()
    arguments = ["train", "offline-dial", str(crossing), "--world", "crossing5", *SMALL]
    assert main([*arguments, "--out", str(out)]) == 130
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--budget", "0.1"], "unknown option --budget"),
        (["--angle", "45"], "unknown option --angle"),
        (["--resume"], "unknown option --resume"),
        (["--set", "environments=3"], "there is no setting environments: choose one of"),
        (["--set", "one_hot=3"], "one_hot is no setting"),
        (["--preset", "online"], "unknown option --preset"),
    ],
)
def test_what_makes_no_sense_is_refused(more, line, crossing, tmp_path, capsys):
    out = ["--world", "crossing5", "--out", str(tmp_path / "run")]
    assert main(["train", "offline-dial", str(crossing), *SMALL, *more, *out]) == 2
    assert line in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_demonstrations_of_another_world_are_refused(crossing, tmp_path, capsys):
    arguments = ["train", "offline-dial", str(crossing), "--world", "intersection"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 2
    assert "they belong to another world" in capsys.readouterr().err


def test_data_without_social_rewards_make_no_dial(crossing, tmp_path, capsys):
    data = files.load(crossing)
    zero = np.zeros_like(data.rewards.social)
    alone = dataclasses.replace(data, rewards=RewardPair(data.rewards.env, zero))
    files.save(tmp_path / "alone.safetensors", alone)
    words = ["train", "offline-dial", str(tmp_path / "alone.safetensors"), "--world", "crossing5"]
    words += [*SMALL, "--out", str(tmp_path / "run")]
    assert main(words) == 2
    assert "9 of 9 episodes are not those of crossing5" in capsys.readouterr().err
    assert main([*words, "--believe-labels"]) == 2
    assert "no social rewards" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
