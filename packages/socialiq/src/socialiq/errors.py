"""Exception for mistakes of the user, arguments of a wrong type among them."""

import collections.abc
import dataclasses
import enum
import functools
import inspect
import numbers
import types
import typing
from collections.abc import Callable
from typing import Any


class UserError(Exception):
    """Mistake that the user can correct. Its text is one line that says how.

    The command line prints the line and exits with `exit_status`. Library callers may catch it.
    """

    exit_status = 2


def one_of(what: str, value: object, allowed: tuple[str, ...] | list[str]) -> None:
    """Raise an error, which lists the known names, for a value that is none of them.

    `what` is the kind of thing that the name denotes, in the user's words ("world", "target kind").
    """
    if value not in allowed:
        text = str(value)
        short = text if len(text) <= 80 else f"{text[:79]}…"
        raise UserError(f"unknown {what} '{short}': choose one of {', '.join(allowed)}")


def public(value: Any, name: str) -> Any:
    """Return a function, or a class, that fails in one line on an argument of a wrong type.

    A class is changed in place: its constructor and its public methods. The constructor of a
    dataclass without checks of its own also refuses what Python would accept.
    """
    if inspect.isfunction(value):
        return _checked(value, name, False)
    if not inspect.isclass(value) or issubclass(value, (enum.Enum, Exception)):
        return value
    for attribute in dir(value):
        static = inspect.getattr_static(value, attribute)
        function = getattr(static, "__func__", static)  # of a static method or one of the class
        is_named = not attribute.startswith("_") or attribute == "__init__"
        if not (is_named and inspect.isfunction(function) and "socialiq" in function.__module__):
            continue
        is_first = attribute == "__init__" and dataclasses.is_dataclass(value)
        is_first = is_first and not hasattr(value, "__post_init__")
        label = name if attribute == "__init__" else f"{name}.{attribute}"
        checked = _checked(function, label, is_first)
        kind = type(static) if static is not function else None
        setattr(value, attribute, kind(checked) if kind else checked)
    return value


def _checked(function: Callable[..., Any], name: str, is_first: bool) -> Callable[..., Any]:
    """Return a function whose error names an argument of a wrong type; `is_first`: before all."""

    def refuse(values: Any, options: Any, error: Exception | None = None) -> None:
        if line := _misfit(function, values, options):
            raise UserError(f"{name}: {line}") from error

    @functools.wraps(function)
    def called(*values: Any, **options: Any) -> Any:
        if is_first:
            refuse(values, options)
        try:
            return function(*values, **options)
        except (AttributeError, TypeError, ValueError) as error:
            refuse(values, options, error)
            raise

    return called


@functools.cache
def _annotated(function: Callable[..., Any]) -> tuple[dict[str, Any], inspect.Signature]:
    return typing.get_type_hints(function), inspect.signature(function)


def _misfit(function: Callable[..., Any], values: Any, options: Any) -> str:
    """Return a line on the first argument that has none of its annotation's types, or ""."""
    try:
        hints, signature = _annotated(function)
        arguments = signature.bind(*values, **options).arguments
    except (NameError, TypeError):  # a type that isn't imported; too many arguments, or too few
        return ""
    for name, value in arguments.items():
        hint = hints.get(name, Any)  # `self` has none
        is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
        kinds = typing.get_args(hint) if is_union else (hint,)
        if not any(_fits(value, kind) for kind in kinds):
            words = " or ".join(getattr(kind, "__name__", str(kind)) for kind in kinds)
            return f"{name} is of the type {type(value).__name__}: pass {words}"
    return ""


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value has a type; whatever can't be checked fits."""
    kind = typing.get_origin(kind) or kind
    if kind is collections.abc.Sequence:
        return hasattr(value, "__len__") and not isinstance(value, str)
    try:
        return isinstance(value, {float: numbers.Real, int: numbers.Integral}.get(kind, kind))
    except TypeError:
        return True
