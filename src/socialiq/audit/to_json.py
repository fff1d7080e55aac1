"""Any result of the audit as plain JSON-able data."""

from __future__ import annotations

import dataclasses
import datetime
import enum
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def as_json(value: Any) -> Any:
    """Turn dataclasses, named tuples, enumerations and arrays into what `json.dumps` takes.

    A dataclass becomes an object of its fields, bytes are left out, and a number that is not
    finite (an unbounded interval) becomes null, since JSON has no other word for it.

    Raises:
        TypeError: If there is anything else in it.
    """
    if value is None or isinstance(value, bool | str):
        return value.value if isinstance(value, enum.Enum) else value
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, np.generic | np.ndarray):
        return as_json(value.tolist())
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, datetime.date):
        return value.isoformat()
    if isinstance(value, Mapping):
        return {str(name): as_json(one) for name, one in value.items()}
    pairs = _fields(value)
    if pairs is not None:
        return {name: as_json(one) for name, one in pairs.items() if not isinstance(one, bytes)}
    if isinstance(value, tuple | list):
        return [as_json(one) for one in value]
    raise TypeError(f"{type(value).__name__} has no plain form")


def _fields(value: Any) -> dict[str, Any] | None:
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return value._asdict()  # pyright: ignore[reportAttributeAccessIssue]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {one.name: getattr(value, one.name) for one in dataclasses.fields(value)}
    return None
