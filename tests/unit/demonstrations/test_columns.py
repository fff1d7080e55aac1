import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from socialiq.demonstrations.columns import LAYOUT, json_able
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair

NONE, ARRIVAL, COLLISION, TIMEOUT, OTHER = (int(kind) for kind in Ending)


@pytest.fixture(name="table")
def plain_table(make):
    """Episodes of 2, 3 and 1 rows that end by arrival, by the clock, and not at all."""
    table = make([2, 3, 1], [0, 1, 0])
    table.ending[:] = [NONE, ARRIVAL, NONE, NONE, TIMEOUT, NONE]
    table.terminated[:] = table.ending == ARRIVAL
    table.truncated[:] = table.ending == TIMEOUT
    return dataclasses.replace(table)


def change(table: Demonstrations, **changes: Any) -> Demonstrations:
    """The table with some columns or fields replaced, checked again."""
    pair = {name: changes.pop(name) for name in ("r_env", "r_social") if name in changes}
    rewards = table.rewards._replace(**{name[2:]: column for name, column in pair.items()})
    return dataclasses.replace(table, **{"rewards": rewards, **changes})


def refused(message: str) -> Any:
    """Expect a UserError whose single line contains exactly this."""
    return pytest.raises(UserError, match=rf"^(?=[^\n]*\Z).*{re.escape(message)}")


def with_row(column: np.ndarray, row: int, value: Any) -> np.ndarray:
    changed = column.copy()
    changed[row] = value
    return changed


def test_the_plain_table_is_accepted(table):
    assert change(table).n_transitions == 6


@pytest.mark.parametrize("name", LAYOUT)
def test_a_column_that_is_no_array_is_refused(table, name):
    with refused(f"column {name} is a list: pass a NumPy array of {LAYOUT[name][0].__name__}"):
        change(table, **{name: table.arrays()[name].tolist()})


@pytest.mark.parametrize("name", LAYOUT)
@pytest.mark.parametrize("dtype", [np.float16, np.int64, np.uint8])
def test_a_column_of_another_type_is_refused(table, name, dtype):
    mend = f"convert it with .astype(np.{LAYOUT[name][0].__name__})"
    with refused(f"column {name} is {dtype.__name__}: {mend}"):
        change(table, **{name: table.arrays()[name].astype(dtype)})


@pytest.mark.parametrize("name", LAYOUT)
def test_a_column_of_another_shape_is_refused(table, name):
    axes = LAYOUT[name][1]
    with refused(f"column {name} has {axes + 1} axes: reshape it to {axes}"):
        change(table, **{name: table.arrays()[name][..., None]})


@pytest.mark.parametrize("name", [name for name in LAYOUT if name != "action"])
def test_a_column_of_another_length_is_refused(table, name):
    with refused(f"column {name} has 5 rows where action has 6: pass one row per transition"):
        change(table, **{name: table.arrays()[name][:5]})


def test_a_table_without_rows_is_refused(table):
    with refused("column action has no rows: pass at least one transition"):
        change(table, action=table.action[:0])


def test_observations_of_two_lengths_are_refused(table):
    with refused("column next_observation has 1 features where observation has 2"):
        change(table, next_observation=table.next_observation[:, :1])


