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
    chosen = module.Options(**options)
    _check_literals(name, chosen)
    return module.make(chosen)


def _check_literals(world: str, options: Any) -> None:
    """Refuse a value that the option's Literal type doesn't list."""
    for option, kind in typing.get_type_hints(type(options)).items():
        value = getattr(options, option)
        allowed = typing.get_args(kind)
        if allowed and value not in allowed:
            raise UserError(
                f"unknown value '{value}' for {option} of {world}: "
                f"choose one of {', '.join(map(str, allowed))}"
            )
