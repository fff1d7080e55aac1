"""Exception for mistakes of the user, arguments of a wrong type among them."""

import collections.abc
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


def public(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a function that fails in one line on an argument of a wrong type."""

    @functools.wraps(function)
    def called(*values: Any, **options: Any) -> Any:
        try:
            return function(*values, **options)
        except (AttributeError, TypeError) as error:
            if line := _misfit(function, values, options):
                raise UserError(f"{name}: {line}") from error
            raise

    return called


def _misfit(function: Callable[..., Any], values: Any, options: Any) -> str:
    """Return a line on the first argument that has none of its annotation's types, or ""."""
    hints = typing.get_type_hints(function)
    try:
        arguments = inspect.signature(function).bind(*values, **options).arguments
    except TypeError:  # too many or too few: Python's own line says so
        return ""
    for name, value in arguments.items():
        is_union = typing.get_origin(hints[name]) in (typing.Union, types.UnionType)
        kinds = typing.get_args(hints[name]) if is_union else (hints[name],)
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
