"""Demonstrations of continuous actions, as a table and as a file."""

import dataclasses
import re

import numpy as np
import pytest

from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import RewardPair


def drives(size: int = 2, rows: int = 6) -> Demonstrations:
    rng = np.random.default_rng(0)
    return Demonstrations.of(
        observation=rng.normal(size=(rows, 3)),
        action=rng.uniform(-1, 1, (rows, size)),
        next_observation=rng.normal(size=(rows, 3)),
        ending=np.tile([0, 0, 3], rows // 3),
        rewards=RewardPair(rng.normal(size=rows), rng.normal(size=rows)),
        episode=np.repeat(np.arange(rows // 3), 3),
        n_actions=0,
    )


def test_a_table_has_float_actions_and_their_size():
    table = drives()
    assert table.action.dtype == np.float32 and table.action.shape == (6, 2)
    assert (table.action_size, table.n_actions) == (2, 0)
    assert table.select(np.array([1])).action.shape == (3, 2)
    assert table.subsample(2).action.tolist() == table.action[[0, 2, 3, 5]].tolist()
    assert concatenate([table, table]).action.shape == (12, 2)


def test_a_file_comes_back_and_is_of_the_second_version(tmp_path):
    path, table = tmp_path / "drives.safetensors", drives()
    sha256 = files.save(path, table)
    again = files.load(path, continuous=True)
    assert sha256 == files.sha256_of(again)
    np.testing.assert_array_equal(again.action, table.action)
    assert load_arrays(path, "demonstrations", 2)[1]["version"] == 2


def test_a_command_of_discrete_actions_refuses_the_file(tmp_path):
    files.save(tmp_path / "drives.safetensors", drives())
    with pytest.raises(UserError, match="has continuous actions"):
        files.load(tmp_path / "drives.safetensors")


def test_discrete_actions_under_the_second_version_are_refused(tmp_path):
    path, table = tmp_path / "odd.safetensors", drives()
    header = files.header_of(table) | {"n_actions": 3}
    save_arrays(path, "demonstrations", 2, table.arrays(), header)
    with pytest.raises(UserError, match="actions of another kind than its version"):
        files.load(path, continuous=True)


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (np.full((6, 2), np.nan), "column action, row 0: not finite"),
        (np.full((6, 2), np.inf), "column action, row 0: not finite"),
        (np.full((6, 2), 1.5), "column action, row 0: outside [-1, 1]"),
        (np.zeros((6, 0)), "column action has rows without a number"),
        (np.zeros((5, 2)), "rows where action has 5"),
        (np.zeros(6), "n_actions is 0"),
        (np.zeros((6, 2), np.int32), "n_actions is 0"),
        (np.zeros((6, 2), np.float64), "column action is float64"),
    ],
)
def test_actions_that_are_none_are_refused(action, says):
    exact = action.dtype == np.float64 and says.endswith("float64")
    given = action if exact or action.dtype.kind == "i" else action.astype(np.float32)
    with pytest.raises(UserError, match=re.escape(says)):
        dataclasses.replace(drives(), action=given)


def test_tables_of_other_sizes_do_not_mix():
    with pytest.raises(UserError, match="differ in action_size"):
        concatenate([drives(1), drives(2)])
