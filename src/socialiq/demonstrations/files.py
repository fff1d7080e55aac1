"""Demonstrations as checked files (storage.py): the columns, and a header with the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from socialiq import storage
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError

KIND = "demonstrations"
SCHEMA_VERSION = 1


def save(path: Path, demonstrations: Demonstrations, replace: bool = True) -> str:
    """Write a table to one file, whole or not at all.

    Args:
        path: The file; its folder must exist.
        demonstrations: The table.
        replace: Whether a file there is replaced.

    Returns:
        The SHA-256 of the content, the same for every table of the same content.

    Raises:
        UserError: If the file can't be written.
    """
    arrays, header = demonstrations.arrays(), header_of(demonstrations)
    return storage.save_arrays(path, KIND, SCHEMA_VERSION, arrays, header, replace)


def sha256_of(demonstrations: Demonstrations) -> str:
    """Return the SHA-256 of a table's content, as `save` does."""
    arrays, header = demonstrations.arrays(), header_of(demonstrations)
    return storage.sha256_of(KIND, SCHEMA_VERSION, arrays, header)


def header_of(demonstrations: Demonstrations) -> dict[str, Any]:
    """Return the header of a file: mode_names, n_actions, source."""
    return {
        "mode_names": list(demonstrations.mode_names),
        "n_actions": demonstrations.n_actions,
        "source": demonstrations.source,
    }


def load(path: Path) -> Demonstrations:
    """Read a table, checking the file's bytes and then every column.

    Raises:
        UserError: If the file is missing, damaged, of another kind or version, or its content
            isn't a valid table; the line names the file.
    """
    arrays, header = storage.load_arrays(path, KIND, SCHEMA_VERSION)
    mode_names, n_actions, source = (
        header.get(name) for name in ("mode_names", "n_actions", "source")
    )
    if (
        not isinstance(mode_names, list)
        or not all(isinstance(name, str) for name in mode_names)
        or not isinstance(n_actions, int)
        or not isinstance(source, dict)
    ):
        raise UserError(
            f"{path} lacks mode_names, n_actions or source in its header: make the file again"
        )
    try:
        return Demonstrations.of_arrays(arrays, tuple(mode_names), n_actions, source)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
