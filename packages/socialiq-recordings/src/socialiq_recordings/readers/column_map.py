"""Column maps: columns of a CSV file with their quantities, units and frames.

A map is a TOML file, so a new data set needs no code. The package contains maps of some data
sets, by name.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.reading import check_keys, read_toml
from socialiq_recordings.plausible import MeasurementError
from socialiq_recordings.recording import RoadUser

_FOOT = 0.3048
UNITS: dict[str, dict[str, float]] = {
    "position": {"m": 1.0, "ft": _FOOT},
    "velocity": {"m/s": 1.0, "ft/s": _FOOT, "km/h": 1 / 3.6, "mph": 0.44704},
    "size": {"m": 1.0, "ft": _FOOT},
    "heading": {"radians": 1.0, "degrees": math.pi / 180},
    "time": {"s": 1.0, "ms": 1e-3},
}
"""Units by quantity, the default first, with their factors."""

REQUIRED = ("id", "x", "y")
COLUMNS = (
    *(*REQUIRED, "recording", "frame", "time", "heading", "vx", "vy", "speed"),
    *("length", "width", "class"),
)
_SIZES = ("length", "width")
_PER_TRACK = (*_SIZES, "class")
_MAPS = Path(__file__).parent / "column_maps"


@dataclass(frozen=True)
class ColumnMap:
    """Description of a CSV layout."""

    format: str  # name of the layout
    columns: dict[str, str]  # the file's name of a column, by our name of its quantity
    classes: dict[str, RoadUser]  # the file's words for classes
    licence: str = ""  # a line about the data's licence, stored with the recording
    separator: str = ","  # separator of cells
    scales: dict[str, float] = field(default_factory=dict)  # of the file's units, by quantity
    rate: float = 0.0  # frames a second; 0 if `rate_file` has it
    rate_file: tuple[str, str, str] | None = None  # ending of the name, that of this file, column
    any_order: bool = False  # whether the rows of a track may come in any order
    optional: tuple[str, ...] = ()  # columns that some of these files lack
    repeated_ids: bool = False  # whether an id may be reused for another road user, after a gap
    y_down: bool = False  # whether y points down (south) in the file
    point: str = "centre"  # reference point of positions: `centre`, `front` or `corner` of the box
    users_file: tuple[str, str] | None = None  # the same of a file with a row for each track
    users_columns: dict[str, str] = field(default_factory=dict)  # names of that file's columns
    default_class: str = ""  # word of road users that the file gives none; empty: refused
    default_sizes: dict[str, tuple[float, float]] = field(default_factory=dict)  # m, by word
    periods: bool = False  # whether ids and frames begin again; time and frame tell them apart
    origin: tuple[str, str] | None = None  # columns of `rate_file` with UTM coordinates, m
    error: MeasurementError = field(default_factory=MeasurementError)

    def lacking(self, names: Collection[str]) -> list[str]:
        """Return what a file lacks to be read.

        Args:
            names: Our names of the columns that it has.
        """
        both = {*names, *self.users_columns}
        lacks = [name for name in REQUIRED if name not in names]
        if not self.default_sizes:
            lacks += [f"{name} (or [default_sizes])" for name in _SIZES if name not in both]
        if "class" not in both and not self.default_class:
            lacks.append("class (or default_class)")
        if self.periods:
            needs = "(time.periods needs the columns time and frame)"
            lacks += [f"{name} {needs}" for name in ("frame", "time") if name not in names]
        elif "frame" not in names and "time" not in names:
            lacks.append("frame (or time)")
        if ("vx" in names) != ("vy" in names):
            lacks.append("vx and vy, both or none")
        return lacks


def known_maps() -> tuple[str, ...]:
    """Return the names of the maps in the package."""
    return tuple(sorted(path.stem for path in _MAPS.glob("*.toml")))


def read_map(name: str) -> ColumnMap:
    """Read a column map, by the name of one in the package or a path that ends in `.toml`.

    Raises:
        UserError: If there is no such map, or it has an invalid entry.
    """
    path = Path(name)
    if not name.endswith(".toml"):
        one_of("column map (or a file that ends in .toml)", name, known_maps())
        path = _MAPS / f"{name}.toml"
    content = read_toml(path)
    try:
        return _map_of(content, path.stem)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


_TABLES: dict[str, tuple[str, ...]] = {
    "time": ("rate", "rate_file", "rate_column", "order", "repeated_ids", "periods"),
    "columns": COLUMNS,
    "units": tuple(UNITS),
    "axes": ("y", "point"),
    "road_users": ("file", "id", *_PER_TRACK),
    "map": ("origin",),
    "error": tuple(field.name for field in fields(MeasurementError)),
}
"""Keys of each table; those of `classes` and `default_sizes` are the file's words."""


