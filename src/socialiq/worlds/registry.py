"""Worlds by name."""

from __future__ import annotations

import dataclasses
import typing
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.worlds import crossing5, crossing7
from socialiq.worlds.grid_world import GridWorld

WORLDS = {"crossing5": crossing5, "crossing7": crossing7}


def make(name: str, **options: Any) -> GridWorld:
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


def _check_literal(world: str, option: str, value: Any, kind: Any) -> None:
    """Refuse a value that the option's Literal type doesn't list."""
    allowed = typing.get_args(kind)
    if allowed and value not in allowed:
        raise UserError(
            f"unknown value '{value}' for {option} of {world}: "
            f"choose one of {', '.join(map(str, allowed))}"
        )
