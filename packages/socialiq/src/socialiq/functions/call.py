"""A command as a function: its options by name, its checks, and its work without printing.

A command's dataclass holds options, defaults, checks and work. The functions fill the same
dataclass, so that a word and its refusal exist once.
"""

from __future__ import annotations

import contextlib
import dataclasses
import typing
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli import commands
from socialiq.cli.main import checked
from socialiq.cli.output import as_function
from socialiq.cli.words import nearest_option
from socialiq.errors import UserError, kinds_of, misfit
from socialiq.foreign import one_line
from socialiq.nn.saved import Saved
from socialiq.types import Policy

Drivers = str | Path | Saved | Policy | Sequence[Any]
"""A driver or several, as text or objects."""


def command_of(name: str, options: Mapping[str, Any]) -> Any:
    """Return a command's object, with options by name.

    Args:
        name: The command.
        options: Values by the name of the option; those of nested groups too. None stands for an
            option that is not given. Numbers and texts may stand for a sequence of one.

    Raises:
        UserError: If the command lacks an option, or a value has another type.
    """
    kind = commands.command_class(name)
    values = {word: value for word, value in options.items() if value is not None}
    known = options_of(kind)
    for word in values:
        if word not in known:
            near = nearest_option(one_line(word, 80).replace("_", "-"), known)
            hint = f"did you mean {near}? " if near else ""
            raise UserError(
                f"{name} has no option {one_line(word, 80)}: {hint}socialiq {name} --help lists "
                "the options"
            )
    return _filled(kind, values)


@contextlib.contextmanager
def called(command: Any) -> Iterator[Any]:
    """Check a command's numbers, and let it work in the block without printing."""
    with as_function(), checked(command):
        yield command


def options_of(kind: Any) -> list[str]:
    """Return the names of a command's options, with those of its groups."""
    names = list[str]()
    hints = typing.get_type_hints(kind)
    for field in dataclasses.fields(kind):
        group = hints[field.name]
        names += options_of(group) if dataclasses.is_dataclass(group) else [field.name]
    return names


def _filled(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return an object of a command or of a group; a required option that is not given is None.

    It may hold objects where the command line has texts, so that its constructor is left out.
    """
    filled = object.__new__(kind)
    hints = typing.get_type_hints(kind)
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        value = None if field.default is dataclasses.MISSING else field.default
        if dataclasses.is_dataclass(hint):
            value = _filled(hint, values)
        elif field.name in values:
            value = _typed(field.name, values[field.name], hint)
        object.__setattr__(filled, field.name, value)
    return filled


def _typed(name: str, value: Any, hint: Any) -> Any:
    """Return a value with the type of an option; objects of a user's are left as they are."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    for kind in kinds_of(hint):
        if typing.get_origin(kind) is tuple:
            items = value if isinstance(value, list | tuple | range) else [value]
            kinds = typing.get_args(kind)
            kinds = kinds[:1] * len(items) if kinds[1:] == (...,) else kinds
            if len(items) != len(kinds):
                raise UserError(f"{name} takes {len(kinds)} values, got {len(items)}")
            return tuple(_typed(name, item, kind) for item, kind in zip(items, kinds, strict=True))
        if kind is Path and isinstance(value, str):
            return Path(value)
        if kind is str and isinstance(value, Path):
            return str(value)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
    is_plain = type(value) in (str, int, float, bool, tuple, list, dict)
    if is_plain and (line := misfit(name, value, hint)):
        raise UserError(line)
    return value
