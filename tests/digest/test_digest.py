"""Every table is that of `digest.json`; `python -m tests.digest --make` writes it again."""

from typing import Any

import numpy as np
import pytest
from tests.digest.digest import Item, computed, differences, equal, of_arrays, of_plain
from tests.digest.items import ITEMS
from tests.digest.studies import COMPARED_BESIDE_THEIR_TESTS

pytestmark = [
    pytest.mark.usefixtures("as_a_user_runs_it"),
    pytest.mark.filterwarnings("ignore"),  # of Gymnasium and of libraries, as in a user's process
]


def parameter(item: Item) -> Any:
    """Return an item as a parameter; `make test` has no extras, so it leaves out what needs one."""
    in_make_test = item.quick and not item.needs
    return pytest.param(item, id=item.name, marks=[] if in_make_test else pytest.mark.slow)


@pytest.mark.parametrize(
    "item", [parameter(item) for item in ITEMS if item.name not in COMPARED_BESIDE_THEIR_TESTS]
)
def test_no_table_differs(item: Item) -> None:
    if item.missing:
        pytest.skip(f"needs {', '.join(item.missing)}")
    hashes, skipped, failed = computed([item])
    assert list(differences([item], hashes, skipped, failed)) == []


def entry(weight: float, name: str = "loss", row: int = 7) -> str:
    weights = np.random.default_rng(0).normal(size=1_000).astype(np.float32)
    weights[10] *= weight
    return of_plain([of_arrays({"weights": weights}), {name: 0.25, "row": row}])


def test_a_sketch_passes_rounding_and_fails_a_changed_number() -> None:
    assert equal(entry(1.0), entry(1.0 + 1e-6))
    assert not equal(entry(1.0), entry(1.01))
    assert not equal(entry(1.0), entry(1.0, name="other"))
    assert not equal(entry(1.0), entry(1.0, row=8))


@pytest.mark.parametrize("number", [0.0, 1e-7, 0.3, 1e9])
def test_a_number_that_becomes_infinite_differs(number: float) -> None:
    finite = of_plain([number])
    assert not equal(finite, of_plain([float("inf")]))
    assert not equal(finite, of_plain([number, number]))
    assert equal(finite, of_plain([number * (1.0 + 1e-9)]))
