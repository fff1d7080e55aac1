"""Shares of time in which two cyclists of `intersection-crosswalk-bicycles` overlap.

    python benchmarks/cyclists.py

1,000 episodes of each driver from seed 200,000,000 on. Two of one arm overlap if their middles are
less than a length apart.
"""

from __future__ import annotations

import numpy as np

from socialiq.evaluation.simulate import actor_of
from socialiq.types import Ending, Policy
from socialiq.worlds.highway.core.people import STANDS
from socialiq.worlds.intersection.options import CrosswalkOptions
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.road_users import MOVING, RIDES, ROAD_USERS, WAITING

FIRST, EPISODES = 200_000_000, 1000
APART = next(user.length for user in ROAD_USERS if user.name == "cyclist")  # m


def overlaps(world: Intersection, policy: Policy) -> tuple[float, float, float]:
    """Return shares: of time, of time that they move, and of episodes, with an overlap."""
    options, seeds = world.options, np.arange(FIRST, FIRST + EPISODES)
    assert isinstance(options, CrosswalkOptions)
    batch = world.batch(EPISODES, traced=True)
    actor, running = actor_of(batch, policy), np.ones(EPISODES, bool)
    batch.reset(seeds)
    actor.begin(np.arange(EPISODES), seeds)
    times, within = np.zeros((2, 2)), np.zeros(EPISODES, bool)
    while running.any():
        action = actor.decide(batch.observation, running)
        decisions = batch.step(action, auto_reset=False, rows=running)
        riders = batch.buffers.people_trace[:, :, batch.buffers.people["motion"][0] == RIDES]
        there = np.isin(riders["state"], (WAITING, MOVING)) & running[:, None, None]
        along = riders["along_x"] * riders["x"] + riders["along_y"] * riders["y"]
        place = np.where(there, 1000.0 * riders["arm"] + along, np.nan)
        near = np.abs(place[..., :, None] - place[..., None, :]) < APART
        overlapping = near.sum(axis=-1) > 1  # with itself, and with another
        moves = there & (riders["speed"] > STANDS)
        times += [[rows.sum(), (rows & overlapping).sum()] for rows in (there, moves)]
        within |= overlapping.any(axis=(1, 2))
        running &= decisions.ending == int(Ending.NONE)
    return times[0, 1] / times[0, 0], times[1, 1] / times[1, 0], float(within.mean())


if __name__ == "__main__":
    scene = Intersection(CrosswalkOptions(cyclist_rate=0.1))
    drivers = {name: scene.driver(name) for name in ("go", "wait", "gap_3s")}
    for name, driver in drivers.items():
        print(name, *(f"{share:.3f}" for share in overlaps(scene, driver)))
