"""Demonstrations as checked files (storage.py): the columns, and a header with the rest."""

from pathlib import Path
from typing import Any

from socialiq import storage
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError

KIND = "demonstrations"
SCHEMA_VERSION = 1
CONTINUOUS_VERSION = 2
"""Schema version of tables with continuous actions, which readers of version 1 would not know."""


def save(path: str | Path, demonstrations: Demonstrations, replace: bool = True) -> str:
    """Write a table to one file, in a folder that exists, whole or not at all.

    Returns:
        The SHA-256 of the content, the same for every table of the same content.
    """
    arrays = demonstrations.arrays()
    header = header_of(demonstrations)
    return storage.save_arrays(path, KIND, _version(demonstrations), arrays, header, replace)


def sha256_of(demonstrations: Demonstrations) -> str:
    """Return the SHA-256 of a table's content, as `save` does."""
    arrays = demonstrations.arrays()
    header = header_of(demonstrations)
    return storage.sha256_of(KIND, _version(demonstrations), arrays, header)


def _version(demonstrations: Demonstrations) -> int:
    return CONTINUOUS_VERSION if demonstrations.action_size else SCHEMA_VERSION


def header_of(demonstrations: Demonstrations) -> dict[str, Any]:
    """Return the header of a file: mode_names, n_actions, source."""
    return {
        "mode_names": list(demonstrations.mode_names),
        "n_actions": demonstrations.n_actions,
        "source": demonstrations.source,
    }


def load(path: str | Path, continuous: bool = False) -> Demonstrations:
    """Read a table, checking the file's bytes and then every column.

    Args:
        path: The file.
        continuous: Whether tables with continuous actions are read too.

    Raises:
        UserError: If the file is missing or damaged, has continuous actions that are not asked for,
            or a column is wrong; the line names the file.
    """
    arrays, header = storage.load_arrays(path, KIND, (SCHEMA_VERSION, CONTINUOUS_VERSION))
    if header["version"] == CONTINUOUS_VERSION and not continuous:
        raise UserError(
            f"{path} has continuous actions: this takes demonstrations of discrete ones"
        )
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
    if (n_actions == 0) != (header["version"] == CONTINUOUS_VERSION):
        raise UserError(f"{path} has actions of another kind than its version: make the file again")
    try:
        return Demonstrations.of_arrays(arrays, tuple(mode_names), n_actions, source)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
