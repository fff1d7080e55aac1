"""Collect evidence: the policy and its references drive the same episodes, in kinds (strata)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int64

from socialiq.audit.evidence.drive import (
    ByRule,
    drive_environment,
    drive_grid,
    drive_intersection,
    exact_optima,
    exactly_as_declared,
    fates,
)
from socialiq.audit.evidence.drive_junction import (
    drive_junction,
    junction_strata,
    rules_at_junction,
    trivial_at_junction,
)
from socialiq.audit.evidence.outcomes import AS_DECLARED, Evidence, Reference, events_of
from socialiq.audit.evidence.trivial import (
    trivial_at_intersection,
    trivial_in_environment,
    trivial_in_grid,
)
from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.junction import Junction
from socialiq.audit.profile.profile import World
from socialiq.errors import UserError
from socialiq.evaluation.conflicts import CONFLICT_SECONDS
from socialiq.evaluation.context import DecisionLosses
from socialiq.statistics.comparisons import Difference, paired_difference
from socialiq.statistics.intervals import Share, wilson
from socialiq.types import Policy
from socialiq.worlds.context_policy import ContextPolicy
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.policies import policy as rule
from socialiq_recordings.world.batch import JunctionBatch

NO_CROSSING = "nobody crosses"  # codespell:ignore
"""Label of episodes without a crossing vehicle; a key of written reports."""

_SOON = 5  # steps of a gridworld within which the first conflicts are decided


def intersection_strata(
    observation: Float32[np.ndarray, "episode feature"],
) -> dict[str, np.ndarray]:
    """Return labels from the ego's first observation.

    Args:
        observation: Observation of each episode after the reset.

    Returns:
        `density`: number of other vehicles in view. `conflict`: whether a crossing vehicle is in
        the junction, or will be within the 3 s in which the ego could be there. `right_of_way`:
        whether one of these is on the other road, which has priority over the ego's, or all
        are oncoming.
    """
    rows = policies.in_metres(observation)
    density = (rows[:, 1:, 0] > 0).sum(axis=1)
    crossing = policies.conflict(rows, CONFLICT_SECONDS)
    other_road = np.abs(rows[:, 1:, 3]) > np.abs(rows[:, 1:, 4])
    met, yielding = crossing.any(axis=1), (crossing & other_road).any(axis=1)
    return {
        "density": np.select([density <= 1, density <= 3], ["0 to 1", "2 to 3"], "4 or more"),
        "conflict": np.where(met, "at once", "none yet"),
        "right_of_way": np.select([yielding, met], ["theirs", "oncoming"], NO_CROSSING),
    }


def gridworld_strata(
    fate: Float[np.ndarray, "episode draw"], chance: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """Return labels from the draws that decide where vehicles spawn; none if nothing is drawn.

    Args:
        fate: Result of `drive.fates`.
        chance: Probability of each chance outcome; the last is a spawn.
    """
    if len(chance) == 1:
        return {}
    spawns = (fate[:, 1 : 1 + _SOON] >= 1.0 - chance[-1]).sum(axis=1)
    return {"density": np.select([spawns == 0, spawns == 1], ["0", "1"], "2 or more")}


_FEWEST = 2  # episodes of a stratum for the test of a difference


@dataclass(frozen=True)
class Stratum:
    """A policy in the episodes of one label.

    Attributes:
        stratification: For instance "density".
        label: For instance "4 or more".
        episodes: Number of episodes.
        regret: Regret towards the apparently best reference over all episodes, with a two-sided
            Student interval; None if there are fewer than two episodes. Intervals are of each
            stratum alone: of many, some miss.
        shares: Share of each criterion of the floor, with a two-sided Wilson interval.
    """

    stratification: str
    label: str
    episodes: int
    regret: Difference | None
    shares: dict[str, Share]


def stratified(
    evidence: Evidence, angle: float, reference: str, confidence: float = 0.95
) -> tuple[Stratum, ...]:
    """Break the evidence down by every stratification.

    The reference is the same in every stratum, so that regrets, weighted by episodes, add up to
    the whole regret.

    Args:
        evidence: Policy and references.
        angle: Declared angle in degrees.
        reference: Name of the reference to compare with: `RegretTest.best`.
        confidence: Confidence of the intervals.
    """
    best = next(driver for driver in evidence.references if driver.name == reference)
    reference_values, ours = (driver.values(angle) for driver in (best, evidence.policy))
    policy, strata = evidence.policy, []
    events = events_of(policy)
    for stratification, labels in evidence.strata.items():
        for label in np.unique(labels).tolist():
            rows = labels == label
            count = int(rows.sum())
            enough = count >= _FEWEST
            regret = (
                paired_difference(reference_values[rows], ours[rows], confidence)
                if enough
                else None
            )
            shares = {
                name: wilson(int(happened[rows].sum()), count, confidence)
                for name, happened in events.items()
            }
            strata.append(Stratum(stratification, label, count, regret, shares))
    return tuple(strata)


CANDIDATES = tuple(15.0 * step for step in range(7))
"""Angles at which the decision losses of the policy are measured in each context, in degrees."""

SIDE_BY_SIDE = 512  # episodes at once; memory doesn't grow with their number

REPEATED = 3  # episodes of an environment that are started twice, to check its seeding

Seeds = Int64[np.ndarray, " episode"]


RULES = ("go", "wait", "idm")
"""Rule-based drivers that are always among the references at the intersection: always faster,
always slower, and the Intelligent Driver Model."""


def collect_evidence(
    world: World,
    policy: Policy,
    seeds: Seeds,
    references: Sequence[Reference] = (),
    name: str = "policy",
    deterministic: bool = True,
    threads: int = 1,
    side_by_side: int | None = None,
    by_rule: ByRule | None = None,
) -> Evidence:
    """Run the policy, its references and trivial drivers on the same episodes.

    In a gridworld the exact optima are always among the references, at the intersection `RULES`,
    at a recorded junction `rules_at_junction`; an environment has no such references.
    Trivial drivers (`trivial`) run in every world. The result has some 50 bytes for each episode
    and driver.

    Args:
        world: World of the declaration: `Profile.world()`.
        policy: The policy under audit.
        seeds: Seeds of the episodes: `outcomes.episode_seeds`.
        references: Further drivers, for instance a family of policies over the angles.
        name: Name of the policy in the report.
        deterministic: Whether the policy takes its best action; references always do.
        threads: Number of threads of the intersection or the recorded junction.
        side_by_side: Number of their episodes at once. The last bits of a network's
            output may depend on it, so parts of one collection need the same number.
        by_rule: A declared rule of the angle, in a gridworld or at the intersection: decision
            losses are measured too.

    Raises:
        UserError: If the policy's answers are invalid, or two drivers have one name.
    """
    if isinstance(world, GridWorld):
        driver = Reference(name, policy)
        return _in_grid(world, driver, seeds, references, deterministic, by_rule)
    if isinstance(world, Environment):
        return _in_environment(world, Reference(name, policy), seeds, references, deterministic)
    if isinstance(world, Junction):
        batch = world.batch(side_by_side or min(SIDE_BY_SIDE, len(seeds)), threads)
        return _at_junction(world, batch, Reference(name, policy), seeds, references, deterministic)
    batch = world.batch(side_by_side or min(SIDE_BY_SIDE, len(seeds)), threads)
    drivers = [*(Reference(name, rule(name, options=world.options)) for name in RULES), *references]
    if by_rule is not None and by_rule.dial is not None:
        drivers += [Reference(AS_DECLARED, ContextPolicy.of(by_rule.dial, by_rule.rule))]
    driver = Reference(name, policy)
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=drive_intersection(batch, driver, seeds, deterministic, by_rule, CANDIDATES),
        references=tuple(
            drive_intersection(batch, driver, seeds, by_rule=by_rule) for driver in drivers
        ),
        strata=_strata(world.batch(min(SIDE_BY_SIDE, len(seeds))), seeds, intersection_strata),
        trivial=trivial_at_intersection(batch, seeds, by_rule),
    )


def _in_grid(
    world: GridWorld,
    policy: Reference,
    seeds: Seeds,
    references: Sequence[Reference],
    deterministic: bool,
    by_rule: ByRule | None,
) -> Evidence:
    table = tabulate(world).reachable_part()
    fate = fates(table, seeds)
    losses = None if by_rule is None else DecisionLosses(table, by_rule.rule, CANDIDATES)
    handed = [
        drive_grid(table, driver.policy, fate, driver.name, angles=driver.angles, losses=losses)
        for driver in references
    ]
    if by_rule is not None and losses is not None:
        handed += [exactly_as_declared(table, by_rule.rule, fate, losses)]
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=drive_grid(table, policy.policy, fate, policy.name, deterministic, losses=losses),
        references=(*exact_optima(table, fate, losses), *handed),
        strata=gridworld_strata(fate, world.chance),
        trivial=trivial_in_grid(table, fate, seeds, losses),
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
            f"{world.name} has no reference drivers: name at least one with --reference DRIVER"
        )
    for seed in seeds[:REPEATED]:
        world.check_repeats(int(seed))
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=drive_environment(world, policy, seeds, deterministic),
        references=tuple(drive_environment(world, driver, seeds) for driver in references),
        strata={},
        trivial=trivial_in_environment(world, seeds),
    )


def _at_junction(
    world: Junction,
    batch: JunctionBatch,
    policy: Reference,
    seeds: Seeds,
    references: Sequence[Reference],
    deterministic: bool,
) -> Evidence:
    drivers = [*rules_at_junction(world.n_actions), *references]
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=drive_junction(batch, policy, seeds, deterministic),
        references=tuple(drive_junction(batch, driver, seeds) for driver in drivers),
        strata=_strata(batch, seeds, junction_strata),
        trivial=trivial_at_junction(batch, seeds),
    )


def _strata(
    batch: Batch | JunctionBatch,
    seeds: Seeds,
    labels: Callable[[np.ndarray], dict[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """Return the strata of all episodes, from the first observations."""
    size, blocks = batch.size, []
    for first in range(0, len(seeds), size):
        block = seeds[first : first + size]
        observations = batch.reset(block, rows=np.arange(len(block)))[: len(block)]
        blocks.append(labels(observations))
    return {
        name: np.concatenate([block_labels[name] for block_labels in blocks]) for name in blocks[0]
    }
