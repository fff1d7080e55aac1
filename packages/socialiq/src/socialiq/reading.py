"""Files of the user, read so that no pipe blocks, no device runs on, and no size fills the memory.

Every reader of the project opens its file here.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from socialiq.errors import UserError
from socialiq.foreign import one_line

_PIECE = 1 << 20
_LARGEST_TOML = 1 << 20


@contextlib.contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file; what fails while it is read is raised as one line.

    A pipe would block and a device never ends, so both are refused.
    """
    try:
        check_file(path)
        with path.open("rb") as file:
            yield file
    except OSError as error:
        # A library's own message may have several lines.
        reason = error.strerror or one_line(str(error))
        raise UserError(f"cannot read {path}: {reason}") from error


def check_file(path: Path) -> None:
    """Refuse a path that is not a regular file."""
    if path.is_file():
        return
    if path.is_dir():
        inside = next((file.name for file in sorted(path.glob("*.safetensors"))), "")
        raise UserError(f"{path} is a folder: name a file" + (inside and f" in it, as {inside}"))
    if path.exists():
        raise UserError(f"{path} is not a regular file: name one")
    raise UserError(f"no such file: {path}")


def path_of(path: object) -> Path:
    """Return a path that may be text; `UserError` for anything else."""
    if isinstance(path, str | os.PathLike):
        return Path(path)
    raise UserError(f"{type(path).__name__} is no path: give a text or a pathlib.Path")


def read_bytes(path: Path, most: int) -> bytes:
    """Read a regular file of limited size.

    Args:
        path: The file.
        most: Largest number of bytes.

    Raises:
        UserError: If it is not a regular file, is larger, or can't be read.
    """
    with open_file(path) as file:
        # Not more than the file's size: the buffer is allocated at once.
        content = file.read(min(path.stat().st_size, most) + 1)
    if len(content) > most:
        raise UserError(f"{path} is larger than {most:,} bytes: name a smaller file")
    return content


def read_text(path: Path, most: int) -> str:
    """Read a file of UTF-8 text.

    Args:
        path: The file.
        most: Largest number of bytes.

    Raises:
        UserError: If it is not UTF-8 text, or as `read_bytes`.
    """
    try:
        return read_bytes(path, most).decode()
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not UTF-8 text: name a text file") from error


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file of at most 1 MiB.

    A whole number of more than 64 bits is refused, which TOML excludes and Python doesn't.
    """
    text = read_text(path, _LARGEST_TOML)
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not TOML: {one_line(str(error))}") from error
    waiting: list[Any] = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict | list):
            waiting += value.values() if isinstance(value, dict) else value
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise UserError(f"{path} has a whole number of more than 64 bits: TOML has none")
    return document


def sha256_of(content: bytes | str) -> str:
    """Return the SHA-256 of bytes, or of a text in UTF-8, as hexadecimal digits."""
    data = content.encode() if isinstance(content, str) else content
    return hashlib.sha256(data).hexdigest()


def sha256_of_file(path: Path) -> str:
    """Return the SHA-256 of a file, as `sha256sum` prints it."""
    digest = hashlib.sha256()
    with open_file(path) as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()
