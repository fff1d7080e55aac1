"""Demonstrations with continuous actions as Parquet, D4RL's HDF5 and Minari, out and in."""

import json

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.datasets.arrays import Bounds, of_steps
from socialiq.datasets.minari import read_minari, write_minari
from socialiq.datasets.step_files import read_steps, write_steps
from socialiq.demonstrations import files
from socialiq.errors import UserError

h5py = pytest.importorskip("h5py", reason="extra `minari` is not installed")
minari = pytest.importorskip("minari", reason="extra `minari` is not installed")
pytest.importorskip("pyarrow", reason="extra `parquet` is not installed")

RNG = np.random.default_rng(8)
PLACES = RNG.normal(size=(8, 3)).astype(np.float32)
ACTIONS = RNG.uniform(-1, 1, (6, 2)).astype(np.float32)


@pytest.fixture
def table():
    return of_steps(
        observation=PLACES[[0, 1, 2, 4, 5, 6]],
        next_observation=PLACES[[1, 2, 3, 5, 6, 7]],
        action=ACTIONS,
        reward=RNG.normal(size=(6, 2)),
        terminated=np.array([0, 0, 1, 0, 0, 0], bool),
        truncated=np.array([0, 0, 0, 0, 0, 1], bool),
        mode=np.array([0, 0, 0, 1, 1, 1]),
        mode_names=("bold", "calm"),
        source={"action_bounds": {"low": [-2.0, 0.0], "high": [2.0, 9.0]}},
    )


@pytest.mark.parametrize("kind", [".parquet", ".hdf5"])
def test_a_file_keeps_everything_to_the_bit(table, tmp_path, kind):
    path = tmp_path / f"steps{kind}"
    write_steps(path, table)
    assert files.sha256_of(read_steps(path)) == files.sha256_of(table)


def test_d4rl_reads_what_is_written_and_a_changed_file_is_refused(table, tmp_path):
    path = tmp_path / "steps.hdf5"
    write_steps(path, table)
    with h5py.File(path, "r+") as file:
        assert np.array_equal(file["actions"][:], ACTIONS)
        assert np.array_equal(file["rewards"][:], table.rewards.env)
        assert file["terminals"][:].tolist() == [0, 0, 1, 0, 0, 0]
        file["actions"][0, 0] = 0.5
    with pytest.raises(UserError, match="is not what was written"):
        read_steps(path)


def of_d4rl(path, without=(), **changed):
    arrays = {
        "observations": PLACES[:4],
        "next_observations": PLACES[1:5],
        "actions": 3.0 * ACTIONS[:4],
        "rewards": np.arange(4.0),
        "terminals": np.array([0, 1, 0, 0], bool),
        "timeouts": np.array([0, 0, 0, 1], bool),
    }
    with h5py.File(path, "w") as file:
        for name, array in {**arrays, **changed}.items():
            if name not in without:
                file[name] = array
    return path


def test_a_file_of_d4rl_is_read_in_its_units(tmp_path):
    path, bounds = of_d4rl(tmp_path / "a.hdf5"), Bounds((-3.0,), (3.0,))
    found = read_steps(path, bounds=bounds, social="none")
    assert np.allclose(found.action, ACTIONS[:4], atol=1e-6) and found.n_episodes == 2
    assert found.ending.tolist() == [0, 4, 0, 3] and found.rewards.env.tolist() == [0, 1, 2, 3]
    pair = of_d4rl(tmp_path / "b.hdf5", **{"infos/reward_vector": np.ones((4, 2))})
    assert read_steps(pair, bounds=bounds).rewards.social.tolist() == [1, 1, 1, 1]


@pytest.mark.parametrize(
    ("without", "changed", "line"),
    [
        (["actions"], {}, "has no actions: is it of D4RL's layout"),
        (["next_observations"], {}, "has no next_observations"),
        (["timeouts", "terminals"], {}, "has no terminals"),
        ([], {"actions": np.full((4, 2), np.nan)}, "row 0: not finite"),
        ([], {"actions": np.full((4, 2), 3.5)}, "outside"),
        ([], {"actions": np.array([b"a", b"b"])}, "not an array of numbers"),
        ([], {"actions": np.zeros((3, 2))}, "column"),
        ([], {"rewards": np.zeros((4, 3))}, "reward has shape"),
        ([], {"terminals": np.full(4, 0.5)}, "one boolean a step"),
    ],
)
def test_a_bad_file_of_d4rl_is_told_in_one_line(tmp_path, capsys, without, changed, line):
    path = of_d4rl(tmp_path / "a.hdf5", without, **changed)
    more = ["--action-low", "-3", "--action-high", "3", "--social", "none"]
    out = tmp_path / "o.safetensors"
    assert main(["data", "from-arrays", str(path), "--out", str(out), *more]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert line in told and not out.exists()


def test_minari_keeps_everything_to_the_bit(table, tmp_path):
    write_minari(table, tmp_path / "road-v0")
    assert files.sha256_of(read_minari(tmp_path / "road-v0")) == files.sha256_of(table)
    theirs = minari.MinariDataset(tmp_path / "road-v0/data")
    assert theirs.action_space.shape == (2,) and theirs.action_space.high.tolist() == [1.0, 1.0]
    assert np.array_equal(theirs[0].actions, ACTIONS[:3])


def foreign(table, folder, **space):
    """Make a data set that names no origin, with another space of actions."""
    write_minari(table, folder)
    path = folder / "data/metadata.json"
    kept = json.loads(path.read_text())
    del kept["socialiq"]
    kept["action_space"] = json.dumps({**json.loads(kept["action_space"]), **space})
    path.write_text(json.dumps(kept))
    return folder


def test_minari_of_others_is_scaled_by_its_space(table, tmp_path):
    found = read_minari(foreign(table, tmp_path / "a-v0", low=[-2.0, -1.0], high=[2.0, 1.0]))
    assert np.allclose(found.action, ACTIONS * [0.5, 1.0])
    assert found.source["action_bounds"] == {"low": [-2.0, -1.0], "high": [2.0, 1.0]}


@pytest.mark.parametrize(
    ("space", "line"),
    [
        ({"low": [-np.inf, -1.0]}, "actions without finite bounds: name them (--action-low"),
        ({"low": [2.0, -1.0]}, "must be below the upper one"),
        ({"low": [-0.1, -1.0], "high": [0.1, 1.0]}, "is outside the bounds"),
        ({"low": "?"}, "actions without finite bounds"),
        ({"type": "MultiDiscrete"}, "only discrete actions are supported, or a Box"),
        ({"shape": [2, 1]}, "only discrete actions are supported, or a Box"),
        ({"shape": [3], "low": [-1] * 3, "high": [1] * 3}, "where (3, 3) is due"),
    ],
)
def test_a_bad_space_of_minari_is_told_in_one_line(table, tmp_path, capsys, space, line):
    folder, out = foreign(table, tmp_path / "a-v0", **space), tmp_path / "o.safetensors"
    assert main(["data", "from-minari", str(folder), "--out", str(out)]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert line in told and not out.exists()


def test_bounds_that_minari_lacks_are_given(table, tmp_path):
    folder = foreign(table, tmp_path / "a-v0", low=[-np.inf, -1.0])
    found = read_minari(folder, bounds=Bounds((-4.0,), (4.0,)))
    assert np.allclose(found.action, ACTIONS / 4.0)
