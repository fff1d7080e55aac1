"""`evaluate` reads every kind of policy that `audit` reads, in every kind of world."""

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.nn.q_policy import QPolicy

EXAMPLES = Path(__file__).parents[3] / "examples" / "policies"
EGO = "def go(observations):\n    return [1 for _ in observations]\n"


def row(words, capsys):
    assert main(["evaluate", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ego.py").write_text(EGO)


def test_our_own_examples_are_sound_at_the_intersection(capsys):
    words = ["--world", "intersection", "--episodes", "6"]
    assert row([str(EXAMPLES / "dqn_intersection.zip"), *words], capsys)["method"] == (
        "6 episodes, seed 0"
    )
    process = f"process:{shlex.join([sys.executable, str(EXAMPLES / 'process_policy.py')])}"
    assert row([process, *words], capsys)["method"] == "6 episodes, seed 0"


def test_python_and_dials_drive_at_the_intersection(capsys):
    words = ["--world", "intersection", "--episodes", "3"]
    assert main(["evaluate", "python:ego.py:go", *words]) == 2
    assert "allow" in capsys.readouterr().err
    row(["python:ego.py:go", *words, "--allow-code"], capsys)
    biases = (np.zeros(3, np.float32),)
    weights = (np.zeros((3, 70), np.float32),)
    QPolicy(weights, biases, "relu", 1.0).save(Path("q.safetensors"))
    assert row(["q.safetensors", *words], capsys) != row(["go", *words], capsys)


@pytest.mark.slow
def test_foreign_policies_are_exact_in_a_gridworld(capsys):
    found = row(["python:ego.py:go", "--allow-code", "--angle", "30"], capsys)
    weights, biases = (np.zeros((3, 6), np.float32),), (np.float32([0, 1, 0]),)
    QPolicy(weights, biases, "relu", 1.0).save(Path("same.safetensors"))
    assert found == row(["same.safetensors", "--angle", "30"], capsys)
    assert found["method"] == "exact" and found["regret"] > 0.0
    sampled = row(["python:ego.py:go", "--allow-code", "--episodes", "5"], capsys)
    assert sampled["method"] == "5 episodes, seed 0"
    assert main(["evaluate", "python:ego.py:go", "--allow-code", "--soft"]) == 2
    assert "gives no probabilities: leave --soft out" in capsys.readouterr().err


def test_regret_is_at_the_angle_that_each_policy_was_trained_for(capsys):
    weights = (np.zeros((3, 6), np.float32),)
    for angle in (0.0, 90.0):
        made = {"numbers": {"angle": angle}}
        policy = QPolicy(weights, (np.float32([0, 1, 0]),), "relu", 1.0, made)
        policy.save(Path(f"at{angle:g}.safetensors"))
    files = ["at0.safetensors", "at90.safetensors"]
    rows = row(files, capsys)
    assert [one["target_angle"] for one in rows["policies"]] == [0.0, 90.0]
    alone = [
        row([file, "--angle", f"{angle}"], capsys)
        for file, angle in zip(files, (0, 90), strict=True)
    ]
    named = [{"policy": file} | row for file, row in zip(files, alone, strict=True)]
    assert rows["policies"] == named
    assert "regret" not in rows["pooled"] and "angle_not_pooled" in rows["pooled"]
    assert main(["evaluate", *files]) == 0
    table, _, end = capsys.readouterr().out.partition("pooled")
    assert "target angle" in table and "regret" not in end
