"""Collect evidence: the policy and its references drive the same episodes, of several kinds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int64

from socialiq.audit.evidence.drive import (
    CANDIDATES,
    ByRule,
    Course,
    exact_optima,
    exactly_as_declared,
    trivial_drivers,
)
from socialiq.audit.evidence.outcomes import AS_DECLARED, Evidence, Reference, events_of
from socialiq.audit.profile.environment import Environment
from socialiq.errors import UserError
from socialiq.evaluation.episodes import CONFLICT_SECONDS
from socialiq.statistics.comparisons import Difference, paired_difference
from socialiq.statistics.intervals import Share, wilson
from socialiq.types import Policy
from socialiq.worlds.highway.state import FEATURES
from socialiq.worlds.intersection import policies
from socialiq.worlds.registry import INTERSECTIONS
from socialiq.worlds.situation import ContextPolicy
from socialiq.worlds.world import World

REPEATED = 3  # episodes of an environment that are started twice, to check its seeding


def collect_evidence(
    world: World,
    policy: Policy,
    seeds: Int64[np.ndarray, " episode"],
    references: Sequence[Reference] = (),
    name: str = "policy",
    deterministic: bool = True,
    threads: int = 1,
    side_by_side: int | None = None,
    by_rule: ByRule | None = None,
) -> Evidence:
    """Run the policy, its references and trivial drivers on the same episodes.

    In a gridworld the exact optima are always among the references, elsewhere the world's own
    (`World.references`); an environment has none. Trivial drivers run in every world.
    The result has some 50 bytes for each episode and driver.

    Args:
        world: World of the declaration: `Profile.world()`.
        policy: The policy under audit.
        seeds: Seeds of the episodes: `outcomes.episode_seeds`.
        references: Further drivers, for instance a family of policies over the angles.
        name: Name of the policy in the report.
        deterministic: Whether the policy takes its best action; references always do.
        threads: Number of threads of a compiled world.
        side_by_side: Number of episodes at once on a road. The last bits of a network's output may
            depend on it, so parts of one collection need the same number.
        by_rule: A declared rule of the angle, in a gridworld or at the intersection: decision
            losses are measured too.

    Raises:
        UserError: If the policy's answers are invalid, or two drivers have one name.
    """
    drivers = [*(Reference(rule, world.driver(rule)) for rule in world.references), *references]
    if not drivers and not world.is_exact:
        raise UserError(
            f"{world.name} has no reference drivers: name at least one with --reference DRIVER"
        )
    if isinstance(world, Environment):
        for seed in seeds[:REPEATED]:
            world.check_repeats(int(seed))
    if by_rule is not None and by_rule.dial is not None:
        drivers.append(Reference(AS_DECLARED, ContextPolicy.of(by_rule.dial, by_rule.rule)))
    course = Course(world, seeds, side_by_side, threads, by_rule)
    audited = course.drive(Reference(name, policy), deterministic, CANDIDATES)
    compared = [*(exact_optima(course) if world.is_exact else ()), *map(course.drive, drivers)]
    if by_rule is not None and world.is_exact:
        compared.append(exactly_as_declared(course, by_rule.rule))
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=audited,
        references=tuple(compared),
        strata=strata_of(course),
        trivial=trivial_drivers(course),
    )


NO_CROSSING = "nobody crosses"  # codespell:ignore
"""Label of episodes without a crossing vehicle; a key of written reports."""

_SOON = 5  # steps of a gridworld within which the first conflicts are decided


def strata_of(course: Course) -> dict[str, np.ndarray]:
    """Return labels of all episodes by stratification; none in an environment of other code.

    They depend on the seeds alone: in a gridworld on the draws that decide where vehicles spawn,
    on roads on the ego's first observation.
    """
    batch, seeds, name = course.batch, course.seeds, course.world.name
    if course.world.is_exact:
        batch.reset(seeds)
        return gridworld_strata(batch.save().fate, batch.table.world.chance)
    label = {"recorded-junction": junction_strata}.get(name)
    label = intersection_strata if name in INTERSECTIONS else label
    if label is None:
        return {}
    blocks = []
    for first in range(0, len(seeds), batch.size):
        block = seeds[first : first + batch.size]
        blocks.append(label(batch.reset(block, rows=np.arange(len(block)))[: len(block)]))
    return {
        stratification: np.concatenate([labels[stratification] for labels in blocks])
        for stratification in blocks[0]
    }


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
    vehicles = (rows[:, 1:, 0] > 0).sum(axis=1)
    crossing = policies.conflict(rows, CONFLICT_SECONDS)
    other_road = np.abs(rows[:, 1:, 3]) > np.abs(rows[:, 1:, 4])
    met, yielding = crossing.any(axis=1), (crossing & other_road).any(axis=1)
    return {
        "density": np.select([vehicles <= 1, vehicles <= 3], ["0 to 1", "2 to 3"], "4 or more"),
        "conflict": np.where(met, "at once", "none yet"),
        "right_of_way": np.select([yielding, met], ["theirs", "oncoming"], NO_CROSSING),
    }


def junction_strata(observation: Float32[np.ndarray, "episode feature"]) -> dict[str, np.ndarray]:
    """Return labels from the ego's first observation: the number of other rows, closed lines too.

    Args:
        observation: Observation of each episode after the reset.
    """
    rows = observation.reshape(len(observation), -1, len(FEATURES))
    count = (rows[:, 1:, 0] > 0).sum(axis=1)
    return {"density": np.select([count <= 3, count <= 7], ["0 to 3", "4 to 7"], "8 or more")}


def gridworld_strata(
    fate: Float[np.ndarray, "episode draw"], chance: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """Return labels from the draws that decide where vehicles spawn; none if nothing is drawn.

    Args:
        fate: Uniform numbers of each episode: for the first state, then for every step.
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
    reference_values, ours = best.values(angle), evidence.policy.values(angle)
    events, strata = events_of(evidence.policy), []
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
