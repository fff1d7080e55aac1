"""Splits of recorded demonstrations by whole recordings.

Vehicles of one recording see each other, so two episodes of one recording hold the same moments
from two vehicles. A split inside a recording would test on training data.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError


def recordings_of(table: Demonstrations) -> tuple[tuple[str, ...], Int64[np.ndarray, " episode"]]:
    """Return the names of a table's recordings, and the index of each episode's recording.

    Raises:
        UserError: If the table wasn't made by an ego swap, or its episodes were selected since.
    """
    listed, place = table.source.get("recordings"), table.source.get("episode_recording")
    if not isinstance(listed, list) or not isinstance(place, list):
        raise UserError(
            "these demonstrations lack the recording of each episode: make them with "
            "`socialiq data demonstrations`"
        )
    if len(place) != table.n_episodes:
        raise UserError("episodes were picked or repeated since the ego swap: split before that")
    return tuple(str(one["name"]) for one in listed), np.array(place, np.int64)


def site_of(recording: str) -> str:
    """Return the site of a recording: the map of a CommonRoad benchmark's name, else the name.

    Scenarios of one map may come from one recording and show the same vehicles seconds later.

    Args:
        recording: Name of the recording.
    """
    found = re.match(r"(?:C-)?([A-Z]{3}_[A-Za-z0-9]+-[0-9]+)_", recording)
    return found[1] if found else recording


def split(table: Demonstrations, held_out: Sequence[str]) -> tuple[Demonstrations, Demonstrations]:
    """Split a table by recording.

    Args:
        table: Demonstrations of an ego swap.
        held_out: Names of the recordings to keep for testing.

    Returns:
        Training and held-out demonstrations, each with its own recordings only.

    Raises:
        UserError: If a name is unknown, or one side would be empty: one recording can't be
            split.
    """
    names, place = recordings_of(table)
    unknown = [name for name in held_out if name not in names]
    if unknown:
        raise UserError(f"no recording '{unknown[0]}': choose from {', '.join(names)}")
    if len(names) < 2:
        raise UserError(
            f"there is one recording, {', '.join(names)}, and one can't be split: its vehicles "
            "see each other, so both sides would hold the same moments; add a recording"
        )
    held = np.isin(place, [names.index(name) for name in held_out])
    if held.all() or not held.any():
        raise UserError("both sides of a split need an episode: hold out some recordings, not all")
    return _side(table, ~held), _side(table, held)


def _side(table: Demonstrations, chosen: np.ndarray) -> Demonstrations:
    episodes = np.flatnonzero(chosen)
    old = [table.source["episode_recording"][one] for one in episodes]
    kept = sorted(set(old))
    source = table.source | {
        "recordings": [table.source["recordings"][one] for one in kept],
        "episode_recording": [kept.index(one) for one in old],
        "episode_identity": [table.source["episode_identity"][one] for one in episodes],
    }
    arrays = table.select(episodes).arrays()
    return Demonstrations.of_arrays(arrays, table.mode_names, table.n_actions, source)
