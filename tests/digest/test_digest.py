"""Every table is that of `digest.json`; `python -m tests.digest --make` writes it again."""

from typing import Any

import pytest
from tests.digest.digest import Item, computed, differences
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
