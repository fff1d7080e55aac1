"""A recording: its tracks and the road under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from socialiq.errors import UserError
from socialiq.recordings.road.network import RoadNetwork
from socialiq.recordings.tracks import Tracks


@dataclass(frozen=True, eq=False)
class Recording:
    """What was read from one source.

    Attributes:
        tracks: Who was where.
        road: The lanelets; none where the source has no map.
    """

    tracks: Tracks
    road: RoadNetwork


class Refused(NamedTuple):
    """A track that was left out.

    Attributes:
        identity: The road user's name in the file.
        reason: What is wrong with it, where.
    """

    identity: str
    reason: str


@dataclass(frozen=True, eq=False)
class Imported:
    """One recording read from a file.

    Attributes:
        recording: The tracks that passed every check, and the road.
        refused: The others.
        skipped: How many things of the file are no tracks, by kind.
        n_states: States that were read, those of refused tracks too.
    """

    recording: Recording
    refused: tuple[Refused, ...]
    skipped: dict[str, int] = field(default_factory=dict)
    n_states: int = 0


def order_fault(frames: Int[np.ndarray, " state"] | Sequence[int]) -> str:
    """What is wrong with a track's frames, which have to go up by one; "" where nothing is."""
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
    """Refuse a file where a world is asked for.

    Args:
        world: What the user named.

    Raises:
        UserError: If it is a file's name; no world's name looks like one.
    """
    if world.lower().endswith(_SUFFIXES):
        raise UserError(
            "a recording can't be driven in: its neighbours do not react, so their losses of speed "
            "are fixed whatever the policy does, and the angle would be biased; name a world that "
            "reacts (intersection), or judge the recorded drivers with `socialiq data audit`"
        )
