"""Continuous actions of other programs, in their units and in files, and back."""

import csv

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.datasets.arrays import Bounds, actions_of, of_steps
from socialiq.datasets.step_files import read_steps, write_steps
from socialiq.datasets.trajectories import of_trajectories, read_trajectories
from socialiq.demonstrations import files
from socialiq.errors import UserError

RNG = np.random.default_rng(5)
ROWS = {
    "observation": RNG.normal(size=(6, 3)).astype(np.float32),
    "next_observation": RNG.normal(size=(6, 3)).astype(np.float32),
    "reward": RNG.normal(size=(6, 2)),
    "terminated": np.array([0, 0, 1, 0, 0, 0], bool),
    "truncated": np.array([0, 0, 0, 0, 0, 1], bool),
}
UNIT = np.concatenate([[[1.0, -1.0]], RNG.uniform(-1, 1, (5, 2))]).astype(np.float32)
BOUNDS = Bounds((-2.0, 0.0), (2.0, 10.0))


def table(**more):
    return of_steps(**{**ROWS, "action": UNIT, **more})


def test_actions_in_other_units_are_scaled_and_their_bounds_kept():
    theirs = np.array([[-2.0, 10.0], [2.0, 0.0], [0.0, 5.0], [1.0, 2.5], [0, 0], [0, 0]])
    made = table(action=theirs, bounds=BOUNDS)
    assert made.action[:4].tolist() == [[-1.0, 1.0], [1.0, -1.0], [0.0, 0.0], [0.5, -0.5]]
    assert made.n_actions == 0 and made.action_size == 2
    assert made.source["action_bounds"] == {"low": [-2.0, 0.0], "high": [2.0, 10.0]}
    one = table(action=theirs[:, 0], bounds=Bounds((-2.0,), (2.0,)))
    assert one.action[:4, 0].tolist() == [-1.0, 1.0, 0.0, 0.5] and one.action.shape == (6, 1)


def test_what_is_in_the_unit_stays_to_the_bit_and_rounding_is_no_mistake():
    kept = actions_of(UNIT, 0, Bounds((-1.0,), (1.0,)))
    assert np.array_equal(kept.view(np.uint32), UNIT.view(np.uint32))
    third = np.float32([[-0.4], [0.4]])  # beyond -.4 and .4 by 6e-9
    assert actions_of(third, 0, Bounds((-0.4,), (0.4,))).tolist() == [[-1.0], [1.0]]


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"action": 2.0 * UNIT}, "row 0: outside \\[-1, 1\\]"),
        ({"action": UNIT * np.nan}, "row 0: not finite"),
        ({"action": UNIT.astype(np.float64) * 1e300}, "row 0: not finite"),
        ({"action": UNIT[:4]}, "column"),
        ({"action": UNIT[:, :0]}, "one vector of floats"),
        ({"action": UNIT[:, :, None]}, "one vector of floats"),
        ({"action": UNIT.astype(str)}, "an array of numbers"),
        ({"action": [[0.0], [0.0, 1.0]] * 3}, "same shape"),
        ({"action": UNIT, "n_actions": 3}, "no number of actions"),
        ({"action": [0, 1, 2, 0, 1, 2]}, "n_actions is 0"),
        ({"action": [0, 1, 2, 0, 1, 2], "n_actions": 3, "bounds": BOUNDS}, "leave them out"),
        ({"action": 11.0 * UNIT, "bounds": BOUNDS}, "row 0: .* is outside the bounds"),
        ({"action": UNIT[:, :1], "bounds": BOUNDS}, "1 numbers and 2 bounds"),
    ],
)
def test_other_actions_are_refused_in_one_line(more, line):
    with pytest.raises(UserError, match=line) as caught:
        table(**more)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("low", "high", "line"),
    [
        ((1.0,), (1.0,), "below the upper"),
        ((1.0,), (), "as many finite lower ends"),
        ((0.0, 0.0), (1.0,), "as many finite"),
        ((0.0,), (np.inf,), "as many finite"),
        ((np.nan,), (1.0,), "as many finite"),
    ],
)
def test_bounds_are_pairs_of_finite_ends(low, high, line):
    with pytest.raises(UserError, match=line):
        Bounds.of(low, high)


