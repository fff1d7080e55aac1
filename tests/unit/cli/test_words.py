"""The alias `compare`, and mistakes of the parser."""

import sys
from pathlib import Path
from types import ModuleType

import pytest

from socialiq.__main__ import main as begin
from socialiq.cli.main import main
from socialiq.cli.words import forwarded


def test_compare_is_forwarded_with_a_line(capsys):
    new = ["reproduce", "compare-priors", "--from", "results"]
    assert forwarded(["compare", "priors", "--from", "results"]) == new
    assert capsys.readouterr().err == (
        "socialiq: these words are now: socialiq reproduce compare-priors ...\n"
    )
    for words in (["compare"], ["compare", "--help"], ["train", "cql", "d"]):
        assert forwarded(words) == words
    assert capsys.readouterr().err == ""


MISTAKES = {
    "train iq-learn d.st": "socialiq train iq-learn needs --out PATH: add it",
    "train iq-learn d.st --updates abc": "--updates abc: give a whole number; and socialiq train",
    "train iq-learn --updates=abc d.st --out x": "--updates abc: give a whole number",
    "train iq-learn": "needs PATH and --out PATH: add them",
    "train iq-learn d.st --out x --angle a b": "--angle a b: give a number, or several",
    "train iq-learn d.st --out x extra": "takes no further 'extra': leave it out",
    "evaluate a --episodes": "--episodes has no value: give one",
    "evaluate a --episodes x": "--episodes x: give a whole number",
    "audit p": "socialiq audit needs --profile PATH and --out PATH: add them",
    "audit p --isolation some": "--isolation some: choose one of auto, required, none",
    "profile new --angle x": "--angle x: give a number; and socialiq profile new needs --world STR",
    "solve crossing7 --angle ٣": "'٣' has digits of another script: write 0 to 9",
    "solve crossing7 --angle=४५": "'--angle=४५' has digits of another script: write 0 to 9",
    "evaluate a --seed １": "has digits of another script",
}


@pytest.mark.parametrize("words", MISTAKES)
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_mistakes_of_the_parser_are_one_plain_line(words, encoding, capsys, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    assert main(words.split()) == 2
    line = capsys.readouterr().err
    assert MISTAKES[words] in line and line.count("\n") == 1
    assert not {"│", "╭", "─"} & set(line) and "; Missing" not in line and "class 'int'" not in line


def test_without_a_world_the_offline_defaults_apply(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["collect", "crossing7", "--episodes", "3", "--out", "d.safetensors"]) == 0
    small = ["--updates", "2", "--hidden", "4", "--out", "run"]
    assert main(["train", "iq-learn", "d.safetensors", "--angle", "45", *small]) == 0
    assert '"value_term": "value_expert"' in (tmp_path / "run/run.json").read_text()
    capsys.readouterr()
    words = ["train", "iq-learn", "d.safetensors", "--value-term", "value", "--out", "other"]
    assert main(words) == 2
    line = capsys.readouterr().err
    assert "name a world (--world), or set value_term (--value-term)" in line


@pytest.mark.parametrize(
    ("words", "mend"),
    [
        (["collect", "crossing5", "--seed=1_0", "--out", "OUT"], "has _ among its digits"),
        (["collect", "crossing5", "--episodes", "1_0", "--out", "OUT"], "has _ among its digits"),
        (["collect", "crossing5", "--seed", "1", "--out", "OUT", "--seed=2"], "--seed is given tw"),
        (["collect", "crossing5", "--out", "-"], "- is no name of an output"),
    ],
)
def test_words_that_were_taken_otherwise_than_meant_are_refused(words, mend, tmp_path, capsys):
    out = tmp_path / "out.safetensors"
    assert main([word.replace("OUT", str(out)) for word in words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert mend in line
    assert not out.exists() and not Path("-").exists()


def test_options_of_several_values_may_stand_in_several_places(tmp_path):
    out = str(tmp_path / "out.safetensors")
    words = ["collect", "crossing7", "--episodes", "2", "--out", out]
    assert main([*words, "--set", "conflict=end_cell", "--set", "braking=one_level"]) == 0


def test_ctrl_c_while_the_program_is_imported_is_one_line(monkeypatch, capsys):
    class Stopped(ModuleType):
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "socialiq.cli.main", Stopped("socialiq.cli.main"))
    assert begin() == 130
    assert capsys.readouterr().err == "socialiq: stopped; nothing was saved\n"
