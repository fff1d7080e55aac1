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

    Args:
        what: Kind of thing that the value names, in the user's words ("world", "target kind").
        value: Value to check. The message shows at most 80 characters of it.
        allowed: Known names, in the order in which the message lists them.

    Raises:
        UserError: If the value is not one of the known names.
    """
    if value not in allowed:
        text = str(value)
        short = text if len(text) <= 80 else f"{text[:79]}…"
        raise UserError(f"unknown {what} '{short}': choose one of {', '.join(allowed)}")


def public(value: Any, name: str) -> Any:
    """Return a function, or a class, that fails in one line on an argument of a wrong type.

    A class is changed in place: its constructor and its public methods. The constructor of a
    dataclass without `__post_init__` also refuses values of a wrong type that Python would accept.

    Args:
        value: Function or class. Enumerations, exceptions and other values are not changed.
        name: Name of the function or class in error messages. A method's name follows after a dot.

    Returns:
        The function with the check around it, or the same class or value. What is returned raises
        `UserError` for an argument of a wrong type.
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
    lines = (misfit(name, value, hints.get(name, Any)) for name, value in arguments.items())
    return next(filter(None, lines), "")  # `self` has no hint


def misfit(name: str, value: Any, hint: Any) -> str:
    """Return a line on a value that has none of an annotation's types; "" for one that fits.

    Args:
        name: Name of the argument, for the line.
        value: Its value.
        hint: Its annotation.
    """
    kinds = kinds_of(hint)
    if any(_fits(value, kind) for kind in kinds):
        return ""
    words = " or ".join(getattr(kind, "__name__", str(kind)) for kind in kinds)
    return f"{name} is of the type {type(value).__name__}: pass {words}"


def kinds_of(hint: Any) -> tuple[Any, ...]:
    """Return the types of a union, or the one type of another annotation."""
    is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if is_union else (hint,)


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value has a type; whatever can't be checked fits."""
    kind = typing.get_origin(kind) or kind
    if kind is collections.abc.Sequence:
        return hasattr(value, "__len__") and not isinstance(value, str)
    try:
        return isinstance(value, {float: numbers.Real, int: numbers.Integral}.get(kind, kind))
    except TypeError:
        return True
