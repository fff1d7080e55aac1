"""List of all items, and the choice among them by name."""

from __future__ import annotations

from collections.abc import Sequence

from tests.digest import (
    audits,
    batches,
    junctions,
    learners,
    pages,
    prints,
    readers,
    rollouts,
    saved,
    studies,
    traces,
)
from tests.digest.digest import Item

ITEMS: list[Item] = [
    *traces.ITEMS,
    *batches.ITEMS,
    *rollouts.ITEMS,
    *junctions.ITEMS,
    *readers.ITEMS,
    *saved.ITEMS,
    *audits.ITEMS,
    *prints.ITEMS,
    *pages.ITEMS,
    *learners.ITEMS,
    *studies.ITEMS,
]


def chosen(names: Sequence[str] = (), quick: bool = False) -> list[Item]:
    """Return the items whose name begins with one of the names; all of them by default."""
    return [
        item
        for item in ITEMS
        if (not names or any(item.name.startswith(name) for name in names))
        and (item.quick or not quick)
    ]
