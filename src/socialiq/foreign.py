"""Code of strangers: importing it, and telling its failures in one line."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from socialiq.errors import UserError
from socialiq.plain_text import one_line

# `SystemExit` would end the program without a word.
FAILURES = (Exception, SystemExit)
"""What foreign code may raise."""


def imported(place: str) -> ModuleType:
    """Import a module. This runs its author's code, with all your rights.

    Args:
        place: A name that Python can import, or the path of a file that ends in .py; a file runs
            anew only if it has changed.

    Raises:
        UserError: If there is no such file. Whatever else the code raises passes.
    """
    if not place.endswith(".py"):
        return importlib.import_module(place)
    path = Path(place).resolve()
    if not path.is_file():
        raise UserError(f"no such file: {one_line(place)}")
    content = path.read_bytes()
    if (path, content) not in _RUN:
        _RUN[path, content] = _run(path)
    return _RUN[path, content]


_RUN: dict[tuple[Path, bytes], ModuleType] = {}


def _run(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    # A dataclass looks its own module up there, and Gymnasium an entry point's.
    there = sys.modules.get(path.stem)
    if there is None or getattr(there, "__file__", None) == str(path):
        sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def failure(source: str, error: BaseException) -> UserError:
    """What foreign code raised, as a line that blames it.

    Args:
        source: How messages call the code.
        error: What it raised.
    """
    return UserError(
        f"{source} raised {type(error).__name__}: {one_line(str(error))}; mend its code"
    )
