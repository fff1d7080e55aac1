"""Seeded episodes of one driver in an environment, at the intersection or in a gridworld."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Int8, Int64

from socialiq.audit.evidence.outcomes import AS_DECLARED, Outcomes, Reference
from socialiq.audit.profile.environment import LARGEST_SEED, Environment
from socialiq.evaluation.context import (
    ContextLosses,
    DecisionLosses,
    by_turning,
    state_angles,
)
from socialiq.evaluation.context_rollouts import losses_of
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.simulate import Actor, SoftActor, SoftPolicy, Step, simulate
from socialiq.evaluation.simulators import FixedChance, GymActor, GymSimulator, TableSimulator
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.interface import Interface
from socialiq.social.angle import exact_weights, score
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.highway.state import Contact
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
    for step in steps:
        which = step.episode[step.running]
        for side, reward in enumerate(step.made.rewards):
            totals[which, side] += np.atleast_1d(reward)[step.running]
        length[which] += 1
        ending[which] = step.made.ending[step.running]
        if hasattr(step.made, "contact"):
            contact[which] = step.made.contact[step.running]
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
    losses = None
    if by_rule is None:
        episodes = episodes_of(batch, driver.policy, seeds, deterministic)
    else:
        assert by_rule.dial is not None  # `Collection.of` refuses a rule without it
        episodes, losses = losses_of(
            batch, driver.policy, seeds, by_rule.dial, by_rule.rule, candidates, deterministic
        )
    return Outcomes(
        name=driver.name,
        totals=np.stack(episodes.totals, axis=1),
        ending=episodes.ending.astype(np.int8),
        contact=episodes.contact.astype(np.int8),
        length=episodes.length,
        angles=driver.angles,
        lost=None if losses is None else losses.declared.sum(axis=1),
        contexts=losses,
    )


_CHANCE = 5190  # makes these draws independent of other draws from the same seed


def fates(
    table: Table, seeds: Sequence[int] | Int64[np.ndarray, " episode"]
) -> Float[np.ndarray, "episode draw"]:
    """Return the uniform numbers that decide the first state and every chance outcome.

    Args:
        table: The world or its reachable part.
        seeds: Seed of each episode.
    """
    draws = table.world.horizon + 1
    rows = [np.random.default_rng([_CHANCE, seed]).random(draws) for seed in np.asarray(seeds)]
    return np.array(rows).reshape(len(rows), draws)


def drive_grid(
    table: Table,
    policy: Policy,
    fate: Float[np.ndarray, "episode draw"],
    name: str,
    deterministic: bool = True,
    angles: tuple[float, ...] = (),
    losses: DecisionLosses | None = None,
) -> Outcomes:
    """Run a policy on the episodes of these fates, all side by side.

    Its input has all rows until the last episode has ended, so a policy with a memory keeps one
    for each row. The time is a last feature of the input if the policy has one feature more than
    the world.

    Args:
        table: The world or its reachable part.
        policy: The policy.
        fate: Result of `fates`.
        name: Name of the driver.
        deterministic: Passed to `predict`.
        angles: Angles for `Outcomes`.
        losses: Losses at a declared rule; None without one.

    Raises:
        UserError: If its answers are not one of the world's actions for each episode.
    """
    actor = GridActor(table, policy, name, deterministic)
    return _driven(table, actor, fate, name, angles, losses=losses)


def _driven(
    table: Table,
    actor: Actor,
    fate: Float[np.ndarray, "episode draw"],
    name: str,
    angles: tuple[float, ...],
    expected: RewardPair | None = None,
    losses: DecisionLosses | None = None,
) -> Outcomes:
    episodes = len(fate)
    simulator = TableSimulator(table, episodes, FixedChance(fate))
    steps = simulate(simulator, actor, np.arange(episodes))
    contexts = None if losses is None else losses.begin(episodes)
    if losses is not None and contexts is not None:
        steps = _noted(steps, losses, contexts, episodes)
    totals, ending, _, length = summed(steps, episodes)
    lost = None if contexts is None else contexts.declared.sum(axis=1)
    contact = np.where(ending == Ending.COLLISION, int(Contact.EGO_STRUCK), int(Contact.NONE))
    struck = contact.astype(np.int8)
    return Outcomes(name, totals, ending, struck, length, angles, expected, lost, contexts)


def _noted(
    steps: Iterator[Step], losses: DecisionLosses, contexts: ContextLosses, episodes: int
) -> Iterator[Step]:
    """Pass on the decisions, after their losses were added."""
    time = np.zeros(episodes, np.int64)
    for step in steps:
        which, rows = step.episode[step.running], step.running
        losses.note(contexts, which, time[which], step.observation[rows], step.action[rows])
        time[which] += 1
        yield step


class GridActor:
    """A policy in a gridworld, with a memory for each row and, if it has one, a time feature.

    Rows whose episode has ended stay in its input; their answers are not used.
    """

    def __init__(self, table: Table, policy: Policy, name: str, deterministic: bool) -> None:
        self._table, self._policy, self._name = table, policy, name
        self._deterministic, self._memory, self._time = deterministic, None, 0
        self._clock = getattr(policy, "n_features", None) == table.world.n_features + 1

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: all episodes begin at once."""

    def decide(self, observation: np.ndarray, running: np.ndarray) -> np.ndarray:
        """Return the policy's actions."""
        rows = len(running)
        features = self._table.states[observation].astype(np.float32)
        if self._clock:
            features = np.column_stack([features, np.full(rows, self._time, np.float32)])
        answer, self._memory = self._policy.predict(
            features,
            self._memory,
            episode_start=np.full(rows, self._time == 0),
            deterministic=self._deterministic,
        )
        self._time += 1
        return Interface(0, self._table.mdp.n_actions).checked(answer, rows, self._name)


