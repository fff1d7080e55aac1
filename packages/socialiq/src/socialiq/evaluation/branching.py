"""Returns of every action of a state, by rollouts in copies of the simulator.

A copy has the hidden state of the episode and its random numbers, so all actions of a state meet
the same drivers and the same later traffic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.errors import UserError
from socialiq.evaluation.episodes import Episodes, episodes_of
from socialiq.social.angle import exact_weights, score
from socialiq.types import Act, Ending, Policy, RewardPair
from socialiq.worlds import world
from socialiq.worlds.highway.episodes import RoadBatch, State
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import ACTIONS, FASTER, IDLE, SLOWER

Angles = Callable[[int, np.random.Generator], Float[np.ndarray, " episode"]]
"""Given the number of episodes and random numbers, returns an angle for each, in degrees."""

Worth = Callable[[Float32[np.ndarray, "row feature"]], RewardPair]
"""Given what the policy observes, returns a further reward pair of each action, each
(row, action)."""


def rollouts(
    copies: world.Batch,
    first: np.ndarray,
    running: Bool[np.ndarray, " copy"],
    follow: Callable[[Int64[np.ndarray, " row"]], np.ndarray],
) -> Iterator[tuple[Bool[np.ndarray, " copy"], Any]]:
    """Take a first action in each copy, then follow a policy to the end of each episode.

    Args:
        copies: Copies of episodes.
        first: First action of each.
        running: Copies that run.
        follow: From numbers of copies to their next actions.

    Yields:
        Of each decision the copies that took it, and its results.
    """
    action, deciding = first.copy(), running.copy()
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
    angles: Float[np.ndarray, " batch"] | None = None,
    worth: Worth | None = None,
) -> RewardPair:
    """Return the sums of rewards of each action in the present states, each (batch, actions).

    Each action is taken in a copy, and the policy drives the copy to the end of its episode.
    Actions that select one target speed share one copy. Episodes that have ended give 0.

    Args:
        batch: Episodes, on the core; they are not changed.
        follow: Policy after the first action.
        clock: Whether it observes the time.
        angles: Of each episode in degrees, if the policy observes it.
        worth: Further rewards of actions, the first one's own among them; None for none.
    """
    size, count = batch.size, len(ACTIONS)
    now = batch.save()
    copies = batch.branch(np.repeat(np.arange(size), count))
    same = equivalent_actions(now, batch.options)
    running = (same == np.arange(count)).ravel() & np.repeat(~now.waiting, count)
    total = np.zeros((size * count, 2))
    turned = None if angles is None else np.repeat(angles, count)

    def act(rows: np.ndarray) -> np.ndarray:
        observation = observed(copies, clock, turned)[rows]
        action = follow(observation)
        if worth:
            total[rows] += np.stack(worth(observation), axis=-1)[np.arange(len(rows)), action]
        return action

    for decided, decisions in rollouts(copies, np.tile(np.arange(count), size), running, act):
        total[decided] += np.column_stack(decisions.rewards)[decided]
    shared = np.take_along_axis(total.reshape(size, count, 2), same[..., None], axis=1)
    if worth:
        first = np.stack(worth(observed(batch, clock, angles)), axis=-1)
        shared += np.where(now.waiting[:, None, None], 0.0, first)
    return RewardPair(shared[..., 0], shared[..., 1])


def observed(
    batch: RoadBatch, clock: bool, angles: Float[np.ndarray, " batch"] | None = None
) -> Float32[np.ndarray, "batch feature"]:
    """Return the present observations, followed by the time with a clock, and by the angles."""
    columns = [batch.observation]
    columns += [batch.time] if clock else []
    columns += [] if angles is None else [angles.astype(np.float32)]
    return np.column_stack(columns) if len(columns) > 1 else batch.observation


def equivalent_actions(state: State, options: Options) -> Int64[np.ndarray, "batch action"]:
    """Return for each action the first of those that select the same target speed.

    SLOWER and FASTER select the speeds below and above the one nearest to the present speed, IDLE
    keeps the target speed (`core.traffic.choose`); the lowest speed has none below.
    """
    ego = state.vehicles[np.arange(len(state.episodes)), state.episodes["ego"]]
    speeds = np.array(options.target_speeds)
    last = len(speeds) - 1
    share = (ego["speed"] - speeds[0]) / (speeds[last] - speeds[0])
    nearest = np.clip(np.rint(share * last), 0, last).astype(np.int64)
    target = np.empty((len(ego), len(ACTIONS)))
    target[:, SLOWER] = speeds[np.maximum(nearest - 1, 0)]
    target[:, IDLE] = ego["target_speed"]
    target[:, FASTER] = speeds[np.minimum(nearest + 1, last)]
    return (target[:, :, None] == target[:, None, :]).argmax(axis=2)


class Branching:
    """Labeller of `learners.policy_iteration`: intersections side by side on the core.

    Each call begins with new episodes.

    Args:
        options: Scenario.
        states: Number of states labelled in a call.
        episodes: Number of episodes side by side.
        clock: Whether observations end with the time.
        angles: Draws the angle at which each episode is driven and its copies too; observations
            then end with it, after the time. None for a policy of one angle.
        worth: Further rewards of actions; None for none.

    Raises:
        UserError: If a number is not positive.
    """

    def __init__(
        self,
        options: Options,
        states: int,
        episodes: int = 256,
        clock: bool = False,
        angles: Angles | None = None,
        worth: Worth | None = None,
    ) -> None:
        for name, value in (("states", states), ("episodes", episodes)):
            if value < 1:
                raise UserError(f"{name} must be at least 1, got {value}")
        self._states, self._clock, self._angles, self._worth = states, clock, angles, worth
        self._batch = Batch(options, min(episodes, states))

    def __call__(self, follow: Act, visit: Act, rng: np.random.Generator) -> Any:
        """Drive with `visit`, and label the states by rollouts of `follow`."""
        batch, labelled = self._batch, []
        batch.reset(rng.integers(2**63, size=batch.size, dtype=np.uint64))
        angles = self._angles(batch.size, rng) if self._angles else None
        for _ in range(-(-self._states // batch.size)):
            observation = observed(batch, self._clock, angles)
            returns = branched_returns(batch, follow, self._clock, angles, self._worth)
            labelled.append((observation, *returns))
            batch.step(visit(observation))
        states, env, social = (
            np.concatenate(column)[: self._states] for column in zip(*labelled, strict=True)
        )
        from socialiq.learners.policy_iteration import Labelled  # learning needs JAX

        return Labelled(states, RewardPair(env, social))


class OracleLookahead:
    """Policy with oracle lookahead in the batch that it drives.

    It decides by `branched_returns` of another policy. The copies draw the same random numbers as
    the episode itself will, so the best action is known in advance. This is one step of policy
    improvement, not a bound: a better base policy would give more.

    Args:
        policy: Policy that drives the copies; one with `n_features` one more than the
            observation's observes the time.
        batch: Batch that it drives, on the core.
        angle: At which totals are scored, in degrees.
    """

    def __init__(self, policy: Policy, batch: Batch, angle: float) -> None:
        self._policy, self._batch, self._weights = policy, batch, exact_weights(angle)
        self._clock = getattr(policy, "n_features", None) == batch.observation.shape[1] + 1

    def predict(
        self,
        observation: np.ndarray,  # noqa: ARG002  the batch's state is used
        state: None = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[Int64[np.ndarray, " batch"], None]:
        """Choose the action of each episode with the best known score to its end."""

        def follow(seen: np.ndarray) -> np.ndarray:
            return np.asarray(self._policy.predict(seen)[0])

        returns = branched_returns(self._batch, follow, self._clock)
        return score(self._weights, returns).argmax(axis=1), state


def with_oracle_lookahead(
    options: Options, policy: Policy, seeds: np.ndarray, angle: float, size: int = 256
) -> Episodes:
    """Run seeded episodes of a policy with `OracleLookahead`, so many side by side."""
    batch = Batch(options, min(size, len(seeds)))
    return episodes_of(batch, OracleLookahead(policy, batch, angle), seeds)
