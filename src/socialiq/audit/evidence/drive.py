"""Seeded episodes of one driver in a gridworld, an environment or the intersection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, Int8, Int64

from socialiq.audit.evidence.outcomes import Outcomes, Reference
from socialiq.audit.profile.environment import LARGEST_SEED, Environment
from socialiq.errors import UserError
from socialiq.evaluation.gym_simulator import GymActor, GymSimulator
from socialiq.evaluation.play import episodes_of
from socialiq.evaluation.simulate import Actor, SoftActor, SoftPolicy, Step, simulate
from socialiq.evaluation.table_simulator import FixedChance, TableSimulator
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.social.angle import exact_weights, score
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.state import Contact

_CHANCE = 5190  # what is drawn by a seed for this purpose is independent of all else drawn by it


def fates(
    table: Table, seeds: Sequence[int] | Int64[np.ndarray, " episode"]
) -> Float[np.ndarray, "episode draw"]:
    """The uniform numbers that decide the first state and every chance outcome of episodes.

    Args:
        table: The world or its reachable part.
        seeds: One for each episode.
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
) -> Outcomes:
    """Let a policy drive the episodes of these fates, all side by side.

    It is asked about all of them until the last has ended, so a policy with a memory keeps one
    for each row. It sees the time as a last feature if it says that it reads one more.

    Args:
        table: The world or its reachable part.
        policy: The driver.
        fate: Of `fates`.
        name: Of the driver.
        deterministic: Passed to `predict`.
        angles: For `Outcomes`.

    Raises:
        UserError: If its answers are not one of the world's actions for each episode.
    """
    return _driven(table, _GridActor(table, policy, name, deterministic), fate, name, angles)


def _driven(
    table: Table,
    actor: Actor,
    fate: Float[np.ndarray, "episode draw"],
    name: str,
    angles: tuple[float, ...],
    expected: RewardPair | None = None,
) -> Outcomes:
    episodes = len(fate)
    simulator = TableSimulator(table, episodes, FixedChance(fate))
    steps = simulate(simulator, actor, np.arange(episodes))
    totals, ending, length = _summed(steps, episodes)
    contact = np.where(ending == Ending.COLLISION, int(Contact.EGO_STRUCK), int(Contact.NONE))
    return Outcomes(name, totals, ending, contact.astype(np.int8), length, angles, expected)


class _GridActor:
    """A policy in a gridworld: it keeps a memory for each row, and may see the time.

    It is asked about rows that are over too, whose answers are not used.
    """

    def __init__(self, table: Table, policy: Policy, name: str, deterministic: bool) -> None:
        self._table, self._policy, self._name = table, policy, name
        self._deterministic, self._memory, self._time = deterministic, None, 0
        self._clock = getattr(policy, "n_features", None) == table.world.n_features + 1

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: all episodes begin at once."""

    def decide(self, observation: np.ndarray, running: np.ndarray) -> np.ndarray:
        """Ask the policy."""
        rows = len(running)
        seen = self._table.states[observation].astype(np.float32)
        if self._clock:
            seen = np.column_stack([seen, np.full(rows, self._time, np.float32)])
        answer, self._memory = self._policy.predict(
            seen,
            self._memory,
            episode_start=np.full(rows, self._time == 0),
            deterministic=self._deterministic,
        )
        self._time += 1
        return _checked(answer, rows, self._table.mdp.n_actions, self._name)


class _TimedActor:
    """Actions by time and state; all episodes begin at once."""

    def __init__(self, actions: Int[np.ndarray, "time state"]) -> None:
        self._actions, self._time = actions, 0

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: the table is the same for every episode."""

    def decide(self, observation: np.ndarray, running: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Look the actions up."""
        self._time += 1
        return self._actions[self._time - 1, observation]


class _Summed(NamedTuple):
    """Totals, last ending and length of each episode."""

    totals: Float[np.ndarray, "episode 2"]
    ending: Int8[np.ndarray, " episode"]
    length: Int64[np.ndarray, " episode"]


def _summed(steps: Iterator[Step], episodes: int) -> _Summed:
    totals, length = np.zeros((episodes, 2)), np.zeros(episodes, np.int64)
    ending = np.zeros(episodes, np.int8)
    for one in steps:
        which = one.episode[one.running]
        for side, reward in enumerate(one.made.rewards):
            totals[which, side] += np.atleast_1d(reward)[one.running]
        length[which] += 1
        ending[which] = one.made.ending[one.running]
    assert (ending != Ending.NONE).all()
    return _Summed(totals, ending, length)


def _checked(answer: Any, episodes: int, n_actions: int, name: str) -> np.ndarray:
    actions = np.asarray(answer)
    if actions.shape != (episodes,) or actions.dtype.kind not in "iu":
        raise UserError(
            f"{name} must answer {episodes} observations with as many whole numbers, "
            f"got {actions.dtype} of shape {actions.shape}"
        )
    if actions.min() < 0 or actions.max() >= n_actions:
        raise UserError(f"{name} must choose actions from 0 to {n_actions - 1}")
    return actions.astype(np.int64)


def exact_optima(table: Table, fate: Float[np.ndarray, "episode draw"]) -> tuple[Outcomes, ...]:
    """The exact optima of a gridworld on episodes of given fates, one for each vertex.

    Together they are the best at every angle, so the largest J(α) among them is J*(α) itself.
    Each knows the time; `Outcomes.expected` has its exact expectation.

    Args:
        table: The world's reachable part.
        fate: Of `fates`.
    """
    horizon, found = table.world.horizon, []
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
        found.append(_driven(table, _TimedActor(optimum.actions), fate, name, (low, high), exact))
    return tuple(found)


def drive_environment(
    world: Environment,
    driver: Reference,
    seeds: Int64[np.ndarray, " episode"],
    deterministic: bool = True,
) -> Outcomes:
    """Let a driver drive one episode for each seed.

    It is not known who struck whom: every collision counts as the driver's.

    Args:
        world: Where.
        driver: The driver.
        seeds: Of the episodes; a `SoftPolicy` that is not deterministic draws by them too.
        deterministic: Whether it takes its best action.

    Raises:
        UserError: If the environment or the driver fails, or an episode doesn't end.
    """
    policy = driver.policy
    actor = GymActor(policy, deterministic)
    if not deterministic and isinstance(policy, SoftPolicy):
        actor = SoftActor(policy, size=1)
    simulator = GymSimulator(world.env, modulus=LARGEST_SEED)
    totals, ending, length = _summed(simulate(simulator, actor, seeds), len(seeds))
    contact = np.zeros(len(seeds), np.int8)
    return Outcomes(driver.name, totals, ending, contact, length, driver.angles)


def drive_intersection(
    batch: Batch,
    driver: Reference,
    seeds: Int64[np.ndarray, " episode"],
    deterministic: bool = True,
) -> Outcomes:
    """Let a driver drive one episode of the intersection for each seed.

    Args:
        batch: Where, and how many episodes run side by side.
        driver: The driver.
        seeds: Of the episodes.
        deterministic: Whether it takes its best action.
    """
    made = episodes_of(batch, driver.policy, seeds, deterministic)
    return Outcomes(
        name=driver.name,
        totals=np.stack(made.totals, axis=1),
        ending=made.ending.astype(np.int8),
        contact=made.contact.astype(np.int8),
        length=made.length,
        angles=driver.angles,
    )
