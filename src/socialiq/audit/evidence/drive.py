"""Seeded episodes of one driver in a gridworld, an environment or the intersection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int, Int64

from socialiq.audit.evidence.outcomes import Outcomes, Reference
from socialiq.audit.profile.environment import LARGEST_SEED, Environment
from socialiq.errors import UserError
from socialiq.evaluation.play import SOFT, SoftPolicy, episodes_of
from socialiq.evaluation.rollout import steps
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.social.angle import exact_weights, score
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.state import Contact

_CHANCE = 5190  # what is drawn by a seed for this purpose is independent of all else drawn by it

Decide = Callable[[int, np.ndarray], np.ndarray]
"""From the time and the state of each episode to actions."""


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
        policy: Who drives.
        fate: Of `fates`.
        name: Of the driver.
        deterministic: Passed to `predict`.
        angles: For `Outcomes`.

    Raises:
        UserError: If its answers are not one of the world's actions for each episode.
    """
    wanted = getattr(policy, "n_features", None)
    clock = wanted == table.world.n_features + 1
    memory: list[Any] = [None]

    def decide(time: int, state: np.ndarray) -> np.ndarray:
        seen = _observation(table, state, time, clock)
        begins = np.full(len(state), time == 0)
        answer, memory[0] = policy.predict(
            seen, memory[0], episode_start=begins, deterministic=deterministic
        )
        return _checked(answer, len(state), table.mdp.n_actions, name)

    return _driven(table, decide, fate, name, angles)


def drive_timed(
    table: Table,
    actions: Int[np.ndarray, "time state"],
    fate: Float[np.ndarray, "episode draw"],
    name: str,
    angles: tuple[float, ...],
    expected: RewardPair,
) -> Outcomes:
    """Let a table of actions by time and state drive the episodes; the rest is for `Outcomes`."""
    return _driven(table, lambda time, state: actions[time, state], fate, name, angles, expected)


def _driven(
    table: Table,
    decide: Decide,
    fate: Float[np.ndarray, "episode draw"],
    name: str,
    angles: tuple[float, ...] = (),
    expected: RewardPair | None = None,
) -> Outcomes:
    mdp, episodes = table.mdp, len(fate)
    state = _outcome(np.broadcast_to(mdp.initial, (episodes, mdp.n_states)), fate[:, 0])
    totals = np.zeros((episodes, 2))
    ending, length = np.zeros(episodes, np.int8), np.zeros(episodes, np.int64)
    running = np.ones(episodes, bool)
    for time in range(table.world.horizon):
        action = decide(time, state)
        for side, reward in enumerate(mdp.rewards):
            totals[running, side] += reward[state, action][running]
        chance = _outcome(mdp.probability[state, action], fate[:, time + 1])
        reached = mdp.ending[state, action, chance]
        ending[running] = reached[running]
        length[running] += 1
        running &= reached == Ending.NONE
        # Rows that are over stand still where they were: their answers are not used.
        state = np.where(running, mdp.successor[state, action, chance], state)
        if not running.any():
            break
    ending[running] = int(Ending.TIMEOUT)
    contact = np.where(ending == Ending.COLLISION, int(Contact.EGO_STRUCK), int(Contact.NONE))
    return Outcomes(name, totals, ending, contact.astype(np.int8), length, angles, expected)


def _outcome(
    chances: Float[np.ndarray, "episode outcome"], uniform: Float[np.ndarray, " episode"]
) -> Int[np.ndarray, " episode"]:
    """Index of the outcome that a uniform number falls on."""
    found = (uniform[:, None] >= chances.cumsum(axis=1)).sum(axis=1)
    return np.minimum(found, chances.shape[1] - 1)


def _observation(
    table: Table, state: np.ndarray, time: int, clock: bool
) -> Float32[np.ndarray, "episode feature"]:
    seen = table.states[state].astype(np.float32)
    return np.column_stack([seen, np.full(len(seen), time, np.float32)]) if clock else seen


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
        found.append(drive_timed(table, optimum.actions, fate, name, (low, high), exact))
    return tuple(found)


def drive_environment(
    world: Environment,
    driver: Reference,
    seeds: Int64[np.ndarray, " episode"],
    deterministic: bool = True,
) -> Outcomes:
    """Let a driver drive one episode for each seed.

    Nobody knows who struck whom: every collision counts as the driver's.

    Args:
        world: Where.
        driver: Who.
        seeds: Of the episodes; a `SoftPolicy` that is not deterministic draws by them too.
        deterministic: Whether it takes its best action.

    Raises:
        UserError: If the environment or the driver fails, or an episode doesn't end.
    """
    size = len(seeds)
    totals, length = np.zeros((size, 2)), np.zeros(size, np.int64)
    ending = np.zeros(size, np.int8)
    for row, seed in enumerate(seeds.tolist()):
        policy = driver.policy
        if not deterministic and isinstance(policy, SoftPolicy):
            policy = _Drawn(policy, seed)
        for taken in steps(world.env, policy, [seed % LARGEST_SEED], deterministic):
            totals[row] += taken.pair
            length[row] += 1
            ending[row] = taken.ending
    assert (ending != Ending.NONE).all()
    contact = np.zeros(size, np.int8)
    return Outcomes(driver.name, totals, ending, contact, length, driver.angles)


class _Drawn:
    """A soft policy in one episode, whose draws belong to the episode's seed."""

    def __init__(self, policy: SoftPolicy, seed: int) -> None:
        self._policy, self._rng = policy, np.random.default_rng([SOFT, seed])

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[np.ndarray, Any]:
        """Draw an action."""
        cumulative = self._policy.probabilities(observation[None]).cumsum(axis=1)[0]
        chosen = (self._rng.random() >= cumulative).sum()
        return np.asarray(min(chosen, len(cumulative) - 1)), state


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
