"""Build a world's options from keyword arguments and check their values."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from socialiq.errors import UserError, one_of

Kind = TypeVar("Kind")


def chosen(world: str, kind: type[Kind], given: Mapping[str, Any]) -> Kind:
    """Build a world's options.

    Args:
        world: Its name.
        kind: Its dataclass of options.
        given: Values by name of the field; the others keep their defaults.

    Raises:
        UserError: If a field is unknown, or a value that its Literal type doesn't list.
    """
    fields = tuple(field.name for field in dataclasses.fields(kind))  # pyright: ignore[reportArgumentType]
    for option in given:
        one_of(f"option of {world}", option, fields)
    kinds = typing.get_type_hints(kind)
    for option, value in given.items():
        _check_literal(world, option, value, kinds[option])
    return kind(**given)


def _check_literal(world: str, option: str, value: Any, kind: Any) -> None:
    """Refuse a value that the option's Literal type doesn't list."""
    allowed = typing.get_args(kind)
    if typing.get_origin(kind) is typing.Literal and value not in allowed:
        raise UserError(
            f"unknown value '{value}' for {option} of {world}: "
            f"choose one of {', '.join(map(str, allowed))}"
        )
