"""Observation and reward kernels of the simulator, applied to recorded traffic."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.core import rewards
from socialiq.worlds.highway.core.compile import entry_point, fingerprint
from socialiq.worlds.highway.core.geometry import distance
from socialiq.worlds.highway.core.observation import observe
from socialiq.worlds.intersection.state import SIGHT

SEEN = np.dtype(
    [
        ("x", np.float64),  # m, in the frame of the simulator
        ("y", np.float64),
        ("along_x", np.float64),  # unit vector of the heading
        ("along_y", np.float64),
        ("speed", np.float64),  # m/s
        ("along", np.float64),  # coordinate along the ego's lane, m
        ("lost", np.float64),  # speed lost in the decision before, m/s
        ("kind", np.int64),  # of its lane: APPROACH, EXIT, or another
        ("same_origin", np.bool_),  # whether it came by the ego's approach
    ],
    align=True,
)
"""One vehicle of a snapshot."""

SNAPSHOT = np.dtype(
    [
        ("count", np.int64),  # vehicles there
        ("ego", np.int64),  # the ego's slot
        ("kind", np.int64),  # of the ego's lane
        ("along", np.float64),  # how far along that lane the ego is, m
        ("length", np.float64),  # of that lane, m
        ("advance", np.float64),  # metres along the route since the snapshot before
        ("travelled", np.float64),  # since the episode began
        ("on_road", np.bool_),
        ("ending", np.int64),  # value of `Ending`, for the rewards
    ],
    align=True,
)
"""Road-dependent quantities of the ego in a snapshot."""


def _entry(sources: int):
    @entry_point
    def run(snapshots, vehicles, settings, observation, signals, pairs, first, end):
        for row in range(first, end):
            here, seen, chosen = snapshots[row], vehicles[row], settings[0]
            count, ego = here.count, here.ego
            along, lost = np.empty(count), np.empty(count)
            counted, braking = np.empty(count, np.bool_), np.empty(count, np.bool_)
            for slot in range(count):
                other = seen[slot]
                apart = distance(other.x, other.y, seen[ego].x, seen[ego].y)
                known = rewards.counts(apart, other.same_origin, other.kind, chosen)
                counted[slot] = slot != ego and known
                along[slot], lost[slot] = other.along, other.lost
            observe(seen, count, ego, along, chosen.tie, SIGHT[0], observation[row])
            speed, written = seen[ego].speed, signals[row]
            within = rewards.in_zone(here.kind, here.along, here.length, here.travelled, chosen)
            rewards.env_signals(here.advance, here.on_road, speed, here.ending, chosen, written)
            rewards.social_signals(
                speed, within, counted, lost, here.ending, chosen, written, braking
            )
            pairs[row, 0], pairs[row, 1] = rewards.pair(written, chosen)
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


run = _entry(fingerprint(__file__))
"""Write observation, signals and rewards of every snapshot.

Args:
    snapshots: SNAPSHOT records, (snapshot,).
    vehicles: SEEN records, (snapshot, most vehicles).
    settings: SETTINGS record in an array of one.
    observation: (snapshot, vehicles seen, 7), float32, overwritten.
    signals: (snapshot, signals), overwritten; undefined for an episode's first snapshot.
    pairs: r_env and r_social, (snapshot, 2), overwritten.
    first: First snapshot of the part to do.
    end: End of that part.
"""
