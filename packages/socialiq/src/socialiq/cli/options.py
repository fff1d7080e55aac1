"""Options of the command line that are made from a config's dataclass, field by field."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
import typing
from typing import Annotated, Any, Literal

import tyro

from socialiq.errors import UserError


@dataclasses.dataclass(frozen=True)
class NoSettings:
    """Config without fields, for a learner that has no such config."""


NO_SETTINGS = NoSettings()


def optional(config: type, *leave_out: str) -> type:
    """Make a dataclass with an optional field for each field of a config; None: not given.

    A nested dataclass becomes optional in the same way. Its field's docstring is an option's help.

    Args:
        config: A dataclass with documented fields.
        leave_out: Fields that are no options.
    """
    hints, helps = typing.get_type_hints(config), _docstrings(config)
    fields = []
    for one in dataclasses.fields(config):
        if one.name in leave_out:
            continue
        kind = hints[one.name]
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            nested = optional(kind)
            fields.append((one.name, nested, dataclasses.field(default_factory=nested)))
        else:
            text, kind = helps.get(one.name, ""), _plain(kind)
            names = typing.get_args(hints[one.name])
            if typing.get_origin(hints[one.name]) is Literal:
                text += f" One of {', '.join(names)}."
            described = Annotated[kind | None, tyro.conf.arg(help=text.strip())]
            fields.append((one.name, described, dataclasses.field(default=None)))
    return dataclasses.make_dataclass(f"{config.__name__}Options", fields, frozen=True)


def overridden(config: Any, *given: Any, **more: Any) -> Any:
    """Return a config with the options that were given laid over it.

    Args:
        config: A dataclass.
        given: Of `optional`, one or several.
        more: Further values.

    Raises:
        UserError: If an option was given that the config doesn't have, or a value is refused.
    """
    changes = dict(more)
    for options, one in ((part, one) for part in given for one in dataclasses.fields(part)):
        value = getattr(options, one.name)
        if dataclasses.is_dataclass(value):
            if any(inner is not None for inner in vars(value).values()):
                changes[one.name] = overridden(getattr(config, one.name, NO_SETTINGS), value)
        elif value is not None:
            changes[one.name] = value
    known = {one.name for one in dataclasses.fields(config)}
    for name in changes.keys() - known:
        raise UserError(f"this learner has no '{name}': leave --{name.replace('_', '-')} out")
    return dataclasses.replace(config, **changes)


def refuse_given(given: Any, owner: str) -> None:
    """Refuse options of another kind of training.

    Args:
        given: Of `optional`.
        owner: What they are of.

    Raises:
        UserError: If one was given.
    """
    for name, value in vars(given).items():
        if value is not None:
            raise UserError(f"--{name.replace('_', '-')} is of {owner}: leave it out")


def _plain(kind: Any) -> Any:
    """Return str for a literal type: the config's own message lists the valid names."""
    return str if typing.get_origin(kind) is Literal else kind


def _docstrings(config: type) -> dict[str, str]:
    """Return the text below each field, inherited ones included."""
    found = {}
    for part in reversed([one for one in config.__mro__ if dataclasses.is_dataclass(one)]):
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(part))).body
        assert isinstance(body, ast.ClassDef)
        for field, after in zip(body.body, body.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                text = getattr(getattr(after, "value", None), "value", None)
                if isinstance(after, ast.Expr) and isinstance(text, str):
                    found[field.target.id] = " ".join(text.split())
    return found
