"""`data from-arrays` and `data from-trajectories`: archives in, a demonstrations file out."""

import json

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.demonstrations import files

STEPS = {
    "observation": np.array([[0.0], [1.0], [0.0]]),
    "action": np.array([1, 0, 1]),
    "reward": np.array([[1.0, 0.5], [2.0, 0.0], [3.0, -1.0]]),
    "next_observation": np.array([[1.0], [2.0], [1.0]]),
    "terminated": np.array([False, True, False]),
    "mode": np.array([0, 0, 1]),
    "infos": np.array([{}, {}, {}], object),  # never opened
}
TRAJECTORIES = {
    "obs": np.array([[0.0], [1.0], [2.0], [5.0], [6.0]]),
    "acts": np.array([1, 0, 1]),
    "rews": np.array([1.0, 2.0, 3.0]),
    "terminal": np.array([True, True]),
    "indices": np.array([2]),
    "infos": np.array([{}, {}, {}], object),
}


def run(tmp_path, command, arrays, *options):
    np.savez(tmp_path / "in.npz", **arrays)
    out = tmp_path / "out.safetensors"
    status = main(
        ["data", command, str(tmp_path / "in.npz"), "--n-actions", "2", "--out", str(out), *options]
    )
    return status, out


def test_arrays_become_a_file(tmp_path, capsys):
    status, out = run(tmp_path, "from-arrays", STEPS, "--mode", "bold", "patient", "--json")
    assert status == 0
    found = json.loads(capsys.readouterr().out)
    table = files.load(out)
    assert found["sha256"] == files.sha256_of(table)
    assert found["modes"] == [
        {"mode": "bold", "episodes": 1, "transitions": 2},
        {"mode": "patient", "episodes": 1, "transitions": 1},
    ]
    assert table.ending.tolist() == [0, 4, 0] and table.rewards.social.tolist() == [0.5, 0, -1]
    assert table.source["file"] == "in.npz" and len(table.source["sha256"]) == 64


def test_trajectories_become_a_file(tmp_path, capsys):
    options = ("--social", "none", "--time-limit", "2", "--mode", "demo")
    status, out = run(tmp_path, "from-trajectories", TRAJECTORIES, *options)
    assert status == 0 and "demo" in capsys.readouterr().out
    table = files.load(out)
    assert table.ending.tolist() == [0, 3, 4] and table.mode_names == ("demo",)
    assert table.rewards.env.tolist() == [1, 2, 3] and not table.rewards.social.any()


@pytest.mark.parametrize(
    ("command", "changed", "mend"),
    [
        ("from-arrays", {"reward": STEPS["reward"][:, 0]}, "say social none"),
        ("from-arrays", {"action": np.zeros(3)}, "only discrete actions"),
        ("from-arrays", {"action": None}, "has no action"),
        ("from-arrays", {"terminated": None}, "nothing says where an episode ends"),
        ("from-arrays", {"terminated": np.array([{}], object)}, "no array of numbers"),
        ("from-trajectories", {}, "say social none"),
        ("from-trajectories", {"indices": None}, "no indices"),
    ],
)
def test_what_is_missing_is_one_line(tmp_path, capsys, command, changed, mend):
    arrays = (STEPS if command == "from-arrays" else TRAJECTORIES) | changed
    arrays = {name: array for name, array in arrays.items() if array is not None}
    status, out = run(tmp_path, command, arrays)
    captured = capsys.readouterr()
    assert status == 2 and mend in captured.err and captured.err.count("\n") == 1
    assert not out.exists()


def test_a_file_that_exists_is_kept(tmp_path, capsys):
    (tmp_path / "out.safetensors").write_text("keep me")
    status, out = run(tmp_path, "from-arrays", STEPS)
    assert status == 2 and out.read_text() == "keep me"
    assert "exists already" in capsys.readouterr().err
