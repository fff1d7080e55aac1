"""Settings: fields of frozen dataclasses, changed by name.

A value comes from the command line (text) or from a TOML file (a TOML value), and gets the type of
the field. A dot in a name reaches into a field that is itself a dataclass.
"""

from __future__ import annotations

import dataclasses
import tomllib
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.types import Row

ConfigType = TypeVar("ConfigType")


def changed(config: ConfigType, values: Mapping[str, Any]) -> ConfigType:
    """Return a frozen dataclass with other values by field.

    Args:
        config: The dataclass.
        values: Values by name of the field, of the field's type or as text. A field of a dataclass
            below is named with a dot, or by a mapping in its place; so is a key of a mapping.

    Returns:
        A new dataclass; every field that is not named keeps its value.

    Raises:
        UserError: If a name is not a field, or a value doesn't fit the field's type.
    """
    current: Any = config
    try:
        kinds = typing.get_type_hints(type(current))
    except NameError:  # of a class of the user's own whose types are not global
        kinds = {}
    names = [field.name for field in dataclasses.fields(current)]
    changes = {}
    for name, value in values.items():
        first, _, below = name.partition(".")
        if first not in names:
            raise UserError(f"there is no setting {first}: choose one of {', '.join(names)}")
        before = changes.get(first, getattr(current, first))
        is_mapping = isinstance(before, Mapping)
        if is_mapping or dataclasses.is_dataclass(before):
            inner = {below: value} if below else value
            if not isinstance(inner, Mapping):
                below_names = [] if is_mapping else [name for name, _ in _leaves(before)]
                names_below = ", ".join(f"{first}.{name}" for name in below_names or ["KEY=VALUE"])
                raise UserError(f"{first} has settings of its own: choose one of {names_below}")
            changes[first] = {**before, **inner} if is_mapping else changed(before, inner)
        elif below:
            raise UserError(f"there is no setting {name}: {first} has no settings of its own")
        else:
            changes[first] = typed(value, kinds.get(first, type(before)), first)
    return dataclasses.replace(current, **changes)


def laid_over(
    configs: Sequence[Any], values: Mapping[str, Any], hidden: Sequence[str] = ()
) -> list[Any]:
    """Return configurations with values laid over them, each in the one that has the setting.

    Args:
        configs: Frozen dataclasses; of a setting that several have, the first is changed.
        values: Values by name. The name of a field below needs no dot if no other has it.
        hidden: Settings that the list of known ones leaves out.
    """
    owners: dict[str, int] = {}
    for number, config in enumerate(configs):
        for name, _ in _leaves(config):
            owners.setdefault(name, number)
    changes: list[dict[str, Any]] = [{} for _ in configs]
    for name, value in values.items():
        full = [name] if name in owners else [key for key in owners if key.endswith(f".{name}")]
        if len(full) != 1:
            choices = ", ".join(sorted(owners.keys() - {*hidden}))
            raise UserError(f"there is no setting {one_line(name, 80)}: choose one of {choices}")
        changes[owners[full[0]]][full[0]] = value
    return [changed(config, change) for config, change in zip(configs, changes, strict=True)]


def _leaves(config: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the name and value of each setting, those of dataclasses below with a dot."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from _leaves(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, value


def assignments(words: Sequence[str]) -> dict[str, str]:
    """Return the values of KEY=VALUE by key; `UserError` for a word of another form."""
    values = {}
    for word in words:
        name, sign, value = word.partition("=")
        if not sign or not name:
            raise UserError(f"--set takes KEY=VALUE, got {word!r}")
        values[name.replace("-", "_")] = value
    return values


def described(config: Any) -> list[Row]:
    """Return name and value of each setting, fields of dataclasses below with a dot."""
    return [{"setting": name, "value": _text(value)} for name, value in _leaves(config)]


def _text(value: Any) -> str:
    """Return a value as `--set` takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        texts = [_text(item) for item in value]
        if any("," in text for text in texts) or not texts:
            return "[" + ", ".join(f"'{text}'" for text in texts) + "]"
        return ",".join(texts)
    return f"{value:g}" if isinstance(value, float) else str(value)


def typed(value: Any, kind: Any, name: str) -> Any:
    """Return a value with the type of its field."""
    origin = typing.get_origin(kind)
    arguments = typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        if value is None or str(value).lower() == "none":
            return None
        return typed(value, next(kind for kind in arguments if kind is not type(None)), name)
    if origin is tuple:
        items = _items(value, name)
        kinds = [arguments[0]] * len(items) if arguments[1:] == (...,) else arguments
        if len(items) != len(kinds):
            raise UserError(f"{name} takes {len(kinds)} values, got {len(items)}")
        return tuple(typed(item, kind, name) for item, kind in zip(items, kinds, strict=True))
    if origin is typing.Literal:
        one_of(name, value, arguments)
        return value
    if kind is bool:
        one_of(name, str(value).lower(), ("true", "false"))
        return str(value).lower() == "true"
    if kind in (int, float) and not isinstance(value, bool):
        try:
            if isinstance(value, str) and not value.isascii():
                raise ValueError  # Python reads digits of other scripts.
            return kind(value.replace("_", "") if isinstance(value, str) else value)
        except (ValueError, TypeError):
            word = "an integer" if kind is int else "a number"
            raise UserError(f"{name} must be {word}, got {value!r}") from None
    if kind in (str, Path) and isinstance(value, str):
        return kind(value)
    if kind is Any:
        return value
    raise UserError(f"{name} must be of the kind {getattr(kind, '__name__', kind)}, got {value!r}")


def _items(value: Any, name: str) -> Sequence[Any]:
    """Return the items of a list: of TOML, or text with commas; [...] may hold quoted commas."""
    if not isinstance(value, str):
        if not isinstance(value, Sequence):
            raise UserError(f"{name} must be a list, got {value!r}")
        return value
    if value.startswith("["):
        try:
            return tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            raise UserError(f"{name} must be a list such as ['a', 'b'], got {value}") from None
    return [item.strip() for item in value.split(",")] if value else []


def parse_options(world: str, kind: type[ConfigType], values: Mapping[str, Any]) -> ConfigType:
    """Return a world's options, of a dataclass, from values by name of the field.

    Args:
        world: Name of the world, for messages.
        kind: The dataclass.
        values: Value of each field that differs from its default.

    Raises:
        UserError: If a field is unknown, a value is not one that its Literal type lists, or a text
            is given for a number or a truth value.
    """
    kinds = typing.get_type_hints(kind)
    fields = tuple(field.name for field in dataclasses.fields(kind))  # pyright: ignore[reportArgumentType]
    for option in values:
        one_of(f"option of {world}", option, fields)
    for option, value in values.items():
        allowed = typing.get_args(kinds[option])
        if typing.get_origin(kinds[option]) is typing.Literal and value not in allowed:
            raise UserError(
                f"unknown value '{value}' for {option} of {world}: "
                f"choose one of {', '.join(map(str, allowed))}"
            )
        if isinstance(value, str) and kinds[option] in (bool, float, int):
            raise UserError(
                f"{option} of {world} is a text, '{value}': give a number, true or false"
            )
    return kind(**values)
