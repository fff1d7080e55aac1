"""Groups of drivers in a fleet: their fate, and what invaders gain among residents (9.4).

Rule-bound traffic enters beside the fleet by the junction's `spawn_probability`.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from socialiq.errors import UserError
from socialiq.evaluation.fleet import drive as drive_together
from socialiq.nn.dial_policy import DialPolicy
from socialiq.statistics.intervals import normal_mean
from socialiq.types import Ending, Policy, Row
from socialiq.worlds.highway.world import RoadWorld

SIDE_BY_SIDE = 256  # episodes at once
DURATION = 30.0  # s; several vehicles need longer than one
MEASURES = "r_env", "r_social", "arrival", "collision", "timeout", "seconds"


class Fleet(NamedTuple):
    """Episodes of a fleet: a row for each episode, a column for each agent."""

    group: Int[np.ndarray, "episode agent"]  # number of the agent's driver
    r_env: Float[np.ndarray, "episode agent"]  # sums until the agent's end
    r_social: Float[np.ndarray, "episode agent"]
    ending: Int[np.ndarray, "episode agent"]  # values of `Ending`
    seconds: Float[np.ndarray, "episode agent"]  # until the agent's end

    def means(self, group: int) -> dict[str, Float[np.ndarray, " episode"]]:
        """Return `MEASURES` of a group by episode, of those that have one of it."""
        present = self.group == group
        rows = present.any(axis=1)
        columns = {
            "r_env": self.r_env,
            "r_social": self.r_social,
            "arrival": self.ending == Ending.ARRIVAL,
            "collision": self.ending == Ending.COLLISION,
            "timeout": self.ending == Ending.TIMEOUT,
            "seconds": self.seconds,
        }
        count = present[rows].sum(axis=1)
        return {
            name: np.where(present, column, 0.0)[rows].sum(axis=1) / count
            for name, column in columns.items()
        }


def mixed(episodes: int, counts: Sequence[int], seed: int) -> Int[np.ndarray, "episode agent"]:
    """Return the number of each agent's group: so many of each, in random places by the seed."""
    groups = np.repeat(np.arange(len(counts)), counts)
    return np.random.default_rng(seed).permuted(np.tile(groups, (episodes, 1)), axis=1)


def drive(
    world: RoadWorld,
    policies: Sequence[Policy],
    group: Int[np.ndarray, "episode agent"],
    seeds: Sequence[int] | np.ndarray,
) -> Fleet:
    """Drive one greedy episode for each seed, in blocks.

    Args:
        world: Of `worlds.registry.make_fleet`.
        policies: Driver of each group, of the observations of one ego.
        group: Number of each agent's group.
        seeds: Of the episodes.

    Raises:
        UserError: If there is no seed.
    """
    if not len(seeds):
        raise UserError("episodes must be at least 1, got 0")
    blocks = []
    for first in range(0, len(seeds), SIDE_BY_SIDE):
        rows = slice(first, first + SIDE_BY_SIDE)
        drivers, chosen = group[rows], np.asarray(seeds)[rows]
        driven = drive_together(world.batch(len(drivers)), policies, chosen, drivers)
        seconds = driven.decisions / world.options.policy_frequency
        blocks.append((drivers, *driven.rewards, driven.ending, seconds))
    return Fleet(*(np.concatenate(columns) for columns in zip(*blocks, strict=True)))


def uniform_fleets(
    world: RoadWorld, dial: DialPolicy, angles: Sequence[float], seeds: np.ndarray
) -> dict[float, Fleet]:
    """Return fleets in which everybody is the dial at one angle, in degrees, by that angle."""
    everybody = np.zeros((len(seeds), world.options.agents), np.int64)
    return {angle: drive(world, [dial.at(angle)], everybody, seeds) for angle in angles}


def invasions(
    world: RoadWorld,
    dial: DialPolicy,
    uniform: Mapping[float, Fleet],
    seeds: np.ndarray,
    invaders: int,
    seed: int,
) -> Iterator[Row]:
    """Yield what so many invaders of each angle gain in a fleet of residents of each other angle.

    Their places are drawn by the seed.
    """
    group = mixed(len(seeds), (world.options.agents - invaders, invaders), seed)
    for resident, invader in itertools.permutations(uniform, 2):
        mixture = drive(world, [dial.at(resident), dial.at(invader)], group, seeds)
        yield {"resident": resident, "invader": invader, **fitness(mixture, uniform[resident])}


def summary(fleet: Fleet, group: int) -> Row:
    """Return the means of `MEASURES` of a group with 95 % intervals over episodes."""
    row: Row = {}
    for name, values in fleet.means(group).items():
        row |= normal_mean(name, values)
    return row


def fitness(mixture: Fleet, uniform: Fleet) -> Row:
    """Return what invaders (group 1) get more than everybody in a fleet of the residents, by r_env.

    Both fleets drove the same episodes. `residents` is what the residents (group 0) lose by them.
    """
    alone = uniform.means(0)["r_env"]
    row: Row = {}
    for name, group in (("gain", 1), ("residents", 0)):
        row |= normal_mean(name, mixture.means(group)["r_env"] - alone)
    return row
