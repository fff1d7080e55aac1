"""Kinds of options of a road: agents, actions, people, side and drivers, in any combination.

A kind is a dataclass whose bases are the parts and the options of the plain road. Some have names
of their own (`FleetOptions`); the others are made here when they are first asked for.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from socialiq.errors import UserError
from socialiq.worlds.highway.options import (
    AgentOptions,
    ControlOptions,
    ObservationOptions,
    RoadOptions,
    SideOptions,
    TrafficOptions,
)
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.road_users import ROAD_USERS

PARTS: dict[type[Any], frozenset[str]] = {
    ControlOptions: frozenset({"actions"}),
    AgentOptions: frozenset({"agents"}),
    PeopleOptions: frozenset(user.rate for user in ROAD_USERS),
    SideOptions: frozenset({"left_hand"}),
    ObservationOptions: frozenset({"observation", "see_behind"}),
    TrafficOptions: frozenset(field.name for field in dataclasses.fields(TrafficOptions)),
}
"""Parts that the options of a road may have, with the options that ask for each."""


def parts_of(options: Iterable[str]) -> tuple[type[Any], ...]:
    """Return the parts that options ask for, by their names."""
    given = frozenset(options)
    return tuple(part for part, names in PARTS.items() if names & given)


@functools.cache
def kind_with(plain: type[RoadOptions], parts: tuple[type[Any], ...]) -> type[Any]:
    """Return the options of a road with parts.

    Args:
        plain: Options of the road without them; it may have some already.
        parts: Some of `PARTS`, in their order.
    """
    parts = tuple(part for part in parts if not issubclass(plain, part))
    if not parts:
        return plain
    named = {
        kind.__bases__[0]: kind
        for kind in plain.__subclasses__()
        if kind.__bases__[1:] == (plain,) and kind.__module__ != __name__
    }
    # A part comes before the plain options, whose properties it replaces.
    bases = tuple(part for part in parts if part not in named)
    bases += tuple(named[part] for part in parts if part in named) or (plain,)
    if len(bases) == 1:
        return bases[0]
    for kind in bases[0].__subclasses__():
        if kind.__bases__ == bases:
            return kind
    name = "".join(part.__name__.removesuffix("Options") for part in parts) + plain.__name__

    def reduced(options: Any) -> tuple[Any, ...]:
        return _with_values, (plain, parts, vars(options))

    # Pickled by its parts: a class that is made here has no name in a module.
    body = {"__doc__": f"Options of a road: {name}.", "__reduce__": reduced, "__module__": __name__}
    return dataclass(frozen=True)(type(name, bases, body))


def refuse_incomplete(kind: type[RoadOptions], values: Iterable[str]) -> None:
    """Refuse options whose part is missing, by naming the word that brings it.

    Args:
        kind: Kind of the options of a road.
        values: Names of options.

    Raises:
        UserError: If an option is one of people, agents or control, and the kind lacks it.
    """
    words: dict[type[Any], str] = {
        PeopleOptions: "people=0.1",
        AgentOptions: "agents=2",
        ControlOptions: "control=continuous",
    }
    known = {field.name for field in dataclasses.fields(kind)}
    needs = {field.name: words[part] for part in words for field in dataclasses.fields(part)}
    for key in values:
        if key in needs.keys() - known:
            raise UserError(f"{key} needs {needs[key]}: add that, or leave {key} out")


def changed_options(options: RoadOptions, changes: Mapping[str, Any]) -> Any:
    """Return the options with other values, and with the parts that these ask for.

    Args:
        options: Options of a road.
        changes: Values by name.

    Raises:
        UserError: If a value is not supported.
    """
    asked = parts_of(changes)
    if all(isinstance(options, part) for part in asked):
        return dataclasses.replace(options, **changes)
    parts = tuple(part for part in PARTS if part in asked or isinstance(options, part))
    kinds = [kind for kind in type(options).__mro__ if issubclass(kind, RoadOptions)]
    plain = next(kind for kind in kinds if kind.__module__ != __name__)
    return kind_with(plain, parts)(**{**vars(options), **changes})


def _with_values(
    plain: type[RoadOptions], parts: tuple[type[Any], ...], values: Mapping[str, Any]
) -> Any:
    return kind_with(plain, parts)(**values)
