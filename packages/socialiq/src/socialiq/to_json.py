"""Plain JSON data from any result: exact for reports, rounded for tables and printed objects."""

from __future__ import annotations

import dataclasses
import datetime
import enum
import math
from collections.abc import Callable, Mapping
from pathlib import PurePath
from typing import Any

DECIMALS = 6  # of a rounded number


def to_json(value: Any) -> Any:
    """Turn dataclasses, named tuples, enumerations and arrays into data for `json.dumps`.

    A dataclass or a named tuple becomes an object of its fields. Bytes are left out. A number that
    is not finite (an unbounded interval) becomes null, since JSON has no other word for it.
    """
    return _converted(value, lambda number: number if math.isfinite(number) else None, by_name=True)


def rounded(value: Any) -> Any:
    """Turn rows and summaries into data for `json.dumps` and CSV, rounded to `DECIMALS`.

    A named tuple becomes an array. A number that is not finite becomes its name.
    """
    return _converted(value, _rounded_float, by_name=False)


def _rounded_float(number: float) -> float | str:
    return round(number, DECIMALS) + 0.0 if math.isfinite(number) else str(number)


def _converted(value: Any, of_float: Callable[[float], Any], by_name: bool) -> Any:
    if isinstance(value, enum.Enum):
        return value.value
    if value is None or isinstance(value, bool | str | int):
        return value
    if hasattr(value, "tolist"):  # arrays and scalars of NumPy and JAX
        return _converted(value.tolist(), of_float, by_name)
    if isinstance(value, float):
        return of_float(value)
    if isinstance(value, datetime.date):
        return value.isoformat()
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, Mapping):
        return {str(name): _converted(entry, of_float, by_name) for name, entry in value.items()}
    pairs = None
    if by_name and isinstance(value, tuple) and hasattr(value, "_asdict"):
        pairs = value._asdict()  # pyright: ignore[reportAttributeAccessIssue]
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        pairs = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if pairs is not None:
        return {
            name: _converted(entry, of_float, by_name)
            for name, entry in pairs.items()
            if not isinstance(entry, bytes)
        }
    if isinstance(value, tuple | list):
        return [_converted(entry, of_float, by_name) for entry in value]
    raise TypeError(f"{type(value).__name__} has no plain form")
