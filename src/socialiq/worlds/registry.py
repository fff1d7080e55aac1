"""Worlds by name."""

from __future__ import annotations

import dataclasses
import typing
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.worlds import crossing5, crossing7, intersection
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.intersection.world import Intersection

WORLDS = {"crossing5": crossing5, "crossing7": crossing7, "intersection": intersection}
GRIDWORLDS = ("crossing5", "crossing7")


def make(name: str, **options: Any) -> GridWorld | Intersection:
    """Build a world by name, with its readings as keyword arguments.

    Args:
        name: One of `WORLDS`.
        options: Fields of that world's `Options`.

    Raises:
        UserError: If the world, an option or an option's value is unknown.
    """
    one_of("world", name, tuple(WORLDS))
    module = WORLDS[name]
    fields = {field.name: field for field in dataclasses.fields(module.Options)}
    for option in options:
        one_of(f"option of {name}", option, tuple(fields))
    kinds = typing.get_type_hints(module.Options)
    for option, value in options.items():
        _check_literal(name, option, value, kinds[option])
    return module.make(module.Options(**options))


def make_grid(name: str, **options: Any) -> GridWorld:
    """Build a gridworld: a world whose states can all be listed.

    Raises:
        UserError: As `make`, and if the world is none.
    """
    if name in WORLDS and name not in GRIDWORLDS:
        raise UserError(
            f"the states of {name} can't be listed, so nothing about it is exact: "
            f"choose one of {', '.join(GRIDWORLDS)}"
        )
    one_of("world", name, GRIDWORLDS)
    world = make(name, **options)
    assert isinstance(world, GridWorld)
    return world


def _check_literal(world: str, option: str, value: Any, kind: Any) -> None:
    """Refuse a value that the option's Literal type doesn't list."""
    allowed = typing.get_args(kind)
    if typing.get_origin(kind) is typing.Literal and value not in allowed:
        raise UserError(
            f"unknown value '{value}' for {option} of {world}: "
            f"choose one of {', '.join(map(str, allowed))}"
        )
