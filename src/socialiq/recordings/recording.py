"""A recording: its tracks and the road under them."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.recordings.road import RoadNetwork
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
