"""Whether egos are off the road, of a whole batch."""

from __future__ import annotations

from socialiq.worlds.highway.core.compile import entry_point, fingerprint
from socialiq.worlds.highway.core.geometry import on_lane


def _entry(sources: int):
    @entry_point
    def run(lanes, vehicles, present, off_road, first, end):
        for row in range(first, end):
            ego = vehicles[row, present[row, 1]]
            off_road[row] = not on_lane(lanes[ego.lane], ego.x, ego.y, 0.0)
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


run = _entry(fingerprint())
"""Write whether each ego's centre is beyond its closest lane.

Args:
    lanes: Records of the road's lanes.
    vehicles: Records of vehicles, (batch, capacity).
    present: Number of vehicles and the ego's slot, (batch, 2).
    off_road: Overwritten, bool (batch,).
    first: First episode of the part to do.
    end: End of that part.
"""
