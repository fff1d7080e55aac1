"""Checks of all options of all commands: none is empty, not text, or a number that no run takes.

The commands' own checks say what a value means; these keep out what nothing could mean.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import one_line

LARGEST_COUNT = 10**9
"""Largest whole number of an option that is no seed."""
LARGEST_SEED = 2**63 - 1
FLOATS = (1e-100, 1e100)
"""Smallest and largest size of a number other than 0."""


def check_words(words: Sequence[str]) -> None:
    """Refuse words of a command line that can't be a value: an empty one, or one that is not text.

    Raises:
        UserError: If there is one.
    """
    for position, word in enumerate(words):
        option, sign, value = word.partition("=")
        if not word:
            of = f" of {one_line(words[position - 1], 80)}" if position else ""
            raise UserError(f"an empty word{of}: give a value, or leave the option out")
        if sign and not value and option.startswith("--"):
            raise UserError(f"{one_line(option, 80)} is empty: give a value, or leave it out")
        if "\0" in word:
            raise UserError(f"'{one_line(word, 80)}' has a zero byte: no name or text has one")
        try:
            word.encode()
        except UnicodeEncodeError:  # bytes that are not UTF-8 became halves of surrogates
            text = one_line(word.encode("utf-8", "replace"), 80)
            raise UserError(
                f"'{text}' is not UTF-8 text: rename the file, or type it again"
            ) from None


def check_options(command: Any) -> None:
    """Refuse numbers of options that no run could take, and lists of values without a value.

    A whole number is at most 10^9, a seed is from 0 to 2^63 - 1, and any other number is finite
    and of a size that arithmetic keeps.

    Args:
        command: A command's object, with its options as fields.

    Raises:
        UserError: If there is one.
    """
    for name, value in _values(command):
        option = f"--{name.replace('_', '-')}"
        if value is None:
            raise UserError(f"{option} has no value: give one, or leave it out")
        if isinstance(value, float):
            low, high = FLOATS
            if not (value == 0.0 or low <= abs(value) <= high):
                raise UserError(
                    f"{option} {value:g}: give 0, or a number of size {low:g} to {high:g}"
                )
            continue
        is_long = abs(value) >= 10**20
        text = f"a number of {int(math.log10(abs(value))) + 1} digits" if is_long else f"{value}"
        if name in ("seed", "seeds"):
            if not 0 <= value <= LARGEST_SEED:
                limit = "at least 0" if value < 0 else "below 2^63"
                raise UserError(f"{option}: seed must be {limit}, got {text}")
        elif abs(value) > LARGEST_COUNT:
            raise UserError(f"{option} {text}: give at most {LARGEST_COUNT:,}")


def refuse_unused(command: Any, names: Sequence[str], owner: str) -> None:
    """Refuse options that were given and have no use: their user expects something else.

    Args:
        command: A command's object.
        names: Names of its fields that need another option.
        owner: That option, as it is written on the command line.

    Raises:
        UserError: If one differs from its default.
    """
    defaults = {field.name: field.default for field in dataclasses.fields(command)}
    for name in names:
        if getattr(command, name) != defaults[name]:
            raise UserError(f"--{name.replace('_', '-')} is of {owner}: add that, or leave it out")


def _values(options: Any) -> Iterator[tuple[str, int | float | None]]:
    """Yield the name and value of each number in the fields of a dataclass, and in those below.

    None stands for the missing value of a list that is not empty by default.
    """
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            yield from _values(value)
        if value == () and isinstance(field.default, tuple) and field.default:
            yield field.name, None
        for number in value if isinstance(value, tuple | list) else (value,):
            if isinstance(number, int | float) and not isinstance(number, bool):
                yield field.name, number