@pytest.mark.parametrize("kind", [".npz", ".csv"])
def test_a_table_goes_out_and_comes_back_to_the_bit(tmp_path, kind):
    made, path = table(source={"action_bounds": BOUNDS.as_json()}), tmp_path / f"steps{kind}"
    write_steps(path, made)
    again = read_steps(path)
    if kind == ".npz":
        assert files.sha256_of(again) == files.sha256_of(made)
    assert again.n_actions == 0
    for name, column in made.arrays().items():
        assert column.tobytes() == again.arrays()[name].tobytes(), name
    with pytest.raises(UserError, match="number of actions"):
        read_steps(path, n_actions=3)


def changed(path, name, row, cell):
    rows = list(csv.reader(path.read_text().splitlines()))
    rows[row][rows[0].index(name)] = cell
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


@pytest.mark.parametrize(
    ("name", "row", "cell", "line"),
    [
        ("action_0", 2, "left", "line 3: column action_0 is 'left', not a number"),
        ("action_1", 2, "nan", "column action_1, row 1: not finite"),
        ("action_1", 3, "1.5", "column action, row 2: outside"),
        ("action_1", 0, "action_2", "action_2 but no column action_1"),
        ("action_0", 0, "action", "action_1 but no column action_0"),
        ("step", 0, "action", "has action beside action_0"),
    ],
)
def test_a_bad_column_of_actions_is_told_in_one_line(tmp_path, capsys, name, row, cell, line):
    path = tmp_path / "steps.csv"
    write_steps(path, table())
    changed(path, name, row, cell)
    assert main(["data", "from-arrays", str(path), "--out", str(tmp_path / "o.safetensors")]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert line in told and not (tmp_path / "o.safetensors").exists()


def test_the_command_scales_by_the_bounds_that_it_is_given(tmp_path, capsys):
    path, out = tmp_path / "steps.csv", tmp_path / "o.safetensors"
    write_steps(path, table())
    ends = ["--action-low", "-2", "-1", "--action-high", "2", "1"]
    assert main(["data", "from-arrays", str(path), "--out", str(out), *ends]) == 0
    made = files.load(out, continuous=True)
    assert np.allclose(made.action, UNIT * [0.5, 1.0])
    assert made.source["action_bounds"] == {"low": [-2.0, -1.0], "high": [2.0, 1.0]}
    assert main(["data", "to-arrays", str(out), "--out", str(tmp_path / "back.npz")]) == 0
    assert files.sha256_of(read_steps(tmp_path / "back.npz")) == files.sha256_of(made)
    capsys.readouterr()
    wrong = ["data", "from-arrays", str(tmp_path / "back.npz"), "--out", str(tmp_path / "p")]
    assert main([*wrong, *ends]) == 2
    assert "leave the option out" in capsys.readouterr().err


def test_trajectories_have_vectors_too(tmp_path):
    one = {"obs": np.zeros((3, 2)), "acts": UNIT[:2], "rews": np.ones((2, 2)), "terminal": True}
    made = of_trajectories([one, one])
    assert made.action_size == 2 and made.n_episodes == 2
    with pytest.raises(UserError, match="differ in actions"):
        of_trajectories([one, {**one, "acts": UNIT[:2, :1]}])
    with pytest.raises(UserError, match="differ in actions"):
        of_trajectories([one, {**one, "acts": [0, 1]}])
    path = tmp_path / "t.csv"
    path.write_text(
        "obs_0,next_obs_0,acts_0,r_env,r_social,terminal,trajectory\n"
        "0,1,0.5,1,2,false,0\n1,2,-3,1,2,true,0\n"
    )
    found = read_trajectories(path, bounds=Bounds((-3.0,), (5.0,)))
    assert found.action.tolist() == [[-0.125], [-1.0]]
