"""`train`, `dial` and `evaluate` say so in one line if no angle of a dial changes an action."""

import types
from pathlib import Path

import jaxtyping
import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.cli.train.shared import RunFolder, RunOptions
from socialiq.errors import UserError
from socialiq.evaluation.dial import stands
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy

SAME = "takes the same actions at every angle from 0 to 90 degrees"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # stubs stand for trainings


@pytest.fixture(name="data", scope="module")
def some_data(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "mixed.safetensors"
    assert main(["collect", "crossing5", "--episodes", "1", "--out", str(path)]) == 0
    return str(path)


def dial_of(slope: float, high: float = 90.0) -> DialPolicy:
    """A dial that takes action 0, and action 1 from 45 degrees on if there is a slope."""
    weight = np.zeros((2, 6), np.float32)
    weight[0, -2] = weight[1, -1] = slope  # (cos α, sin α)
    bias = np.zeros(2, np.float32)
    return DialPolicy(QPolicy((weight,), (bias,), "relu", 1.0), 0.0, high)


@pytest.mark.parametrize("slope", [0.0, 1.0])
@pytest.mark.parametrize(
    "words",
    [
        "dial crossing5 --policy d.safetensors --every 45",
        "evaluate d.safetensors --world crossing5 --angle 20",
        "evaluate d.safetensors --world socialiq/Crossing5-v1 --angle 20 --episodes 2",
    ],
)
def test_dial_and_evaluate(words, slope, capsys):
    dial_of(slope).save("d.safetensors")
    assert main(words.split()) == 0
    assert capsys.readouterr().err.count(f"d.safetensors {SAME}") == (slope == 0.0)


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_evaluate_by_data(slope, data, monkeypatch, capsys):
    class Unfitted:
        def __init__(self, logged, **_):
            self.logged = logged

        def evaluate(self, *_):
            raise UserError("a fit takes long")

    monkeypatch.setattr("socialiq.cli.evaluate_data.Evaluator", Unfitted)
    dial_of(slope).save("d.safetensors")
    assert main(["evaluate", "d.safetensors", "--data", data]) == 2
    assert capsys.readouterr().err.count(f"d.safetensors {SAME}") == (slope == 0.0)


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_an_offline_training(slope, data, monkeypatch, capsys):
    history = types.SimpleNamespace(updates=[1], array=lambda _: np.zeros((1, 1)))
    trained = types.SimpleNamespace(history=history, policy=lambda _: dial_of(slope))
    monkeypatch.setattr("socialiq.learners.dial.offline.train", lambda *_: {"dial": trained})
    assert main(["train", "offline-dial", data, "--world", "crossing5", "--out", "run"]) == 0
    assert capsys.readouterr().err.count(f"run/dial_0.safetensors {SAME}") == (slope == 0.0)


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_any_other_training(slope, capsys):
    Path("run").mkdir()
    trained = types.SimpleNamespace(hyperparameters=[None], policy=lambda _: dial_of(slope))
    run = RunFolder(Path("run"), "dial", RunOptions())
    run.save_policies(trained, observe=lambda dial: np.eye(dial.n_features))
    assert capsys.readouterr().err.count(f"run/dial_0.safetensors {SAME}") == (slope == 0.0)


def test_a_dial_of_one_angle_has_no_others():
    assert not stands(dial_of(0.0, high=0.0), np.eye(4))