@pytest.mark.parametrize("name", ["observation", "next_observation", "r_env", "r_social"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(table, name, value):
    column = table.arrays()[name].copy()
    column[-1] = value
    column[4, ...] = value
    with refused(f"column {name}, row 4: not finite"):
        change(table, **{name: column})


@pytest.mark.parametrize("value", [-1, 3, 2**31 - 1])
def test_actions_outside_are_refused(table, value):
    with refused("column action, row 3: outside [0, 3): number from 0 and check n_actions"):
        change(table, action=with_row(table.action, 3, value))


@pytest.mark.parametrize("value", [-1, 3, 127])
def test_modes_outside_are_refused(table, value):
    with refused("column mode, row 5: outside [0, 3): number from 0 and check the number of mo"):
        change(table, mode=with_row(table.mode, 5, value))


@pytest.mark.parametrize(
    ("episode", "row"),
    [
        ([1, 1, 2, 2, 2, 3], 0),
        ([-1, 0, 1, 1, 1, 2], 0),
        ([0, 0, 2, 2, 2, 3], 2),
        ([0, 0, 1, 1, 1, 0], 5),
        ([0, 0, 1, 1, 1, -(2**31)], 5),
        ([0, 0, 1, 0, 1, 2], 3),
    ],
)
def test_episodes_out_of_order_are_refused(table, episode, row):
    with refused(f"column episode, row {row}: number episodes 0, 1, 2, ... in order"):
        change(table, episode=np.array(episode, np.int32))


def test_rows_after_an_end_are_refused(table):
    with refused("column episode, row 2: follows an end inside its episode"):
        change(table, episode=np.array([0, 0, 0, 0, 0, 1], np.int32), mode=np.zeros(6, np.int8))


def test_a_mode_that_changes_inside_an_episode_is_refused(table):
    with refused("column mode, row 3: changes inside an episode"):
        change(table, mode=np.array([0, 0, 1, 2, 1, 0], np.int8))


@pytest.mark.parametrize("value", [-1, 5, 127])
def test_endings_without_a_name_are_refused(table, value):
    with refused("column ending, row 1: not a value of types.Ending: use 0 NONE, 1 ARRIVAL"):
        change(table, ending=with_row(table.ending, 1, value))


ALLOWED = {
    (False, False): {NONE},
    (False, True): {TIMEOUT},
    (True, False): {ARRIVAL, COLLISION, OTHER},
    (True, True): {ARRIVAL, COLLISION, OTHER},
}


@pytest.mark.parametrize("ending", [int(kind) for kind in Ending])
@pytest.mark.parametrize("terminated", [False, True])
@pytest.mark.parametrize("truncated", [False, True])
def test_endings_agree_with_both_flags(table, ending, terminated, truncated):
    columns = {
        "ending": with_row(table.ending, 5, ending),
        "terminated": with_row(table.terminated, 5, terminated),
        "truncated": with_row(table.truncated, 5, truncated),
    }
    if ending in ALLOWED[terminated, truncated]:
        assert change(table, **columns).ending[5] == ending
    else:
        with refused("column ending, row 5: must be "):
            change(table, **columns)


@pytest.mark.parametrize("n_actions", [0, -1, 3.0, True, np.int64(3), None])
def test_a_number_of_actions_that_is_none_is_refused(table, n_actions):
    with refused(f"n_actions is {n_actions!r}: pass a Python int of at least 1"):
        change(table, n_actions=n_actions)


@pytest.mark.parametrize("mode_names", [["a", "b"], "ab", ("a", ""), ("a", 1)])
def test_mode_names_that_are_none_are_refused(table, mode_names):
    with refused("mode_names must be a tuple of non-empty strings"):
        change(table, mode_names=mode_names)


@pytest.mark.parametrize("mode_names", [("a", "b", "a"), tuple(map(str, range(128)))])
def test_mode_names_twice_or_too_many_are_refused(table, mode_names):
    with refused("mode_names must be distinct, and at most 127"):
        change(table, mode_names=mode_names)


def test_127_modes_are_accepted(table):
    assert len(change(table, mode_names=tuple(map(str, range(127)))).counts()) == 127


def test_rewards_that_are_no_pair_are_refused(table):
    with refused("rewards must be a RewardPair"):
        change(table, rewards=tuple(table.rewards))


@pytest.mark.parametrize("source", [{"a": np.ones(2)}, {"a": float("nan")}, {("a",): 1}])
def test_a_source_that_json_cannot_hold_is_refused(table, source):
    with refused("source cannot be written as JSON ("):
        change(table, source=source)


def test_a_source_that_is_no_dict_or_without_end_is_refused(table):
    with refused("source is a list: pass a dict"):
        change(table, source=["world"])
    endless: dict[str, Any] = {}
    endless["of"] = endless
    with refused("source cannot be written as JSON ("):
        change(table, source=endless)


def test_the_source_is_kept_as_json_and_detached(table):
    source = {"options": {"size": (7, 7)}, 1: None}
    kept = change(table, source=source).source
    source["options"]["size"] = (5, 5)
    assert kept == {"options": {"size": [7, 7]}, "1": None} == json_able(kept)


def test_missing_and_unknown_columns_are_named(table):
    arrays = table.arrays()
    arrays["done"] = arrays.pop("terminated")
    with refused("columns missing: terminated; unknown: done: pass exactly observation, action"):
        Demonstrations.of_arrays(arrays, table.mode_names, 3, {})


def test_arrays_are_the_columns_in_order(table):
    arrays = table.arrays()
    assert list(arrays) == list(LAYOUT)
    again = Demonstrations.of_arrays(arrays, table.mode_names, 3, table.source)
    assert isinstance(again.rewards, RewardPair)
    assert again.rewards.env is table.rewards.env
    assert again.rewards.social is table.rewards.social
    assert all(again.arrays()[name] is arrays[name] for name in LAYOUT)
