"""`train-dial` with presets whose programs take long to compile."""

import json

import pytest

from socialiq.cli.main import main
from socialiq.learners.dial.config import QUICK, RUNS

FULL_COMPILER = True


@pytest.fixture(scope="module")
def clocked(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "clocked.safetensors"
    arguments = ["collect", "crossing7", "--clock", "--episodes", "3", "--out", str(path)]
    assert main(arguments) == 0
    return path


@pytest.mark.slow
def test_a_dial_can_be_trained_without_demonstrations(tmp_path):
    out = tmp_path / "run"
    arguments = ["train-dial", "crossing5", "--preset", "online-alone", "--out", str(out)]
    assert main([*arguments, "--updates", "5"]) == 0
    assert (out / "dial_0.safetensors").exists()


@pytest.mark.slow
def test_the_quick_preset_is_a_smaller_network_on_the_same_rows(clocked, tmp_path):
    out = tmp_path / "run"
    arguments = ["train-dial", "crossing7", "--data", str(clocked), "--out", str(out)]
    assert main([*arguments, "--preset", "online-quick", "--updates", "5"]) == 0
    structure = json.loads((out / "run.json").read_text())["structure"]
    assert structure["hidden"] == list(QUICK.structure.hidden)
    assert structure["expert_batch"] + structure["replay_batch"] == 128
    assert structure["redraw_times"] == RUNS["online"].structure.redraw_times


@pytest.mark.slow
def test_a_strength_is_found_for_a_budget(clocked, tmp_path):
    """Far from its optimum after so few updates: the multiplier only rises, and says so."""
    out = tmp_path / "run"
    arguments = ["train-dial", "crossing7", "--preset", "offline", "--data", str(clocked)]
    arguments += ["--angle", "45", "--budget", "0.01", "--updates", "600", "--out", str(out)]
    assert main(arguments) == 0
    record = json.loads((out / "run.json").read_text())
    assert (record["structure"]["low"], record["structure"]["high"]) == (45, 45)
    assert [look["updates"] for look in record["budget_path"]] == [250, 500]
    (found,) = record["dials"]
    assert found["multiplier"] == pytest.approx(record["budget_path"][-1]["multiplier"][0])
    first, last = (look["regret"][0] for look in record["budget_path"])
    assert min(first, last) > 0.02 and found["multiplier"] > 1.5
    assert found["regret"] == pytest.approx(last)
