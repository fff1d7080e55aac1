"""A Python policy's files, found without importing anything, and the command that runs it."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from importlib.machinery import PathFinder
from pathlib import Path

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies.process.code_hash import CodeHash, NamedFile, further_files, hash_files

_CHILD = Path(__file__).with_name("python_child.py")

OWN_FOLDER = Path(__file__).parents[2]
"""Folder of this package: its child program, and what a policy may import of it."""


def hash_of_python(name: str, source: str, files: Sequence[str]) -> CodeHash:
    """Hash the files of `MODULE:ATTRIBUTE`: the module's file, or its whole top-level package.

    Args:
        name: As above; MODULE may be a file's path that ends in .py.
        source: Its name in messages.
        files: Further files and folders.

    Raises:
        UserError: If the module isn't found, or a file can't be read.
    """
    place, attribute = parts_of(name, source)
    # A file's name, not its path: the same policy in another folder has the same hash.
    words = ["python", Path(place).name, attribute]
    return hash_files(words, [*_files(place), *further_files(files)])


def parts_of(name: str, source: str) -> tuple[str, str]:
    """Return module and attribute of `MODULE:ATTRIBUTE`.

    Raises:
        UserError: If the text has another form.
    """
    place, _, attribute = name.rpartition(":")
    if not place or not attribute.isidentifier():
        raise UserError(
            f"{source} is not MODULE:ATTRIBUTE: write for instance mine.policies:careful"
        )
    return place, attribute


def command_of_python(name: str, source: str) -> list[str]:
    """Return the command that runs `MODULE:ATTRIBUTE` as a process, with this interpreter.

    Raises:
        UserError: If the text has another form.
    """
    place, attribute = parts_of(name, source)
    if place.endswith(".py"):
        place = str(Path(place).absolute())
    paths = [str(Path(one).absolute()) for one in sys.path]
    return [sys.executable, "-I", "-B", str(_CHILD), place, attribute, json.dumps(paths)]


def _files(place: str) -> list[NamedFile]:
    if place.endswith(".py"):
        if not Path(place).is_file():
            raise UserError(f"no such file: {one_line(place)}")
        return [NamedFile(Path(place).name, Path(place))]
    top = place.partition(".")[0]
    # This finder looks at names of files only; `find_spec` of a submodule would import its package.
    spec = PathFinder.find_spec(top) if top.isidentifier() else None
    if spec is None:
        raise UserError(
            f"no such module: {one_line(place)}; name the path of its file, ending in .py"
        )
    folders = list(spec.submodule_search_locations or ())
    return [NamedFile(top, Path(one)) for one in folders or [str(spec.origin)]]
