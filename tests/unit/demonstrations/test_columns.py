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


@pytest.mark.parametrize("name", ["observation", "next_observation", "r_env", "r_social"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(table, name, value):
    column = table.arrays()[name].copy()
    column[-1] = value
    column[4, ...] = value
    with refused(f"column {name}, row 4: not finite"):
        change(table, **{name: column})


ENDLESS: dict[str, Any] = {}
ENDLESS["of"] = ENDLESS
OUT_OF_ORDER = {
    (1, 1, 2, 2, 2, 3): 0,
    (-1, 0, 1, 1, 1, 2): 0,
    (0, 0, 2, 2, 2, 3): 2,
    (0, 0, 1, 1, 1, 0): 5,
    (0, 0, 1, 1, 1, -(2**31)): 5,
    (0, 0, 1, 0, 1, 2): 3,
}
"""Row of the first mistake by numbers of episodes."""


def at_row(name, row, value):
    """Return a change of one value of a column."""
    return lambda table: {name: with_row(getattr(table, name), row, value)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (lambda table: {"action": table.action[:0]}, "column action has no rows: pass at least"),
        (
            lambda table: {"next_observation": table.next_observation[:, :1]},
            "column next_observation has 1 features where observation has 2",
        ),
        *(
            (at_row("action", 3, value), "column action, row 3: outside [0, 3): number from 0 and")
            for value in (-1, 3, 2**31 - 1)
        ),
        *(
            (at_row("mode", 5, value), "column mode, row 5: outside [0, 3): number from 0 and che")
            for value in (-1, 3, 127)
        ),
        *(
            (at_row("ending", 1, value), "column ending, row 1: not a value of types.Ending: use 0")
            for value in (-1, 5, 127)
        ),
        *(
            (
                {"episode": np.array(numbers, np.int32)},
                f"column episode, row {row}: number episodes 0, 1, 2, ... in order",
            )
            for numbers, row in OUT_OF_ORDER.items()
        ),
        (
            {"episode": np.array([0, 0, 0, 0, 0, 1], np.int32), "mode": np.zeros(6, np.int8)},
            "column episode, row 2: follows an end inside its episode",
        ),
        (
            {"mode": np.array([0, 0, 1, 2, 1, 0], np.int8)},
            "column mode, row 3: changes inside an episode",
        ),
        *(
            ({"n_actions": number}, f"n_actions is {number!r}: pass a Python int of at least 1")
            for number in (0, -1, 3.0, True, np.int64(3), None)
        ),
        *(
            ({"mode_names": names}, "mode_names must be a tuple of non-empty strings")
            for names in (["a", "b"], "ab", ("a", ""), ("a", 1))
        ),
        *(
            ({"mode_names": names}, "mode_names must be distinct, and at most 127")
            for names in (("a", "b", "a"), tuple(map(str, range(128))))
        ),
        (lambda table: {"rewards": tuple(table.rewards)}, "rewards must be a RewardPair"),
        ({"source": ["world"]}, "source is a list: pass a dict"),
        *(
            ({"source": source}, "source cannot be written as JSON (")
            for source in ({"a": np.ones(2)}, {"a": float("nan")}, {("a",): 1}, ENDLESS)
        ),
    ],
)
def test_columns_and_fields_that_make_no_table_are_refused(table, changes, message):
    with refused(message):
        change(table, **(changes(table) if callable(changes) else changes))


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


def test_127_modes_are_accepted(table):
    assert len(change(table, mode_names=tuple(map(str, range(127)))).counts()) == 127


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
