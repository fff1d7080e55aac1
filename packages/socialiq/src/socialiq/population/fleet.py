"""Groups of drivers in a fleet: their fate, and what invaders gain among residents (9.4).

Rule-bound traffic enters in addition to the fleet by the junction's `spawn_probability`.
"""

import itertools
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np
from jaxtyping import Int

from socialiq.errors import UserError
from socialiq.evaluation import measures
from socialiq.evaluation.fleet import drive as drive_together
from socialiq.evaluation.measures import Episodes, joined
from socialiq.types import Policy, Row
from socialiq.worlds.highway.world import RoadWorld

SIDE_BY_SIDE = 256  # episodes at once
Label = TypeVar("Label", bound=Hashable)
DURATION = 30.0  # s; several vehicles need longer than one
MEASURES = "r_env", "r_social", "arrival", "collision", "timeout", "seconds"


def means(fleet: Episodes, group: int) -> Episodes:
    """Return `MEASURES` of a group by episode, of those that have one of it.

    Args:
        fleet: The fleet.
        group: Number of the group.
    """
    present = fleet.group == group
    rows = present.any(axis=1)
    count = present[rows].sum(axis=1)
    return Episodes(
        {name: np.where(present, fleet[name], 0.0)[rows].sum(axis=1) / count for name in MEASURES}
    )


def mixed(episodes: int, counts: Sequence[int], seed: int) -> Int[np.ndarray, "episode agent"]:
    """Return the number of each agent's group, in random places.

    Args:
        episodes: Number of episodes.
        counts: Number of agents of each group.
        seed: Seed of the places.
    """
    groups = np.repeat(np.arange(len(counts)), counts)
    return np.random.default_rng(seed).permuted(np.tile(groups, (episodes, 1)), axis=1)


def drive(
    world: RoadWorld,
    policies: Sequence[Policy],
    group: Int[np.ndarray, "episode agent"],
    seeds: Sequence[int] | np.ndarray,
) -> Episodes:
    """Drive one greedy episode for each seed, in blocks.

    Args:
        world: Of `worlds.registry.make_fleet`.
        policies: Driver of each group, of the observations of one ego.
        group: Number of each agent's group.
        seeds: Of the episodes.

    Returns:
        Columns (episode, agent) of `evaluation.fleet.drive`, with `group` and the `seconds` until
        the agent's end.

    Raises:
        UserError: If there is no seed.
    """
    if not len(seeds):
        raise UserError("episodes must be at least 1, got 0")
    blocks = list[Episodes]()
    for first in range(0, len(seeds), SIDE_BY_SIDE):
        rows = slice(first, first + SIDE_BY_SIDE)
        drivers = group[rows]
        chosen = np.asarray(seeds)[rows]
        blocks.append(drive_together(world.batch(len(drivers)), policies, chosen, drivers))
    fleet = joined(blocks)
    seconds = fleet.length / world.options.policy_frequency
    return Episodes(fleet, group=group, seconds=seconds)


def uniform_fleets(
    world: RoadWorld, drivers: Mapping[Label, Policy], seeds: np.ndarray
) -> dict[Label, Episodes]:
    """Return fleets in which every agent is one driver.

    Args:
        world: World of several agents, of `worlds.registry.make_fleet`.
        drivers: The drivers by label.
        seeds: Seed of each episode.

    Returns:
        A fleet by the driver's label.
    """
    everybody = np.zeros((len(seeds), world.options.agents), np.int64)
    return {label: drive(world, [driver], everybody, seeds) for label, driver in drivers.items()}


def invasions(
    world: RoadWorld,
    drivers: Mapping[Label, Policy],
    uniform: Mapping[Label, Episodes],
    seeds: np.ndarray,
    invaders: int,
    seed: int,
) -> Iterator[Row]:
    """Yield the gain of invaders of each driver in a fleet of residents of each other driver.

    Args:
        world: World of several agents, of `worlds.registry.make_fleet`.
        drivers: The drivers by label.
        uniform: Fleet of residents alone, by label; of the same seeds.
        seeds: Seed of each episode.
        invaders: Number of invaders in a fleet.
        seed: Seed of their places.

    Yields:
        A row for each pair of two drivers, with `resident`, `invader` and the columns of `fitness`.
    """
    group = mixed(len(seeds), (world.options.agents - invaders, invaders), seed)
    for resident, invader in itertools.permutations(uniform, 2):
        mixture = drive(world, [drivers[resident], drivers[invader]], group, seeds)
        yield {"resident": resident, "invader": invader, **fitness(mixture, uniform[resident])}


def summary(fleet: Episodes, group: int) -> Row:
    """Return the means of `MEASURES` of a group, with 95 % intervals over episodes.

    Args:
        fleet: The fleet.
        group: Number of the group.

    Returns:
        For each measure the columns of `normal_mean`.
    """
    return measures.summary(means(fleet, group), MEASURES)


def fitness(mixture: Episodes, uniform: Episodes) -> Row:
    """Return the gain in r_env of invaders over a fleet of residents alone.

    Args:
        mixture: Fleet with residents, group 0, and invaders, group 1.
        uniform: Fleet of residents alone, which drove the same episodes.

    Returns:
        `gain`, what invaders get more than agents of the uniform fleet, and `residents`, what
        residents do; each with its 95 % interval.
    """
    alone = means(uniform, 0).r_env
    gains = {"gain": means(mixture, 1).r_env - alone, "residents": means(mixture, 0).r_env - alone}
    return measures.summary(Episodes(gains), gains)
