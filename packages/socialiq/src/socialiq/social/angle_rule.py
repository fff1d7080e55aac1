"""Angle that depends on the situation: a short list of rules over named features.

A rule is data, never code: the first case whose conditions all hold gives the angle, and a default
where none does. An angle is a number, or linear between given values of one feature. The features
of each world are in `worlds.situation`.
"""

from __future__ import annotations

import itertools
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import read_bytes

FORMAT = 1

MOST_CASES = 8  # of a rule, the default not counted
MOST_CONDITIONS = 8  # of a case
MOST_POINTS = 16  # of an interpolated angle
LARGEST = 1e6  # number of a condition, either sign
_LARGEST_FILE = 16 * 1024  # bytes; a rule is a short text
_NAME = re.compile("[a-z][a-z0-9_]{0,39}")
_TOP = ("format", "world", "default", "when")


class Interpolated(NamedTuple):
    """Angle that is linear between given values of a feature, and constant beyond them."""

    by: str  # name of the feature
    at: tuple[float, ...]  # values of the feature, rising
    degrees: tuple[float, ...]  # angle at each of them, in degrees


Angle = float | Interpolated


class Condition(NamedTuple):
    """Limits of a feature, both included; infinite where there is none."""

    feature: str
    at_least: float
    at_most: float


class Case(NamedTuple):
    """Angle where all conditions hold."""

    angle: Angle
    conditions: tuple[Condition, ...]


Features = Mapping[str, Float64[np.ndarray, " row"]]


@dataclass(frozen=True)
class AngleRule:
    """Angle as a function of the observation."""

    world: str  # name of the world whose features it reads
    default: Angle  # angle where no case holds, in degrees
    cases: tuple[Case, ...] = ()  # cases in their order: the first that holds counts

    @property
    def angles(self) -> tuple[Angle, ...]:
        """Angle of each context: the cases, then the default."""
        return (*(case.angle for case in self.cases), self.default)

    @property
    def contexts(self) -> tuple[str, ...]:
        """Each context in words: the cases, then the default."""
        contexts = []
        for case in self.cases:
            limits = []
            for feature, low, high in case.conditions:
                least = f"{low:g} <= " if math.isfinite(low) else ""
                most = f" <= {high:g}" if math.isfinite(high) else ""
                is_value = low == high
                limits.append(f"{feature} = {low:g}" if is_value else f"{least}{feature}{most}")
            contexts.append(" and ".join(limits))
        return (*contexts, "otherwise" if self.cases else "always")

    @property
    def words(self) -> str:
        """The rule in one line, angles in degrees."""
        pairs = zip(self.angles, self.contexts, strict=True)
        return "; ".join(f"{angle_words(angle)} where {where}" for angle, where in pairs).replace(
            "where otherwise", "otherwise"
        )

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features that it reads, each once."""
        names = [condition.feature for case in self.cases for condition in case.conditions]
        names += [angle.by for angle in self.angles if isinstance(angle, Interpolated)]
        return tuple(dict.fromkeys(names))

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest angle, in degrees."""
        every = [
            value
            for angle in self.angles
            for value in (angle.degrees if isinstance(angle, Interpolated) else (angle,))
        ]
        return min(every), max(every)

    def is_within(self, width: float, angle: float) -> bool:
        """Whether its angles are no further apart than a width, and hold an angle; in degrees.

        Args:
            width: The width.
            angle: The angle.
        """
        low, high = self.span
        return high - low <= width and low <= angle <= high

    def context(self, features: Features, rows: int) -> Int64[np.ndarray, " row"]:
        """Return the number of the context of each situation.

        Args:
            features: Values of each feature, by name.
            rows: Number of situations.

        Returns:
            The index of the first case whose conditions hold; the number of cases for the default.
        """
        contexts = np.full(rows, len(self.cases))
        for number, case in reversed(list(enumerate(self.cases))):
            holds = np.ones(rows, bool)
            for condition in case.conditions:
                value = features[condition.feature]
                holds &= (value >= condition.at_least) & (value <= condition.at_most)
            contexts[holds] = number
        return contexts

    def degrees(self, features: Features, rows: int) -> Float64[np.ndarray, " row"]:
        """Return the angle of each situation, in degrees.

        Args:
            features: Values of each feature, by name.
            rows: Number of situations.
        """
        context = self.context(features, rows)
        degrees = np.empty(rows)
        for number, angle in enumerate(self.angles):
            where = context == number
            if isinstance(angle, Interpolated):
                degrees[where] = np.interp(features[angle.by][where], angle.at, angle.degrees)
            else:
                degrees[where] = angle
        return degrees

    def as_json(self) -> dict[str, Any]:
        """Return the rule as TOML holds it: `of` reads it back."""
        when = []
        for case in self.cases:
            when.append({"angle": _angle_as_json(case.angle)})
            for feature, low, high in case.conditions:
                limits = {"at_least": low, "at_most": high}
                finite = {name: limit for name, limit in limits.items() if math.isfinite(limit)}
                when[-1][feature] = finite
        content = {"format": FORMAT, "world": self.world, "default": _angle_as_json(self.default)}
        return content | ({"when": when} if when else {})

    def as_toml(self, table: str = "") -> str:
        """Return the rule as TOML, below a table of this name or on the top level."""
        content = self.as_json()
        when = content.pop("when", [])
        prefix = f"{table}." if table else ""
        lines = [f"[{table}]"] if table else []
        lines += [f"{name} = {_toml(value)}" for name, value in content.items()]
        for case in when:
            lines += ["", f"[[{prefix}when]]"]
            lines += [f"{name} = {_toml(value)}" for name, value in case.items()]
        return "\n".join(lines) + "\n"

    @staticmethod
    def of(content: Any) -> AngleRule:
        """Read a rule from the content of a TOML file or of a header.

        Raises:
            UserError: If a part is missing, unknown or out of range.
        """
        if not isinstance(content, Mapping):
            raise UserError("a rule is a table with format, world, default and [[when]]")
        for name in content:
            if name not in _TOP:
                raise UserError(
                    f"unknown field {_shown(name)} of a rule: choose one of {', '.join(_TOP)}"
                )
        if type(content.get("format")) is not int or content["format"] != FORMAT:
            raise UserError(f"a rule needs format = {FORMAT}")
        world = content.get("world")
        if not isinstance(world, str) or not _NAME.fullmatch(world):
            raise UserError('a rule needs the name of its world, as world = "intersection"')
        if "default" not in content:
            raise UserError("a rule needs a default: the angle where no [[when]] holds, in degrees")
        when = content.get("when", [])
        if not isinstance(when, list) or len(when) > MOST_CASES:
            raise UserError(f"[[when]] must be a list of at most {MOST_CASES} cases")
        cases = tuple(_case(case, number) for number, case in enumerate(when, 1))
        return AngleRule(world, _angle(content["default"], "default"), cases)


