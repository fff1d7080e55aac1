"""Returns of every action of a state, by rollouts in copies of the simulator.

A copy has the hidden state of the episode and its random numbers, so all actions of a state meet
the same drivers and the same later traffic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.measures import Episodes
from socialiq.social.angle import exact_weights, score
from socialiq.types import Act, ByClass, Ending, Memoryless, Policy, RewardPair
from socialiq.worlds import world
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.world import with_time


def rollouts(
    copies: world.Batch,
    first: np.ndarray,
    running: Bool[np.ndarray, " copy"],
    follow: Callable[[Int64[np.ndarray, " row"]], np.ndarray],
) -> Iterator[tuple[Bool[np.ndarray, " copy"], Any]]:
    """Take a first action in each running copy, then follow a policy to the end of its episode.

    Args:
        copies: Episodes that are driven on.
        first: First action of each copy.
        running: Copies that decide; the rest stay as they are.
        follow: Function that returns the next actions of the copies with given numbers.

    Yields:
        The copies that took each decision, and its results, for all copies.
    """
    action = first.copy()
    deciding = running.copy()
    while deciding.any():
        decisions = copies.step(action, auto_reset=False, rows=deciding)
        yield deciding, decisions
        deciding = deciding & (decisions.ending == int(Ending.NONE))
        rows = np.flatnonzero(deciding)
        if len(rows):
            action[rows] = follow(rows)


def branched_returns(
    batch: Batch,
    follow: Act,
    clock: bool = False,
    angles: Float[np.ndarray, "batch ..."] | None = None,
) -> RewardPair:
    """Return the sums of rewards of each action in the present states, each (batch, actions).

    Each action is taken in a copy, and the policy drives the copy to the end of its episode.
    Actions that do the same share one copy. Episodes that have ended give 0.

    Args:
        batch: Episodes, on the core; they are not changed.
        follow: Policy after the first action.
        clock: Whether it observes the time.
        angles: Of each episode in degrees, if the policy observes it; or a row of two angles.
    """
    size = batch.size
    count = batch.n_actions
    same = batch.equivalent_actions
    same[batch.late] = np.arange(count)  # an action takes effect at another speed
    episodes, first = np.nonzero((same == np.arange(count)) & batch.running[:, None])
    if not len(episodes):
        return RewardPair(np.zeros((size, count)), np.zeros((size, count)))
    copies = batch.branch(episodes)
    branches = episodes * count + first
    totals: list[np.ndarray] = []
    turned = None if angles is None else angles[episodes]

    def act(rows: np.ndarray) -> np.ndarray:
        return follow(observed(copies, clock, turned)[rows])

    for decided, decisions in rollouts(copies, first, np.ones(len(episodes), bool), act):
        parts = decisions.rewards.parts
        totals = totals or [np.zeros(size * count) for _ in parts]
        for total, part in zip(totals, parts, strict=True):
            total[branches[decided]] += part[decided]
    env, *social = (np.take_along_axis(t.reshape(size, count), same, axis=1) for t in totals)
    return RewardPair(env, ByClass(*social) if len(social) > 1 else social[0])


def branched_fleet_returns(
    batch: RoadBatch,
    follow: Act,
    clock: bool,
    angles: Float[np.ndarray, "batch agent ..."],
    chosen: Int64[np.ndarray, " batch"],
) -> RewardPair:
    """Return for each action of one agent of a fleet its sum of r_env, and that of its partners.

    Each is (batch, actions). All agents follow the policy at their angles after that. The sums run
    until the whole fleet has ended, so they hold what the action does to others after the agent's
    own end.

    Args:
        batch: Fleets, on the core; they are not changed.
        follow: Policy of all agents.
        clock: Whether it observes the time.
        angles: Of each agent in degrees, or rows of two angles.
        chosen: Number of the agent that takes each action.
    """
    size = batch.size
    count = batch.n_actions
    copies = batch.branch(np.repeat(np.arange(size), count))
    turned = np.repeat(angles, count, axis=0)
    rows = np.arange(size * count)
    action = np.zeros(copies.shape, np.int64)
    agent = np.repeat(chosen, count)
    total = np.zeros(copies.shape)
    driving = copies.driving
    is_first = True
    while driving.any():
        action[driving] = follow(observed(copies, clock, turned)[driving])
        if is_first:
            action[rows, agent] = np.tile(np.arange(count), size)
            is_first = False
        decisions = copies.step(action, auto_reset=False, rows=driving.any(axis=1))
        total += np.where(driving, decisions.rewards.env, 0.0)
        driving = copies.driving
    agents_sum = total[rows, agent]
    sides = agents_sum, total.sum(axis=1) - agents_sum
    return RewardPair(*(side.reshape(size, count) for side in sides))


def observed(
    batch: RoadBatch, clock: bool, angles: Float[np.ndarray, "batch ..."] | None = None
) -> Float32[np.ndarray, "batch *agent feature"]:
    """Return the present observations, followed by the time with a clock, and by the angles.

    Args:
        batch: Episodes, on the core; of fleets every agent has an observation.
        clock: Whether the time follows the observation, in decisions since the reset.
        angles: Of each episode or agent in degrees, or a row of two angles; None for no angle.
    """
    observation = with_time(batch.observation, batch.clocks, clock)
    if angles is None:
        return observation
    turned = angles.astype(np.float32).reshape(*batch.shape, -1)
    return np.concatenate([observation, turned], axis=-1)


class OracleLookahead(Memoryless):
    """Policy with oracle lookahead in the batch that it drives.

    It decides by `branched_returns` of another policy. The copies draw the same random numbers as
    the episode itself will, so the best action is known in advance. This is one step of policy
    improvement, not a bound: a better base policy would give more. A policy with one feature more
    than the observation observes the time; totals are scored at the angle in degrees.
    """

    def __init__(self, policy: Policy, batch: Batch, angle: float) -> None:
        self._policy = policy
        self._batch = batch
        self._weights = exact_weights(angle)
        self._clock = getattr(policy, "n_features", None) == batch.observation.shape[1] + 1

    def choose(self, _observation: Any, _deterministic: bool, /) -> Int64[np.ndarray, " batch"]:
        """Choose the action of each episode with the best known end.

        The arguments are those of `types.Memoryless.choose`. They are not used, since the state of
        the batch is read.

        Returns:
            Number of an action for each episode of the batch.
        """
        return self.totals().argmax(axis=1)

    def totals(self) -> Float[np.ndarray, "batch action"]:
        """Return the score that each action gives from now to the end of its episode."""

        def follow(observation: np.ndarray) -> np.ndarray:
            return np.asarray(self._policy.predict(observation)[0])

        return score(self._weights, branched_returns(self._batch, follow, self._clock))


def with_oracle_lookahead(
    options: Options, policy: Policy, seeds: np.ndarray, angle: float, size: int = 256
) -> Episodes:
    """Run seeded episodes of a policy with `OracleLookahead`.

    Args:
        options: Options of the intersection.
        policy: Policy that is improved.
        seeds: Seed of each episode.
        angle: Angle at which totals are scored, degrees.
        size: Largest number of episodes side by side.
    """
    batch = Intersection(options).batch(min(size, len(seeds)))
    return episodes_of(batch, OracleLookahead(policy, batch, angle), seeds)
