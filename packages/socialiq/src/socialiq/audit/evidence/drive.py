"""Seeded episodes of one driver in an environment or the intersection."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int8, Int64

from socialiq.audit.evidence.outcomes import Outcomes, Reference
from socialiq.audit.profile.environment import LARGEST_SEED, Environment
from socialiq.evaluation.context_rollouts import losses_of
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.simulate import Actor, SoftActor, SoftPolicy, Step, simulate
from socialiq.evaluation.simulators import GymActor, GymSimulator
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Ending
from socialiq.worlds.intersection.batch import Batch


class ByRule(NamedTuple):
    """A declared rule of the angle.

    Attributes:
        rule: The rule.
        dial: Reference dial, which the rule turns; None in a gridworld, where the optima are known.
    """

    rule: AngleRule
    dial: DialPolicy | None


class Summed(NamedTuple):
    """Totals, last ending, contact and length of each episode."""

    totals: Float[np.ndarray, "episode 2"]
    ending: Int8[np.ndarray, " episode"]
    contact: Int8[np.ndarray, " episode"]
    length: Int64[np.ndarray, " episode"]


def summed(steps: Iterator[Step], episodes: int) -> Summed:
    """Return what the decisions of episodes add up to.

    Args:
        steps: The decisions, until each episode has ended.
        episodes: Number of episodes.
    """
    totals, length = np.zeros((episodes, 2)), np.zeros(episodes, np.int64)
    ending, contact = np.zeros(episodes, np.int8), np.zeros(episodes, np.int8)
    for one in steps:
        which = one.episode[one.running]
        for side, reward in enumerate(one.made.rewards):
            totals[which, side] += np.atleast_1d(reward)[one.running]
        length[which] += 1
        ending[which] = one.made.ending[one.running]
        if hasattr(one.made, "contact"):
            contact[which] = one.made.contact[one.running]
    assert (ending != Ending.NONE).all()
    return Summed(totals, ending, contact, length)


def outcomes_of(
    name: str, steps: Iterator[Step], episodes: int, angles: tuple[float, ...] = ()
) -> Outcomes:
    """Return the outcomes of a driver whose simulator reports contacts, or none at all.

    Args:
        name: Name of the driver.
        steps: Its decisions.
        episodes: Number of episodes.
        angles: Angles for `Outcomes`.
    """
    return Outcomes(name, *summed(steps, episodes), angles)


def drive_environment(
    world: Environment,
    driver: Reference,
    seeds: Int64[np.ndarray, " episode"],
    deterministic: bool = True,
) -> Outcomes:
    """Run a driver on one episode of an environment for each seed.

    Fault is not known: every collision counts as the driver's.

    Args:
        world: The environment.
        driver: The driver.
        seeds: Seeds of the episodes; a stochastic `SoftPolicy` draws from them too.
        deterministic: Whether it takes its best action.

    Raises:
        UserError: If the environment or the driver fails, or an episode doesn't end.
    """
    policy = driver.policy
    actor = GymActor(policy, deterministic)
    if not deterministic and isinstance(policy, SoftPolicy):
        actor = SoftActor(policy, size=1)
    return outcomes_of(driver.name, steps_of(world, actor, seeds), len(seeds), driver.angles)


def steps_of(
    world: Environment, actor: Actor, seeds: Int64[np.ndarray, " episode"]
) -> Iterator[Step]:
    """Yield an actor's decisions on one episode of an environment for each seed.

    Raises:
        UserError: As `drive_environment`.
    """
    return simulate(GymSimulator(world.env, modulus=LARGEST_SEED), actor, seeds)


def drive_intersection(
    batch: Batch,
    driver: Reference,
    seeds: Int64[np.ndarray, " episode"],
    deterministic: bool = True,
    by_rule: ByRule | None = None,
    candidates: tuple[float, ...] = (),
) -> Outcomes:
    """Run a driver on one episode of the intersection for each seed.

    Args:
        batch: The episodes that run side by side.
        driver: The driver.
        seeds: Seeds of the episodes.
        deterministic: Whether it takes its best action.
        by_rule: A declared rule and its reference dial; None without one.
        candidates: Angles at which decision losses are measured besides, in degrees.
    """
    found = None
    if by_rule is None:
        made = episodes_of(batch, driver.policy, seeds, deterministic)
    else:
        assert by_rule.dial is not None  # `Collection.of` refuses a rule without it
        made, found = losses_of(
            batch, driver.policy, seeds, by_rule.dial, by_rule.rule, candidates, deterministic
        )
    return Outcomes(
        name=driver.name,
        totals=np.stack(made.totals, axis=1),
        ending=made.ending.astype(np.int8),
        contact=made.contact.astype(np.int8),
        length=made.length,
        angles=driver.angles,
        lost=None if found is None else found.declared.sum(axis=1),
        contexts=found,
    )