def _map_of(content: dict[str, Any], name: str) -> ColumnMap:
    tables = (*_TABLES, "classes", "default_sizes")
    check_keys(
        "", content, (*tables, "format", "licence", "separator", "optional", "default_class")
    )
    sections: dict[str, dict[str, Any]] = {table: content.get(table, {}) for table in tables}
    for table, section in sections.items():
        if not isinstance(section, dict):
            raise UserError(f"{table} must be a table: write [{table}]")
        check_keys(table, section, _TABLES.get(table, tuple(section)))
    time = sections["time"]
    users = sections["road_users"]
    axes = sections["axes"]
    separator = _choice("separator", content.get("separator", ","), (",", ";", "\t", "|", " "))
    order = _choice("time.order", time.get("order", "ascending"), ("ascending", "any"))
    rate, rate_file = _rate(time)
    if not sections["classes"]:
        raise UserError("[classes] is missing: give the class of each word of the class column")
    kinds = {kind.name.lower(): kind for kind in RoadUser}
    for word, kind in sections["classes"].items():
        one_of(f"class of '{one_line(word, 40)}'", kind, tuple(kinds))
    for quantity, unit in sections["units"].items():
        one_of(f"unit of {quantity}", unit, tuple(UNITS[quantity]))
    names = {n: _text(f"columns.{n}", column) for n, column in sections["columns"].items()}
    column_map = ColumnMap(
        optional=_optional(content.get("optional", []), names),
        format=_text("format", content.get("format", name)),
        licence=_text("licence", content.get("licence", "not stated by the column map")),
        separator=separator,
        columns=names,
        classes={word: kinds[kind] for word, kind in sections["classes"].items()},
        scales={
            quantity: factors[sections["units"].get(quantity, next(iter(factors)))]
            for quantity, factors in UNITS.items()
        },
        rate=rate,
        rate_file=rate_file,
        any_order=order == "any",
        repeated_ids=_choice("time.repeated_ids", time.get("repeated_ids", False), (True, False)),
        y_down=_choice("axes.y", axes.get("y", "up"), ("up", "down")) == "down",
        point=_choice("axes.point", axes.get("point", "centre"), ("centre", "front", "corner")),
        users_file=_endings("road_users.file", users["file"]) if "file" in users else None,
        users_columns={key: _text(key, column) for key, column in users.items() if key != "file"},
        default_class=_default_class(content.get("default_class", ""), sections["classes"]),
        default_sizes=_default_sizes(sections["default_sizes"]),
        periods=_choice("time.periods", time.get("periods", False), (True, False)),
        origin=_endings("map.origin", sections["map"]["origin"]) if sections["map"] else None,
        error=MeasurementError(
            **{key: _number(f"error.{key}", value) for key, value in sections["error"].items()}
        ),
    )
    if lacks := column_map.lacking(names):
        raise UserError(f"[columns] lacks {', '.join(lacks)}")
    if column_map.origin and rate_file is None:
        raise UserError("map.origin needs time.rate_file, the file with these columns")
    if column_map.users_file and "id" not in column_map.users_columns:
        raise UserError(
            "[road_users] has a file but no id: name the column with the track's number"
        )
    return column_map


def _choice(what: str, value: Any, allowed: tuple[Any, ...]) -> Any:
    if value not in allowed or isinstance(value, bool) != isinstance(allowed[0], bool):
        raise UserError(
            f"{what} is {one_line(repr(value), 40)}: choose {allowed[0]!r} or {allowed[1]!r}"
        )
    return value


def _text(what: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise UserError(f"{what} must be a text in quotes")
    return one_line(value)


def _number(what: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise UserError(f"{what} must be a number of at least 0")
    return float(value)


def _endings(what: str, value: Any) -> tuple[str, str]:
    if not isinstance(value, list) or len(value) != 2:
        raise UserError(f"{what} must be a list of two texts")
    return _text(what, value[0]), _text(what, value[1])


def _optional(value: Any, names: dict[str, str]) -> tuple[str, ...]:
    if not (isinstance(value, list) and all(name in names.values() for name in value)):
        raise UserError("optional must be a list of columns that [columns] names")
    return tuple(value)


def _default_class(value: Any, classes: dict[str, Any]) -> str:
    if value:
        one_of("default_class", value, tuple(classes))
    return value or ""


def _rate(time: dict[str, Any]) -> tuple[float, tuple[str, str, str] | None]:
    rate = _number("time.rate, frames a second,", time.get("rate", 0.0))
    if bool(rate) == ("rate_file" in time):
        raise UserError("[time] needs a rate in frames a second, or a rate_file and a rate_column")
    if "rate_file" not in time:
        return rate, None
    column = _text("time.rate_column", time.get("rate_column", ""))
    return rate, (*_endings("time.rate_file", time["rate_file"]), column)


def _default_sizes(sizes: dict[str, Any]) -> dict[str, tuple[float, float]]:
    result = {}
    for word, size in sizes.items():
        what = f"default_sizes.{one_line(word, 40)}"
        numbers = [_number(what, side) for side in size] if isinstance(size, list) else []
        if len(numbers) != 2 or min(numbers) <= 0:
            raise UserError(f"{what} must be [length, width] in metres")
        result[word] = (numbers[0], numbers[1])
    return result
