import json
from pathlib import Path

import jax
import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "data.safetensors"
    assert main(["collect", "crossing7", "--episodes", "40", "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """Return a network that was never trained: it drives as no demonstrator does."""
    path = tmp_path_factory.mktemp("policies") / "policy.safetensors"
    QPolicy.of(QNetwork.initialise(jax.random.key(0), 6, (4,), 3), 1.0, {}).save(path)
    return path


def test_a_policy_is_evaluated_without_a_world(capsys, data, policy):
    capsys.readouterr()
    assert main(["evaluate", str(policy), "--data", str(data), "--json", "--soft"]) == 0
    found = json.loads(capsys.readouterr().out)
    (one,) = found["policies"]
    assert found["episodes"] == 120
    assert [row["angle"] for row in one["angles"]] == [0, 15, 30, 45, 60, 75, 90]
    for row in one["angles"]:
        assert row["fitted_q_low"] <= row["fitted_q"] <= row["fitted_q_high"]
        assert row["importance"] == "" and "can't support an evaluation" in row["warning"]


def test_what_the_data_cannot_support_is_one_line(capsys, data, policy):
    capsys.readouterr()
    assert main(["evaluate", str(policy), "--data", str(data), "--soft"]) == 0
    printed = capsys.readouterr()
    assert "J(α) from 120 episodes" in printed.out
    assert printed.err.count("can't support an evaluation") == 1


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--episodes", "5"], "--data rolls nothing out: leave out --episodes"),
        (["--processes", "2"], "leave out --processes"),
    ],
)
def test_options_of_rollouts_are_refused(capsys, data, policy, more, line):
    assert main(["evaluate", str(policy), "--data", str(data), *more]) == 2
    assert line in capsys.readouterr().err


def test_policies_are_compared_at_one_angle(capsys, data, tmp_path):
    files = [str(tmp_path / f"always{action}.safetensors") for action in (0, 2)]
    for file, bias in zip(files, np.eye(3, dtype=np.float32)[[0, 2]], strict=True):
        QPolicy((np.zeros((3, 6), np.float32),), (bias,), "relu", 1.0).save(Path(file))
    capsys.readouterr()
    assert main(["evaluate", *files, "--data", str(data), "--angle", "0", "--json"]) == 0
    policies = json.loads(capsys.readouterr().out)["policies"]
    (stays,), (goes,) = (policy["angles"] for policy in policies)
    assert stays["angle"] == goes["angle"] == 0.0
    assert goes["best"] and not stays["best"] and goes["below_best"] == 0.0
    gap = goes["fitted_q"] - stays["fitted_q"]
    assert stays["below_best"] == pytest.approx(gap, abs=2e-6)
    assert stays["below_best_low"] <= gap <= stays["below_best_high"]
