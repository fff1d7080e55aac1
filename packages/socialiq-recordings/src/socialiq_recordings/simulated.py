"""Simulated episodes as recordings: the road as lanelets, every sub-step as a frame.

All code for recordings can therefore be tested without external data. A vehicle
that is spawned after a decision is recorded from the next sub-step, because the simulator's
observation of that decision precedes it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.types import Ending, Policy
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.core.geometry import (
    LANE_WIDTH,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    heading_at,
    position,
)
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.intersection.core import geometry
from socialiq.worlds.intersection.options import SPEED_LIMIT, Options
from socialiq.worlds.intersection.world import Batch
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork

FIRST_LANELET = 1000
"""Number of the first lanelet; lanelets are in the order of the simulator's lanes."""

_SPACING = 0.5  # m between the points of an arc; `path_of` recovers the arc for any spacing

_position, _heading_at = for_python(position), for_python(heading_at)


def road() -> RoadNetwork:
    """Return the simulator's twenty lanes as lanelets, y to the north."""
    return RoadNetwork({FIRST_LANELET + lane: _lanelet(lane) for lane in range(geometry.N_LANES)})


def _lanelet(lane: int) -> Lanelet:
    record, half = geometry.LANES[lane], LANE_WIDTH / 2
    count = 2 if record["straight"] else int(np.ceil(record["length"] / _SPACING)) + 1
    along = np.linspace(0.0, float(record["length"]), count)
    centre = np.array([_position(record, metres) for metres in along])
    heading = np.array([_heading_at(record, metres) for metres in along])
    right = np.stack([-np.sin(heading), np.cos(heading)], axis=1) * half
    flip = np.array([1.0, -1.0])
    arm = lane % 5 == EXIT
    following = [] if arm else geometry.CONNECTED[lane, 1 : 4 if lane % 5 == 0 else 2].tolist()
    leading = [
        lane_before for lane_before in range(geometry.N_LANES) if lane in _following(lane_before)
    ]
    return Lanelet(
        FIRST_LANELET + lane,
        (centre - right) * flip,
        (centre + right) * flip,
        tuple(FIRST_LANELET + lane_after for lane_after in following),
        tuple(FIRST_LANELET + lane_after for lane_after in leading),
        speed_limit=SPEED_LIMIT,
    )


def _following(lane: int) -> list[int]:
    if lane % 5 == EXIT:
        return []  # the simulator connects exits to approaches; no vehicle drives there
    return geometry.CONNECTED[lane, 1 : 4 if lane % 5 == 0 else 2].tolist()


def record(options: Options, policy: Policy, seed: int, name: str = "") -> Recording:
    """Run an episode and record every sub-step.

    Args:
        options: The scenario.
        policy: Policy of the ego.
        seed: Seed of the episode.
        name: Name of the recording; by default derived from the seed.
    """
    batch = Batch(options, 1, traced=True)
    batch.reset([seed])
    frames, ending = [_now(batch)], Ending.NONE
    while ending == Ending.NONE:
        action, _ = policy.predict(batch.seen_by(policy))
        decisions = batch.step(action, auto_reset=False)
        count = int(batch.buffers.present[0, 0])
        frames += [moment[:count].copy() for moment in batch.buffers.trace[0]]
        ending = Ending(int(decisions.ending[0]))
    source = {"made_by": "socialiq simulator", "seed": seed, "options": repr(options)}
    tracks = _tracks(frames, 1 / options.simulation_frequency, name or f"simulated-{seed}", source)
    return Recording(tracks, road())


def _now(batch: Batch) -> np.ndarray:
    count = int(batch.buffers.episodes[0]["vehicles"])
    return batch.buffers.vehicles[0, :count].copy()


def _tracks(frames: list[np.ndarray], dt: float, name: str, source: dict[str, Any]) -> Tracks:
    rows = np.concatenate(frames)
    frame = np.repeat(np.arange(len(frames)), [len(rows) for rows in frames])
    # In the order of the simulator's list, in which identities ascend.
    order = np.lexsort([frame, rows["identity"]])
    rows, frame = rows[order], frame[order]
    identity, track = np.unique(rows["identity"], return_inverse=True)
    heading = -rows["heading"]
    return Tracks(
        track.astype(np.int32),
        frame.astype(np.int32),
        rows["x"].copy(),
        -rows["y"],
        np.pi - (np.pi - heading) % (2 * np.pi),
        rows["speed"] * rows["along_x"],
        -rows["speed"] * rows["along_y"],
        identity.astype(np.int64) + 1,
        np.full(len(identity), int(RoadUser.CAR), np.int8),
        np.full(len(identity), VEHICLE_LENGTH),
        np.full(len(identity), VEHICLE_WIDTH),
        dt,
        name,
        source,
    )
