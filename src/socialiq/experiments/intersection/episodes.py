"""Outcomes of a policy's episodes, as a checked file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from socialiq.evaluation.play import Episodes
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import RewardPair

KIND = "episodes"
SCHEMA_VERSION = 1
_PAIRS = ("totals", "classical")
_NAMES = ("signal_names",)


def save_episodes(path: Path, episodes: Episodes) -> str:
    """Write them to one file.

    Returns:
        The content's SHA-256.

    Raises:
        UserError: If the file can't be written.
    """
    fields = episodes._asdict()
    arrays = {}
    for name in _PAIRS:
        arrays |= {f"{name}_env": fields[name].env, f"{name}_social": fields[name].social}
    arrays |= {name: value for name, value in fields.items() if name not in (*_PAIRS, *_NAMES)}
    header = {name: list(fields[name]) for name in _NAMES}
    return save_arrays(path, KIND, SCHEMA_VERSION, arrays, header)


def load_episodes(path: Path) -> Episodes:
    """Read them back.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    arrays, header = load_arrays(path, KIND, SCHEMA_VERSION)
    fields: dict[str, Any] = {**arrays, **{name: tuple(header[name]) for name in _NAMES}}
    for name in _PAIRS:
        fields[name] = RewardPair(fields.pop(f"{name}_env"), fields.pop(f"{name}_social"))
    return Episodes(**fields)
