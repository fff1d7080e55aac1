"""`data from-arrays`, `to-arrays` and `from-trajectories`: plain arrays in and out."""

import json
from typing import Any

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.datasets.arrays import of_steps
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


TABLE = [  # the same steps as TRAJECTORIES
    "obs_0,acts,rews,next_obs_0,terminal,trajectory",
    "0,1,1,1,false,0",
    "1,0,2,2,true,0",
    "5,1,3,6,true,4",
]


def from_table(tmp_path, lines):
    (tmp_path / "in.csv").write_text("\n".join(lines) + "\n")
    words = ["data", "from-trajectories", str(tmp_path / "in.csv"), "--n-actions", "2"]
    out = tmp_path / "table.safetensors"
    return main([*words, "--social", "none", "--time-limit", "2", "--out", str(out)]), out


def test_trajectories_as_a_table_are_those_of_the_archive(tmp_path):
    options = ("--social", "none", "--time-limit", "2")
    _, archive = run(tmp_path, "from-trajectories", TRAJECTORIES, *options)
    status, out = from_table(tmp_path, TABLE)
    assert status == 0
    one, other = files.load(archive).arrays(), files.load(out).arrays()
    assert all(np.array_equal(column, other[name]) for name, column in one.items())
    assert files.load(out).source["file"] == "in.csv"


@pytest.mark.parametrize(
    ("row", "line", "mend"),
    [
        (0, "obs_0,acts,rews,next_obs_0,terminal", "no column trajectory"),
        (0, "obs_0,acts,reward,next_obs_0,terminal,trajectory", "unknown column 'reward'"),
        (2, "3,0,2,2,true,0", "row 1 does not begin where the row before it ends"),
        (1, "0,1,1,1,true,0", "terminal is set before a trajectory's last row"),
        (1, "0,1,1,1,false,4", "rows of a trajectory are not adjacent"),
        (3, "5,1.5,3,6,true,4", "column acts is '1.5', not an integer"),
        (3, "5,2,3,6,true,4", "row 2"),
    ],
)
def test_a_wrong_table_of_trajectories_is_one_line(tmp_path, capsys, row, line, mend):
    lines = [line if place == row else one for place, one in enumerate(TABLE)]
    status, out = from_table(tmp_path, lines)
    error = capsys.readouterr().err
    assert status == 2 and mend in error and error.count("\n") == 1 and not out.exists()


@pytest.mark.parametrize(
    ("command", "changed", "mend"),
    [
        ("from-arrays", {"reward": STEPS["reward"][:, 0]}, "say social none"),
        ("from-arrays", {"action": np.zeros(3)}, "no number of actions"),
        ("from-arrays", {"action": None}, "has no action"),
        ("from-arrays", {"terminated": None}, "nothing says where an episode ends"),
        ("from-arrays", {"terminated": np.array([{}], object)}, "not an array of numbers"),
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


@pytest.fixture
def saved(tmp_path):
    columns: dict[str, Any] = {name: array for name, array in STEPS.items() if name != "infos"}
    table = of_steps(
        **columns,
        n_actions=2,
        mode_names=("bold", "patient"),
        source={"made_by": "a test"},
    )
    return table, files.save(tmp_path / "in.safetensors", table)


@pytest.mark.parametrize(("ending", "told"), [("npz", True), ("csv", False)])
def test_a_table_goes_out_and_comes_back(tmp_path, capsys, saved, ending, told):
    (table, sha256), middle = saved, tmp_path / f"x.{ending}"
    assert main(["data", "to-arrays", str(tmp_path / "in.safetensors"), "--out", str(middle)]) == 0
    assert str(middle) in capsys.readouterr().out
    options = [] if told else ["--n-actions", "2", "--mode", "bold", "patient"]
    back = tmp_path / "back.safetensors"
    assert main(["data", "from-arrays", str(middle), "--out", str(back), *options]) == 0
    found = files.load(back)
    assert (files.sha256_of(found) == sha256) is told  # CSV has no place for the source
    assert found.mode_names == table.mode_names
    for name, column in table.arrays().items():
        assert found.arrays()[name].tobytes() == column.tobytes(), name


@pytest.mark.usefixtures("saved")
def test_what_cannot_be_written_is_one_line(tmp_path, capsys):
    (tmp_path / "x.csv").write_text("keep me")
    for out, mend in (("x.csv", "exists already"), ("x.xlsx", "choose one of .npz")):
        given = ["data", "to-arrays", str(tmp_path / "in.safetensors")]
        assert main([*given, "--out", str(tmp_path / out)]) == 2
        error = capsys.readouterr().err
        assert mend in error and error.count("\n") == 1
    assert (tmp_path / "x.csv").read_text() == "keep me" and not (tmp_path / "x.xlsx").exists()


def test_a_file_that_exists_is_kept(tmp_path, capsys):
    (tmp_path / "out.safetensors").write_text("keep me")
    status, out = run(tmp_path, "from-arrays", STEPS)
    assert status == 2 and out.read_text() == "keep me"
    assert "exists already" in capsys.readouterr().err
