"""Simulated episodes as recordings.

All code for recordings can be tested without external data: the road becomes lanelets, and every
sub-step a frame. A vehicle that is spawned after a decision is recorded from the next sub-step,
because the simulator's observation of that decision precedes it.
"""

import numpy as np

from socialiq.physics import wrapped
from socialiq.types import Ending, Policy
from socialiq.worlds.highway.core import geometry as shapes
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.network import EXIT, LANE_WIDTH
from socialiq.worlds.intersection.core import geometry
from socialiq.worlds.intersection.options import SPEED_LIMIT, Options
from socialiq.worlds.intersection.world import Intersection
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork

FIRST_LANELET = 1000
"""Number of the first lanelet; lanelets are in the order of the simulator's lanes."""

_SPACING = 0.5  # m between the points of an arc; `path_of` recovers the arc for any spacing

_position = for_python(shapes.position)
_heading_at = for_python(shapes.heading_at)


def road() -> RoadNetwork:
    """Return the simulator's twenty lanes as lanelets, y to the north."""
    numbers = range(geometry.N_LANES)
    # The simulator connects exits to approaches; no vehicle drives there.
    following = {
        lane: geometry.ROAD.connected["lane"][lane, 1 : 4 if lane % 5 == 0 else 2].tolist()
        for lane in numbers
        if lane % 5 != EXIT
    }
    lanelets = {}
    for lane in numbers:
        record = geometry.LANES[lane]
        count = 2 if record["straight"] else int(np.ceil(record["length"] / _SPACING)) + 1
        along = np.linspace(0.0, float(record["length"]), count)
        centre = np.array([_position(record, metres) for metres in along])
        heading = np.array([_heading_at(record, metres) for metres in along])
        right = np.stack([-np.sin(heading), np.cos(heading)], axis=1) * (LANE_WIDTH / 2)
        flip = np.array([1.0, -1.0])
        leading = [before for before in numbers if lane in following.get(before, [])]
        lanelets[FIRST_LANELET + lane] = Lanelet(
            FIRST_LANELET + lane,
            (centre - right) * flip,
            (centre + right) * flip,
            tuple(FIRST_LANELET + after for after in following.get(lane, [])),
            tuple(FIRST_LANELET + before for before in leading),
            speed_limit=SPEED_LIMIT,
        )
    return RoadNetwork(lanelets)


def record(options: Options, policy: Policy, seed: int, name: str = "") -> Recording:
    """Run an episode with a policy of the ego and record every sub-step.

    Args:
        options: Options of the simulated intersection.
        policy: Policy that drives the ego.
        seed: Seed of the episode.
        name: Name of the recording; by default it is derived from the seed.

    Returns:
        Tracks with a frame for every sub-step, on the simulator's lanes; y points to the north.
    """
    batch = Intersection(options).batch(1, traced=True)
    batch.reset([seed])
    count = int(batch.buffers.episodes[0]["vehicles"])
    frames = [batch.buffers.vehicles[0, :count].copy()]
    ending = Ending.NONE
    while ending == Ending.NONE:
        action, _ = policy.predict(batch.seen_by(policy))
        decisions = batch.step(action, auto_reset=False)
        count = int(batch.buffers.present[0, 0])
        frames += [moment[:count].copy() for moment in batch.buffers.trace[0]]
        ending = Ending(int(decisions.ending[0]))
    rows = np.concatenate(frames)
    frame = np.repeat(np.arange(len(frames)), [len(vehicles) for vehicles in frames])
    # In the order of the simulator's list, in which identities ascend.
    order = np.lexsort([frame, rows["identity"]])
    rows = rows[order]
    frame = frame[order]
    identity, track = np.unique(rows["identity"], return_inverse=True)
    numbers = track.astype(np.int32), frame.astype(np.int32)
    velocity = rows["speed"] * rows["along_x"], -rows["speed"] * rows["along_y"]
    states = *numbers, rows["x"].copy(), -rows["y"], -wrapped(rows["heading"]), *velocity
    length = np.full(len(identity), shapes.VEHICLE_LENGTH)
    width = np.full(len(identity), shapes.VEHICLE_WIDTH)
    kinds = np.full(len(identity), int(RoadUser.CAR), np.int8)
    step = 1 / options.simulation_frequency
    name = name or f"simulated-{seed}"
    source = {"made_by": "socialiq simulator", "seed": seed, "options": repr(options)}
    users = identity.astype(np.int64) + 1, kinds, length, width
    return Recording(Tracks(*states, *users, step, name, source), road())
