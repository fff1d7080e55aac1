"""Recordings: tracks and the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from socialiq.errors import UserError
from socialiq.storage import kind_of
from socialiq.worlds import WORLD_FILE
from socialiq_recordings.road.network import RoadNetwork
from socialiq_recordings.tracks import Tracks


@dataclass(frozen=True, eq=False)
class Recording:
    """Recording of one source.

    Attributes:
        tracks: The tracks.
        road: The lanelets; None if the source has no map.
    """

    tracks: Tracks
    road: RoadNetwork


class Refused(NamedTuple):
    """Track that was left out.

    Attributes:
        identity: The road user's name in the file.
        reason: Error and its place.
    """

    identity: str
    reason: str


@dataclass(frozen=True, eq=False)
class Imported:
    """Recording read from a file.

    Attributes:
        recording: The tracks that passed every check, and the road.
        refused: The other tracks.
        skipped: Number of the file's elements that are not tracks, by kind.
        n_states: Number of states read, including those of refused tracks.
    """

    recording: Recording
    refused: tuple[Refused, ...]
    skipped: dict[str, int] = field(default_factory=dict)
    n_states: int = 0


def order_fault(frames: Int[np.ndarray, " state"] | Sequence[int]) -> str:
    """Return the error in a track's frames, which must increase by one; "" if there is none."""
    steps = np.diff(np.asarray(frames, np.int64))
    if (steps == 1).all():
        return ""
    place = int(np.argmax(steps != 1))
    before, after = frames[place], frames[place + 1]
    if after == before:
        return f"frame {after} is there twice"
    if after < before:
        return f"time goes back: frame {after} follows frame {before}"
    return f"frame {after} follows frame {before}: a gap of {after - before - 1}"


_SUFFIXES = (".safetensors", ".xml", ".csv")


def refuse_recording(world: str) -> None:
    """Raise an error for a file in place of a world.

    Args:
        world: Name given by the user.

    Raises:
        UserError: If it is a file's name, and not that of a world of `socialiq data world`.
    """
    if kind_of(Path(world)) == WORLD_FILE:
        return
    if world.lower().endswith(_SUFFIXES):
        raise UserError(
            "a recording can't be driven in: its neighbours do not react, so their losses of speed "
            "are fixed whatever the policy does, and the angle would be biased; name a world that "
            "reacts (intersection, or one that `socialiq data world` makes of it)"
        )
