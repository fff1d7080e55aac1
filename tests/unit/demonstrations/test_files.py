from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq import storage
from socialiq.demonstrations.columns import LAYOUT
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.files import KIND, SCHEMA_VERSION, load, save
from socialiq.errors import UserError

Make = Callable[..., Demonstrations]
Same = Callable[[Demonstrations, Demonstrations], bool]


def write(path: Path, arrays: dict[str, np.ndarray], header: dict[str, Any]) -> None:
    storage.save_arrays(path, KIND, SCHEMA_VERSION, arrays, header)


def header_of(table: Demonstrations) -> dict[str, Any]:
    return {
        "mode_names": list(table.mode_names),
        "n_actions": table.n_actions,
        "source": table.source,
    }


def refusal(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


@given(st.lists(st.integers(1, 6), min_size=1, max_size=8), st.integers(0, 1000))
def test_round_trip(
    tmp_path_factory,
    make,
    same,
    lengths,
    seed,
):
    table = make(lengths, [number % 3 for number in range(len(lengths))], seed=seed)
    path = tmp_path_factory.getbasetemp() / "round_trip.safetensors"
    save(path, table)
    assert same(load(path), table)


def test_the_hash_is_of_the_content(tmp_path, make):
    first = save(tmp_path / "a", make([2, 3], seed=1))
    assert save(tmp_path / "b", make([2, 3], seed=1)) == first
    assert save(tmp_path / "c", make([2, 3], seed=2)) != first
    assert save(tmp_path / "d", make([2, 3], [0, 1], seed=1)) != first


@pytest.mark.parametrize("name", LAYOUT)
def test_a_missing_column_is_refused(tmp_path, make, name):
    table = make([2, 3])
    arrays = table.arrays()
    del arrays[name]
    write(tmp_path / "a", arrays, header_of(table))
    assert f"columns missing: {name}; unknown: none" in refusal(tmp_path / "a")


@pytest.mark.parametrize("name", LAYOUT)
def test_a_column_of_wrong_type_or_shape_is_refused(tmp_path, make, name):
    table = make([2, 3])
    arrays, path = table.arrays(), tmp_path / "a"
    write(path, {**arrays, name: arrays[name].astype(np.float16)}, header_of(table))
    assert f"column {name} is float16: convert it" in refusal(path)
    write(path, {**arrays, name: arrays[name][None]}, header_of(table))
    assert f"column {name} has {arrays[name].ndim + 1} axes" in refusal(path)


def test_columns_that_are_no_table_are_refused(tmp_path, make):
    table = make([2, 3])
    arrays = table.arrays()
    arrays["r_env"][3] = np.nan
    write(tmp_path / "a", arrays, header_of(table))
    assert "column r_env, row 3: not finite" in refusal(tmp_path / "a")


@pytest.mark.parametrize(
    "changes",
    [
        {"mode_names": None},
        {"mode_names": "egoistic"},
        {"mode_names": [1, 2, 3]},
        {"n_actions": "3"},
        {"n_actions": 3.0},
        {"source": None},
        {"source": []},
    ],
)
def test_a_malformed_header_is_refused(tmp_path, make, changes):
    table = make([2, 3])
    path = tmp_path / "a"
    write(path, table.arrays(), {**header_of(table), **changes})
    assert "lacks mode_names, n_actions or source" in refusal(path)
    (name,) = changes
    write(path, table.arrays(), {k: v for k, v in header_of(table).items() if k != name})
    assert "lacks mode_names, n_actions or source" in refusal(path)


def test_header_values_that_do_not_fit_are_refused(tmp_path, make):
    table = make([2, 3])
    path = tmp_path / "a"
    write(path, table.arrays(), {**header_of(table), "n_actions": True})
    assert "n_actions is True" in refusal(path)
    write(path, table.arrays(), {**header_of(table), "mode_names": []})
    assert "column mode, row 0: outside [0, 0)" in refusal(path)


def test_other_files_are_refused(tmp_path, make):
    table, path = make([2]), tmp_path / "a"
    storage.save_arrays(path, KIND, SCHEMA_VERSION + 2, table.arrays(), header_of(table))
    assert "schema version 3, this program reads version 1 or 2" in refusal(path)
    storage.save_arrays(path, "policy", SCHEMA_VERSION, table.arrays(), header_of(table))
    assert "holds policy, not demonstrations" in refusal(path)
    assert "no such file" in refusal(tmp_path / "missing")
    save(path, table)
    path.write_bytes(path.read_bytes()[:-1])
    assert "damaged" in refusal(path)
