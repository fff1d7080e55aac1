"""A stranger's file, read once and whole: what is hashed is what is parsed."""

from __future__ import annotations

import hashlib
from pathlib import Path

from socialiq.errors import UserError

MOST_BYTES = 32 * 1024 * 1024
"""Of a policy's file: eight million float32 weights, far more than a driver's perceptron has."""


def read_content(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a regular file of bounded size.

    Raises:
        UserError: If it is missing, no regular file, unreadable or too large.
    """
    if not path.is_file():
        raise UserError(f"no such file: {path}")
    try:
        with path.open("rb") as file:
            # Not more than it has: the buffer is made at once.
            content = file.read(min(path.stat().st_size, most) + 1)
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    if len(content) > most:
        raise UserError(f"{path} is larger than {most:,} bytes: name a smaller policy")
    return content


def sha256_of(content: bytes) -> str:
    """SHA-256 of bytes, as `sha256sum` prints it."""
    return hashlib.sha256(content).hexdigest()
