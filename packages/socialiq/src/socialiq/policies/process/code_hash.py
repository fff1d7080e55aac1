"""Hash of a policy that is code: its words, and whole every file and folder that they name."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from socialiq.errors import UserError
from socialiq.foreign import one_line

MOST_FILES = 100_000
"""Largest number of files below the named folders."""

CACHE = "__pycache__"
"""Folders with this name are derived from the sources beside them, and are not covered."""

_NOT_COVERED = "not what programs load besides: the interpreter's folder and shared libraries"


class NamedFile(NamedTuple):
    """A file or folder of a policy, and the word that names it."""

    word: str
    path: Path


class CodeHash(NamedTuple):
    """Hash of a policy's code, and what it covers.

    Attributes:
        sha256: SHA-256 over words, paths and contents.
        covers: Description for people.
        paths: The named files and folders, absolute.
        caches: Folders below them that are not covered.
    """

    sha256: str
    covers: str
    paths: tuple[Path, ...]
    caches: tuple[Path, ...]


def files_named_by(command: Sequence[str], files: Sequence[str] = ()) -> list[NamedFile]:
    """Return the files and folders that a command names.

    They are its program, its words, and what follows the first "=" of a word (`--option=FILE`).

    Args:
        command: Program and arguments.
        files: Further files and folders, which the command doesn't name.

    Raises:
        UserError: If one of `files` doesn't exist.
    """
    program = NamedFile(command[0], Path(shutil.which(command[0]) or command[0]))
    found = [program] if program.path.is_file() else []
    for word in command[1:]:
        for one in (word, word.partition("=")[2]):
            if one and _is_there(one):
                found.append(NamedFile(word, Path(one)))
                break
    return found + further_files(files)


def further_files(files: Sequence[str]) -> list[NamedFile]:
    """Return files and folders that the user names.

    Raises:
        UserError: If one doesn't exist.
    """
    for one in files:
        if not one or not _is_there(one):
            raise UserError(f"no such file: {one_line(one)}")
    return [NamedFile(one, Path(one)) for one in files]


def _is_there(word: str) -> bool:
    """Whether a word names a file or a folder; of `os.path`, because a word may be too long."""
    return os.path.isfile(word) or os.path.isdir(word)  # noqa: PTH112, PTH113


def hash_files(words: Sequence[str], named: Sequence[NamedFile]) -> CodeHash:
    """Hash words, and files and folders with their paths; each part is preceded by its length.

    Args:
        words: Words of the specification, in their order.
        named: Files and folders.

    Raises:
        UserError: If a file can't be read, a folder has too many files, or a link leaves it.
    """
    digest, caches, files, size = hashlib.sha256(), [], 0, 0
    for word in words:
        _add(digest, "word", word)
    for one in named:
        _add(digest, "path", one.word)
        for entry in _entries(one.path, caches):
            _add(digest, entry.kind, entry.place, entry.content)
            files, size = files + (entry.kind == "file"), size + entry.size
            if files > MOST_FILES:
                raise UserError(
                    f"{one_line(one.word)} has more than {MOST_FILES:,} files: name the policy's "
                    "own folder"
                )
    covers = (
        f"the words, and whole the {files} files ({size:,} bytes) that they name; {_NOT_COVERED}"
    )
    paths = tuple(dict.fromkeys(one.path.absolute() for one in named))
    return CodeHash(digest.hexdigest(), covers, paths, tuple(caches))


class _Entry(NamedTuple):
    """A file, link or folder: its path below the named one, what is hashed, and its bytes."""

    kind: str
    place: str
    content: str = ""
    size: int = 0


def _entries(path: Path, caches: list[Path]) -> Iterator[_Entry]:
    """Return the entries of a file or folder in the order of their names; collect its caches."""
    try:
        if path.is_file():
            yield _file(path, "")
        else:
            yield from _below(path, path.resolve(), "", caches)
    except OSError as error:
        place = one_line(str(error.filename or path))
        raise UserError(f"cannot read {place}: {error.strerror}") from error


def _below(folder: Path, root: Path, place: str, caches: list[Path]) -> Iterator[_Entry]:
    for path in sorted(folder.iterdir()):
        name = f"{place}{path.name}"
        if path.is_symlink():
            if not path.resolve().is_relative_to(root):
                raise UserError(
                    f"{one_line(str(path))} is a link that leaves the policy's folder: replace it "
                    "by what it points to"
                )
            yield _Entry("link", name, str(path.readlink()))
        elif path.is_dir() and path.name == CACHE:
            caches.append(path.absolute())
        elif path.is_dir():
            yield _Entry("folder", name)
            yield from _below(path, root, f"{name}/", caches)
        elif path.is_file():
            yield _file(path, name)
        else:
            raise UserError(f"{one_line(str(path))} is not a plain file: leave it out")


def _file(path: Path, place: str) -> _Entry:
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        return _Entry("file", place, hashlib.file_digest(file, "sha256").hexdigest(), size)


def _add(digest: Any, *parts: str) -> None:
    for part in parts:
        content = os.fsencode(part)
        digest.update(len(content).to_bytes(8) + content)
