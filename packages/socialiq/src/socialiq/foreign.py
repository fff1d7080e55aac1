"""Text and code from outside the project: printed safely, imported, named in error messages."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from socialiq.errors import UserError

# `SystemExit` would end the program without a word.
FAILURES = (Exception, SystemExit)
"""Exceptions that foreign code may raise."""


def imported(source: str) -> ModuleType:
    """Import a module. This runs its author's code, with all your rights.

    Args:
        source: A name that Python can import, or the path of a file that ends in .py; a file runs
            again only if it has changed.
    """
    if not source.endswith(".py"):
        return importlib.import_module(source)
    path = Path(source).resolve()
    if not path.is_file():
        raise UserError(f"no such file: {one_line(source)}")
    content = path.read_bytes()
    if (path, content) not in _RUN:
        spec = importlib.util.spec_from_file_location(path.stem, path)
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        # Dataclasses and Gymnasium's entry points look their module up there.
        there = sys.modules.get(path.stem)
        if there is None or getattr(there, "__file__", None) == str(path):
            sys.modules[path.stem] = module
        spec.loader.exec_module(module)
        _RUN[path, content] = module
    return _RUN[path, content]


_RUN: dict[tuple[Path, bytes], ModuleType] = {}


def optional(module: str, extra: str, needed_by: str, distribution: str = "socialiq") -> Any:
    """Import a module of a library that an optional extra installs.

    Args:
        module: Its name, for instance "onnx.helper".
        extra: Name of the extra.
        needed_by: Name of the feature, the first words of the error message.
        distribution: Name of the distribution that has the extra.
    """
    library = module.partition(".")[0]
    try:
        importlib.import_module(library)
        return importlib.import_module(module)
    except ImportError as error:
        raise UserError(
            f"{needed_by}: {library} is not installed; run pip install '{distribution}[{extra}]'"
        ) from error


def drawing(module: str = "matplotlib.figure") -> Any:
    """Import a module of matplotlib, which the extra `draw` installs."""
    return optional(module, "draw", "pictures")


class Later:
    """Module of JAX, imported when something of it is first used: acting on roads needs none."""

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return getattr(optional(self._module, "learn", "learning and gridworlds"), name)


def failure(source: str, error: BaseException) -> UserError:
    """Return an exception of foreign code as a `UserError` of one line that names its source.

    Args:
        source: Name of the code, the first words of the message.
        error: The exception; its text is cut to one line of 200 characters.
    """
    return UserError(
        f"{source} raised {type(error).__name__}: {one_line(str(error))}; correct its code"
    )


def one_line(text: str | bytes, most: int = 200) -> str:
    """Return a text with printable characters only, in one line, cut to a length.

    Escape sequences could rewrite a terminal, and characters that change the writing direction
    could reorder a line; neither is printable in Python's sense.

    Args:
        text: A message of a file, a program or a library.
        most: Largest number of characters.
    """
    decoded = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return cut(" ".join(printable(decoded[: 20 * most]).split()), most)


def printable(text: str) -> str:
    """Return a text of the same length with a space for each unprintable character."""
    return "".join(mark if mark.isprintable() else " " for mark in text)


def cut(text: str, most: int) -> str:
    """Return a text of limited length; a text that was longer ends in "…".

    Args:
        text: The text.
        most: Largest number of characters of the result.
    """
    return text if len(text) <= most else text[: most - 1] + "…"


class Markdown(str):
    """Text that is Markdown already and is not escaped."""


_MARKED = str.maketrans({mark: f"\\{mark}" for mark in "\\`*_[]{}<>|&#~$!"})


def markdown(value: Any, most: int) -> Any:
    """Return a string as one line in which Markdown and HTML find no markup.

    Args:
        value: A string; other values, and `Markdown`, are not changed.
        most: Largest number of characters of the string before it is escaped.
    """
    if not isinstance(value, str) or isinstance(value, Markdown):
        return value
    return cut(printable(value), most).translate(_MARKED)


@functools.cache
def templates(package: str, most: int = 0) -> Any:
    """Return the Jinja environment of the folder `templates` of a package.

    Args:
        package: The package.
        most: Largest number of characters of a value in Markdown, where all values are escaped
            by `markdown`; 0 for HTML, where they are escaped by Jinja.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        autoescape=not most,
        finalize=functools.partial(markdown, most=most) if most else None,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