def load_rule(path: Path) -> AngleRule:
    """Read a rule from a TOML file of at most 16 KiB.

    Raises:
        UserError: If the file is missing, not TOML or not a rule; the message names the file.
    """
    content = read_bytes(path, _LARGEST_FILE)
    try:
        content_of_file = tomllib.loads(content.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise UserError(f"{path} is not TOML: {one_line(str(error))}") from error
    try:
        return AngleRule.of(content_of_file)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def _case(content: Any, number: int) -> Case:
    what = f"case {number} of [[when]]"
    if not isinstance(content, Mapping):
        raise UserError(f"{what} must be a table")
    if "angle" not in content:
        raise UserError(f"{what} needs an angle, in degrees")
    limits = {name: limit for name, limit in content.items() if name != "angle"}
    if not 1 <= len(limits) <= MOST_CONDITIONS:
        raise UserError(
            f"{what} needs 1 to {MOST_CONDITIONS} conditions, as waiting = {{at_least = 1}}"
        )
    conditions = []
    for name, fields in limits.items():
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise UserError(f"{_shown(name)} in {what} is not the name of a feature")
        bounds = ("at_least", "at_most")
        if not isinstance(fields, Mapping) or not fields or not set(fields) <= set(bounds):
            raise UserError(f"{name} in {what} must be a table with at_least, at_most or both")
        ends = {"at_least": -math.inf, "at_most": math.inf}
        for side, limit in fields.items():
            ends[side] = _number(limit, f"{side} of {name} in {what}")
        if ends["at_least"] > ends["at_most"]:
            raise UserError(f"{name} in {what} never holds: at_least is above at_most")
        conditions.append(Condition(name, **ends))
    return Case(_angle(content["angle"], f"angle of {what}"), tuple(conditions))


def _angle(value: Any, what: str) -> Angle:
    """Read a number of degrees, or an interpolated angle."""
    if not isinstance(value, Mapping):
        return _degrees(value, what)
    if set(value) != {"by", "at", "degrees"}:
        raise UserError(
            f"{what} must be a number of degrees, or a table with by (a feature), at and degrees"
        )
    by = value["by"]
    lists = value["at"], value["degrees"]
    if not isinstance(by, str) or not _NAME.fullmatch(by):
        raise UserError(f"by of {what} is not the name of a feature")
    sizes = [len(column) if isinstance(column, list | tuple) else 0 for column in lists]
    if sizes[0] != sizes[1] or not 2 <= sizes[0] <= MOST_POINTS:
        raise UserError(f"at and degrees of {what} must be lists of 2 to {MOST_POINTS}, as long")
    at = tuple(_number(number, f"at of {what}") for number in lists[0])
    if any(after <= before for before, after in itertools.pairwise(at)):
        raise UserError(f"at of {what} must rise")
    return Interpolated(
        by, at, tuple(_degrees(number, f"degrees of {what}") for number in lists[1])
    )


def _degrees(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 360:
        raise UserError(f"{what} must be a number of degrees in [0, 360), got {_shown(value)}")
    return float(value)


def _number(value: Any, what: str) -> float:
    plain = not isinstance(value, bool) and isinstance(value, int | float)
    if not plain or not -LARGEST <= value <= LARGEST:  # NaN compares false
        raise UserError(
            f"{what} must be a number within plus or minus {LARGEST:g}, got {_shown(value)}"
        )
    return float(value)


def _shown(value: Any) -> str:
    if isinstance(value, Mapping | Sequence) and not isinstance(value, str):
        return "a table" if isinstance(value, Mapping) else "a list"
    if isinstance(value, int) and abs(value) > 10**15:
        return "a huge number"
    return one_line(str(value), 60)


def angle_words(angle: Angle) -> str:
    """Return an angle in words, in degrees."""
    if not isinstance(angle, Interpolated):
        return f"{angle:g}"
    points = ", ".join(f"{d:g} at {a:g}" for a, d in zip(angle.at, angle.degrees, strict=True))
    return f"by {angle.by}: {points}"


def _angle_as_json(angle: Angle) -> Any:
    if isinstance(angle, Interpolated):
        return {"by": angle.by, "at": list(angle.at), "degrees": list(angle.degrees)}
    return angle


def _toml(value: Any) -> str:
    """Return a value of `as_json` on one line of TOML."""
    if isinstance(value, dict):
        inside = ", ".join(f"{name} = {_toml(entry)}" for name, entry in value.items())
        return f"{{{inside}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
