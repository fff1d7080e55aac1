from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from socialiq_recordings.prediction.situations import Situations


def _made(count: int, **columns: Any) -> Situations:
    numbers, flags = np.zeros(count, np.int64), np.zeros(count, bool)
    nowhere, zero = np.full(count, np.inf), np.zeros(count)
    found = Situations(
        recording=numbers,
        vehicle=numbers,
        chain=numbers,
        site=numbers,
        time=np.arange(count, dtype=np.float64),
        speed=np.full(count, 10.0),
        last=zero,
        length=np.full(count, 4.0),
        gap=nowhere,
        leader_speed=zero,
        behind=nowhere,
        behind_speed=zero,
        to_junction=nowhere,
        turn=zero,
        limit=nowhere,
        gives_way=flags,
        to_area=nowhere,
        through=zero,
        merging=flags,
        other_to_area=nowhere,
        other_through=zero,
        other_speed=zero,
        other_gap=nowhere,
        other_leader_speed=zero,
        acceleration=zero,
        driven=np.full(count, np.nan),
    )
    return replace(found, **{name: np.asarray(column) for name, column in columns.items()})


@pytest.fixture
def situations() -> Callable[..., Situations]:
    """Make free moments at 10 m/s, one a second, with other columns as given."""
    return _made
