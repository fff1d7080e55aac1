"""A command as a function: its options by name, its checks, and its work without printing.

A command's dataclass holds options, defaults, checks and work. The functions fill the same
dataclass, so that a word and its refusal exist once.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.cli import commands
from socialiq.cli.data import count_rows
from socialiq.cli.main import checked
from socialiq.cli.output import Policies, Result, as_function, filled, is_number
from socialiq.cli.words import nearest_option
from socialiq.errors import UserError, kinds_of, misfit
from socialiq.foreign import one_line
from socialiq.nn.saved import Saved
from socialiq.outputs import refuse_existing
from socialiq.reading import path_of
from socialiq.types import Policy, Row
from socialiq.worlds.grammar import text_of
from socialiq.worlds.world import World

Drivers = str | Path | Saved | Policy | Policies | Sequence[Any]
"""A driver or several, as text or objects; or those of a training."""
Worlds = str | World | Sequence[str | World]
"""A world or several, as text or objects."""
Angles = float | Sequence[float] | Sequence[int] | None
"""An angle in degrees or several; None is the command's default."""
Seeds = int | Sequence[int]
"""A seed or several."""


class _Value(NamedTuple):
    """Value of an option, one of several."""

    option: str
    value: Any
    word: str  # in the names of outputs
    cells: Row  # in the table


def over(
    name: str,
    options: Mapping[str, Any],
    key: str,
    columns: Mapping[str, str],
    work: Callable[[Any], Any] = lambda command: command.result(),
) -> Any:
    """Return what a command returns, or a table of it for every combination of several values.

    Args:
        name: The command.
        options: Its options by name, as for `command_of`. A path `out` gets the values of each call
            as words before its ending.
        key: Name of the rows in the numbers of the table.
        columns: Options that may be sequences, and the column of their values; "" for drivers,
            which the command takes together, except that each policy of a training is a value
            with the columns `trained_angle`, `strength` and `training_seed`.
        work: What the command does; it returns a `Result` or demonstrations.

    Raises:
        UserError: If a sequence is empty, an output exists, or a call is refused.
    """
    several = [_values(option, options[option], column) for option, column in columns.items()]
    combinations = [*itertools.product(*filter(None, several))]
    commands = []
    for values in combinations:
        call = {**options, **{value.option: value.value for value in values}}
        if isinstance(call.get("world"), World):
            call["world"] = text_of(call["world"])
        if values and call.get("out") is not None:
            out = path_of(call["out"])
            words = "-".join([out.stem, *(value.word for value in values)])
            out = out.with_name(words + out.suffix)
            if not call.get("replace") and out.parent.exists():
                refuse_existing(out, out.suffix)
            call["out"] = out
        commands.append(command_of(name, call))
    outcomes = []
    for command in commands:
        with called(command):
            outcomes.append(work(command))
    return _joined(key, combinations, outcomes) if any(several) else outcomes[0]


def _joined(key: str, combinations: Sequence[Sequence[_Value]], outcomes: Sequence[Any]) -> Result:
    """Return the table of several calls; its repr leaves out intervals and constant texts."""
    table = list[Row]()
    labels = dict[str, None]()
    for values, outcome in zip(combinations, outcomes, strict=True):
        cells = dict[str, Any]()
        for value in values:
            cells |= value.cells
        is_result = isinstance(outcome, Result)
        rows = outcome.table if is_result else count_rows(outcome)
        # A trained policy has its seed and angle in the place of a name.
        named = ("policy",) if "training_seed" in cells else ()
        table += [cells | {k: v for k, v in row.items() if k not in named} for row in rows]
        columns = [*cells, *(outcome.labels if is_result else ("mode",))]
        labels |= dict.fromkeys(column for column in columns if column not in named)
    table = filled(table)
    labels = [column for column in labels if "seed" not in column]
    of_command = outcomes[0].rows[0] if isinstance(outcomes[0], Result) else {}
    if len(of_command.keys() & table[0].keys()) < 2:  # it prints a row for each number
        of_command = table[0]
    constants = [
        name
        for name, cell in table[0].items()
        if not is_number(cell) and all(row[name] == cell for row in table)
    ]
    printed = [
        name
        for name in table[0]
        if name in (*of_command, *labels, "seed", "training_seed")
        and name not in constants
        and not name.endswith(("_low", "_high"))
    ]
    rows = [{name: row[name] for name in printed} for row in table]
    title = ", ".join(f"{name} {table[0][name]}" for name in constants if table[0][name] != "")
    return Result({key: table}, rows, title, table, labels, outcomes)


def _values(option: str, value: Any, column: str) -> list[_Value]:
    """Return the values of a sequence or of a training; none if there is only one value."""
    if isinstance(value, Policies):
        renamed = {"angle": "trained_angle", "strength": "strength", "seed": "training_seed"}
        cells = [{renamed[k]: row[k] for k in renamed if k in row} for row in value.table]
        return [
            _Value(option, policy, f"{option}{run}", cells[run])
            for run, policy in enumerate(value.trained)
        ]
    if not isinstance(value, list | tuple | range | np.ndarray):
        return []
    if len(value) == 0:
        raise UserError(f"{option} is empty: give at least one value")
    if not column:
        return []
    values = []
    for position, content in enumerate(value):
        content = text_of(content) if isinstance(content, World) else content
        content = content.item() if isinstance(content, np.generic) else content
        word = f"{option}{content:g}" if is_number(content) else f"{option}{position}"
        is_plain = isinstance(content, str | Path) or is_number(content)
        cell = (str(content) if isinstance(content, Path) else content) if is_plain else position
        values.append(_Value(option, content, word, {column: cell}))
    return values


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
