import datetime
import enum
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from socialiq.to_json import to_json


class Kind(enum.Enum):
    ONE = "one"


class Text(enum.StrEnum):
    A = "a"


class Pair(NamedTuple):
    x: float
    y: object


@dataclass(frozen=True)
class Row:
    pair: Pair
    source: bytes


@pytest.mark.parametrize(
    ("value", "plain"),
    [
        (Kind.ONE, "one"),
        (Text.A, "a"),
        (math.inf, None),
        (np.float64(1.5), 1.5),
        (np.arange(3), [0, 1, 2]),
        (np.bool_(True), True),
        (datetime.date(2026, 1, 31), "2026-01-31"),
        (Row(Pair(math.nan, (1, None)), b"x"), {"pair": {"x": None, "y": [1, None]}}),
        ({1: Kind.ONE}, {"1": "one"}),
        ((Path("a/b"), Pair(1.5, Path("c"))), ["a/b", {"x": 1.5, "y": "c"}]),
    ],
)
def test_anything_has_a_plain_form(value, plain):
    found = to_json(value)
    assert found == plain and type(found) is type(plain)


def test_what_has_none_is_refused():
    with pytest.raises(TypeError, match="object has no plain form"):
        to_json([object()])
