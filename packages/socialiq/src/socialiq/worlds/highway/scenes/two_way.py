"""highway-env's two-way road: the ego overtakes where others come towards it."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.network import CONFLICT, Lane, Network, straight
from socialiq.worlds.highway.scene import NORMAL, Road, Scene, entry, sight

LENGTH = 800.0  # m
LANES = 0.0, 4.0  # y of the left lane, which both directions use, and of the right one, m


def network() -> Network:
    """Return the road a-b of two lanes, and the road b-a on the left one."""
    roads = Network()
    for y in LANES:
        roads.add("a", "b", Lane(straight((0.0, y), (LENGTH, y)), CONFLICT))
    roads.add("b", "a", Lane(straight((LENGTH, LANES[0]), (0.0, LANES[0])), CONFLICT))
    return roads


def scene() -> Scene:
    """Return the scene: three others ahead of the ego, two that come towards it; none overtakes."""
    roads = network()
    right, oncoming = roads.lane("a", "b", 1), roads.lane("b", "a", 0)
    driver = {"along_spread": 10.0, "spread": NORMAL, "changes": False}
    ahead = [entry(right, 70.0 + 40.0 * i, 24.0, speed_spread=2.0, **driver) for i in range(3)]
    against = [
        entry(oncoming, 200.0 + 100.0 * i, 20.0, speed_spread=5.0, **driver) for i in range(2)
    ]
    road = Road(
        lanes=roads.lanes(["a", "b"]),
        successors=roads.successors(),
        routes=roads.routes([]),
        entries=np.stack([entry(right, 30.0, 30.0), *ahead, *against]),
        obstacles=np.zeros((0, 2)),
        sight=sight(x=200.0, y=20.0, vx=80.0, vy=40.0, relative=True),
    )
    defaults = {"duration": 15.0, "target_speeds": (20.0, 25.0, 30.0), "progress_unit": 93.0}
    return Scene("two_way", road, defaults, "highway_env.envs.two_way_env:TwoWayEnv")
