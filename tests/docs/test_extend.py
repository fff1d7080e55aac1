"""The commands of docs/extend.md, with the functions and the learner that the page writes."""

import json
import re
import shlex
from pathlib import Path

import pytest

from socialiq.cli.main import main
from socialiq.nn.q_policy import QPolicy

PAGE = (Path(__file__).parents[2] / "docs" / "extend.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
COMMANDS = re.findall(r"^\$ socialiq (train .*)$", PAGE, re.MULTILINE)


@pytest.fixture(name="folder", scope="module")
def files_of_a_user(tmp_path_factory):
    folder = tmp_path_factory.mktemp("user")
    written = [block for block in BLOCKS if re.search(r"^(def|class|@)", block, re.MULTILINE)]
    text = "\n".join(block.split("\nassert")[0].split("\ntrained =")[0] for block in written)
    imports = "import dataclasses\nimport jax\nimport jax.numpy as jnp\n"
    (folder / "mine.py").write_text(imports + text.split("\nshape =")[0])
    data = folder / "mixed.safetensors"
    assert main(["collect", "crossing7", "--episodes", "2", "--out", str(data)]) == 0
    return folder


def test_the_page_names_a_command_for_each_kind():
    given = {word for command in COMMANDS for word in command.split() if word.startswith("--")}
    assert {"--prior", "--divergence", "--loss", "--allow-code"} <= given


def slow_unless_first_or_last(number):
    """One command with a function and the one with a learner are quick tests."""
    ends = number in (0, len(COMMANDS) - 1)
    return number if ends else pytest.param(number, marks=pytest.mark.slow)


@pytest.mark.parametrize("number", [*map(slow_unless_first_or_last, range(len(COMMANDS)))])
def test_commands_train_and_tell_whose_code_it_was(folder, number, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    words = shlex.split(COMMANDS[number])
    out = folder / f"run_{number}"
    words[words.index("--out") + 1] = str(out)
    assert main([*words, "--updates", "5", "--hidden", "8", "--set", "batch_size=4"]) == 0
    (part,) = re.findall(r"(prior|divergence|loss|own) mine.py:\w+", COMMANDS[number])
    part = "learner" if part == "own" else part
    (name,) = re.findall(r"mine.py:(\w+)", COMMANDS[number])
    record = json.loads((out / "run.json").read_text())
    assert record[f"own_{part}"]["name"] == name
    policy = QPolicy.load(min(out.glob("policy_*.safetensors")))
    assert policy.provenance[f"own_{part}"] == record[f"own_{part}"]
    capsys.readouterr()
    words.remove("--allow-code")
    words[words.index("--out") + 1] = str(folder / "never")
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "--allow-code" in error and error.count("\n") == 1
    assert not (folder / "never").exists()


def test_settings_that_a_learner_does_not_have_are_refused(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    words = ["train", "own", "mine.py:Weighted", "mixed.safetensors", "--allow-code"]
    for setting in ("target_kind=to_go", "temperature=0.5"):
        assert main([*words, "--set", setting, "--out", "never"]) == 2
        name = setting.partition("=")[0]
        assert f"there is no setting {name}: choose one of" in capsys.readouterr().err