def drive_actions(
    table: Table,
    actions: Int[np.ndarray, "time episode"],
    fate: Float[np.ndarray, "episode draw"],
    name: str,
    losses: DecisionLosses | None = None,
) -> Outcomes:
    """Run fixed actions, whatever happens, on the episodes of these fates.

    Args:
        table: The world or its reachable part.
        actions: Action of each episode at each time.
        fate: Result of `fates`.
        name: Name of the driver.
        losses: As for `drive_grid`.
    """
    return _driven(table, _FixedActor(actions), fate, name, angles=(), losses=losses)


class _FixedActor:
    """Actions by time and episode; all episodes begin at once."""

    def __init__(self, actions: Int[np.ndarray, "time episode"]) -> None:
        self._actions, self._time = actions, 0

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: the actions are fixed."""

    def decide(self, observation: np.ndarray, running: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Return the actions of the present time."""
        self._time += 1
        return self._actions[self._time - 1]


class _TimedActor:
    """Actions by time and state; all episodes begin at once."""

    def __init__(self, actions: Int[np.ndarray, "time state"]) -> None:
        self._actions, self._time = actions, 0

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: the table is the same for every episode."""

    def decide(self, observation: np.ndarray, running: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Return the actions of the table."""
        self._time += 1
        return self._actions[self._time - 1, observation]


def exactly_as_declared(
    table: Table,
    rule: AngleRule,
    fate: Float[np.ndarray, "episode draw"],
    losses: DecisionLosses,
) -> Outcomes:
    """Run the exact dial turned by a declared rule, which loses nothing by it.

    Args:
        table: The world's reachable part.
        rule: The rule.
        fate: Result of `fates`.
        losses: As for `drive_grid`.
    """
    chances = by_turning(table, state_angles(table, rule))
    exact = horizon_evaluation(table.mdp, chances, table.world.horizon).totals
    actor = _TimedActor(chances.argmax(axis=2))
    return _driven(table, actor, fate, AS_DECLARED, (), exact, losses)


def exact_optima(
    table: Table, fate: Float[np.ndarray, "episode draw"], losses: DecisionLosses | None = None
) -> tuple[Outcomes, ...]:
    """Run the exact optima of a gridworld on episodes of given fates, one for each vertex.

    Together they are the best at every angle, so the largest J(α) among them is J*(α) itself.
    They depend on the time; `Outcomes.expected` has the exact expectation.

    Args:
        table: The world's reachable part.
        fate: Result of `fates`.
        losses: As for `drive_grid`.
    """
    horizon, optima = table.world.horizon, []
    best: AttainableSet = attainable_set(table.mdp, horizon)
    for vertex in range(len(best.vertices)):
        low, high = best.supporting_interval(vertex)
        middle = (low + high) / 2
        reward = np.asarray(score(exact_weights(middle), table.mdp.rewards))
        optimum = horizon_optimum(table.mdp, reward, horizon)
        exact = horizon_evaluation(
            table.mdp, optimum.probabilities(table.mdp.n_actions), horizon
        ).totals
        name = f"optimum_{vertex:02d}"
        actor = _TimedActor(optimum.actions)
        optima.append(_driven(table, actor, fate, name, (low, high), exact, losses))
    return tuple(optima)
