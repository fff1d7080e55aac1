"""Recordings: tracks and the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

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
