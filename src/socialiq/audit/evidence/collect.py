"""Collect evidence: the policy and its references drive the same episodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int64

from socialiq.audit.evidence.drive import (
    drive_environment,
    drive_grid,
    drive_intersection,
    exact_optima,
    fates,
)
from socialiq.audit.evidence.outcomes import Evidence, Reference
from socialiq.audit.evidence.strata import gridworld_strata, intersection_strata
from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.scenario import World
from socialiq.errors import UserError
from socialiq.types import Policy
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.intersection.policies import policy as rule
from socialiq.worlds.intersection.world import Intersection

SIDE_BY_SIDE = 512  # episodes at once; memory doesn't grow with their number

REPEATED = 3  # episodes of an environment that are begun twice, to see that the seed decides them

Seeds = Int64[np.ndarray, " episode"]


RULES = ("go", "wait", "idm")
"""Rule-based drivers that are always among the references at the intersection."""


def by_rule() -> tuple[Reference, ...]:
    """Always faster, always slower, and the Intelligent Driver Model at the ego's seat."""
    return tuple(Reference(name, rule(name)) for name in RULES)


def collect_evidence(
    world: World,
    policy: Policy,
    seeds: Seeds,
    references: Sequence[Reference] = (),
    name: str = "policy",
    deterministic: bool = True,
    threads: int = 1,
    side_by_side: int | None = None,
) -> Evidence:
    """Let the policy and its references drive the same episodes.

    In a gridworld the exact optima are always among the references, at the intersection go, wait
    and the Intelligent Driver Model; an environment has none of its own. Kept are a few numbers of
    each episode and driver, some 50 bytes.

    Args:
        world: Of the declaration: `Profile.world()`.
        policy: The policy under audit.
        seeds: Of the episodes: `seeds.episode_seeds`.
        references: Further drivers, for instance a family of policies over the angles.
        name: Of the policy, for the report.
        deterministic: Whether the policy takes its best action; references always do.
        threads: That share the intersection's episodes.
        side_by_side: Episodes of the intersection at once. The last bits of a network's answers
            may depend on it, so parts of one collection are given the same.

    Raises:
        UserError: If the policy's answers are invalid, or two drivers have one name.
    """
    if isinstance(world, GridWorld):
        return _in_grid(world, policy, seeds, references, name, deterministic)
    if isinstance(world, Environment):
        return _in_environment(world, Reference(name, policy), seeds, references, deterministic)
    batch = world.batch(side_by_side or min(SIDE_BY_SIDE, len(seeds)), threads)
    drivers = [*by_rule(), *references]
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=drive_intersection(batch, Reference(name, policy), seeds, deterministic),
        references=tuple(drive_intersection(batch, one, seeds) for one in drivers),
        strata=_first_sight(world, seeds),
    )


def _in_grid(
    world: GridWorld,
    policy: Policy,
    seeds: Seeds,
    references: Sequence[Reference],
    name: str,
    deterministic: bool,
) -> Evidence:
    table = tabulate(world).reachable_part()
    fate = fates(table, seeds)
    handed = [
        drive_grid(table, one.policy, fate, one.name, angles=one.angles) for one in references
    ]
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=drive_grid(table, policy, fate, name, deterministic),
        references=(*exact_optima(table, fate), *handed),
        strata=gridworld_strata(fate, world.chance),
    )


def _in_environment(
    world: Environment,
    policy: Reference,
    seeds: Seeds,
    references: Sequence[Reference],
    deterministic: bool,
) -> Evidence:
    if not references:
        raise UserError(
            f"nothing is known about drivers in {world.name}: name at least one to compare with, "
            "--reference DRIVER"
        )
    for seed in seeds[:REPEATED]:
        world.check_repeats(int(seed))
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=drive_environment(world, policy, seeds, deterministic),
        references=tuple(drive_environment(world, one, seeds) for one in references),
        strata={},
    )


def _first_sight(world: Intersection, seeds: Seeds) -> dict[str, np.ndarray]:
    """Strata of all episodes, from what is seen when they begin."""
    size = min(SIDE_BY_SIDE, len(seeds))
    batch, parts = world.batch(size), []
    for first in range(0, len(seeds), size):
        block = seeds[first : first + size]
        seen = batch.reset(block, rows=np.arange(len(block)))[: len(block)]
        parts.append(intersection_strata(seen))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
