"""A loaded policy, and its record for reports: kind, source, hash, sizes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from socialiq.policies.interface import Interface
from socialiq.policies.process.isolation import NOT_NEEDED, Isolation
from socialiq.reading import read_bytes
from socialiq.storage import shipped
from socialiq.types import Policy


@dataclass(frozen=True)
class Record:
    """Facts about a policy, all JSON.

    Attributes:
        kind: "policy", "ensemble", "dial", "table", "sb3", "onnx", "process" or "python".
        source: The specification that it was loaded from, as one printable line.
        sha256: SHA-256 of the file's bytes; for a process, of its command and the files named in
            it (`process.code_hash`); for Python in this process, of the module's source.
        covers: Description of the hashed content.
        interface: Sizes of its observations and actions.
        soft: Whether it gives the distribution of its stochastic actions.
        details: Further facts from its file.
        isolation: Isolation of its process.
    """

    kind: str
    source: str
    sha256: str
    covers: str
    interface: Interface
    soft: bool
    details: Mapping[str, Any] = field(default_factory=dict)
    isolation: Isolation = NOT_NEEDED

    def as_json(self) -> dict[str, Any]:
        """Return the record as one JSON object."""
        named = {name: getattr(self, name) for name in ("kind", "source", "sha256", "covers")}
        more = {"soft": self.soft, "isolation": self.isolation._asdict()}
        # The file's own facts come first: they can't take the place of these.
        return {**self.details, **named, **self.interface.as_json(), **more}


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class Loaded:
    """A policy and its record; a context manager, because a process must be ended.

    Attributes:
        policy: Decides, as `types.Policy`.
        record: Its facts.
        close: Ends the policy's process, if it has one; may be called twice.
        check_unchanged: Raises `UserError` if the policy's files are no longer those of its hash.
    """

    policy: Policy
    record: Record
    close: Callable[[], None] = _nothing
    check_unchanged: Callable[[], None] = _nothing

    def __enter__(self) -> Loaded:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


MOST_BYTES = 32 * 1024 * 1024
"""Largest size of a policy's file: eight million float32 weights, far more than needed."""


def read_content(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a regular file of bounded size.

    Raises:
        UserError: If it is missing, not a regular file, unreadable or too large.
    """
    return read_bytes(shipped(path), most)


def sha256_of(content: bytes) -> str:
    """Return the SHA-256 of bytes, as `sha256sum` prints it."""
    return hashlib.sha256(content).hexdigest()
