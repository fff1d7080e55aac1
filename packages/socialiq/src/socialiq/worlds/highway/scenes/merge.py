"""highway-env's merge: two lanes of a motorway, and a third that ends."""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.highway.network import APPROACH, CONFLICT, EXIT, Lane, Network, sine, straight
from socialiq.worlds.highway.scene import UNIFORM, Road, Scene, entry, sight

LENGTHS = 150.0, 80.0, 80.0, 150.0  # before, converging, merging, after, m
LANES = 0.0, 4.0  # y of the motorway's lanes, m
RAMP = 6.5 + 4 + 4  # y of the ramp's beginning
SWING = 3.25  # half of the way sideways that the ramp makes
PULSATION = 2 * math.pi / (2 * LENGTHS[1])  # rad/m
ARRIVAL = 370.0  # m from the beginning


def network() -> Network:
    """Return the motorway a-b-c-d and the ramp j-k-b, which has a lane of its own up to c."""
    roads = Network()
    before, converging, merged, end = (sum(LENGTHS[:count]) for count in range(1, 5))
    for y in LANES:
        roads.add("a", "b", Lane(straight((0.0, y), (converging, y)), APPROACH))
        roads.add("b", "c", Lane(straight((converging, y), (merged, y)), CONFLICT))
        roads.add("c", "d", Lane(straight((merged, y), (end, y)), EXIT))
    roads.add("j", "k", Lane(straight((0.0, RAMP), (before, RAMP)), APPROACH, forbidden=True))
    middle = RAMP - SWING
    swing = sine((before, middle), (converging, middle), SWING, PULSATION, math.pi / 2)
    roads.add("k", "b", Lane(swing, APPROACH, forbidden=True))
    y = _end_of_ramp()
    last = straight((converging, y), (converging + LENGTHS[2], y))
    roads.add("b", "c", Lane(last, CONFLICT, forbidden=True))
    return roads


def _end_of_ramp() -> float:
    return RAMP - SWING + SWING * math.sin(PULSATION * LENGTHS[1] + math.pi / 2)


def scene() -> Scene:
    """Return the scene: three others on the motorway, one on the ramp, and the ramp's end."""
    roads = network()
    motorway, ramp = roads.lane("a", "b", 0), roads.lane("j", "k", 0)
    spread = {"lanes": 2, "along_spread": 5.0, "speed_spread": 1.0, "spread": UNIFORM}
    traffic = [(90.0, 29.0), (70.0, 31.0), (5.0, 31.5)]
    entries = [
        entry(motorway + 1, 30.0, 30.0),
        *(entry(motorway, along, speed, **spread) for along, speed in traffic),
        entry(ramp, 110.0, 20.0, target_speed=30.0),
    ]
    road = Road(
        lanes=roads.lanes(["a", "b", "c", "d"]),
        successors=roads.successors(),
        routes=roads.routes([]),
        entries=np.stack(entries),
        obstacles=np.array([[sum(LENGTHS[:3]), _end_of_ramp()]]),
        sight=sight(
            x=400.0, y=20.0, vx=40.0, vy=40.0, arrival=ARRIVAL - sum(LENGTHS[:3]), relative=True
        ),
    )
    defaults = {"duration": 40.0, "target_speeds": (20.0, 25.0, 30.0), "progress_unit": 93.0}
    return Scene("merge", road, defaults, "highway_env.envs.merge_env:MergeEnv", {})
