"""Returns of every action of a state, by rollouts in copies of the simulator.

A copy has the hidden state of the episode and its random numbers, so all actions of a state meet
the same drivers and the same later traffic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int64

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.episodes import State
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import ACTIONS, FASTER, IDLE, SLOWER

Act = Callable[[np.ndarray], Any]
"""Given observations, (row, feature), returns one action for each."""

Angles = Callable[[int, np.random.Generator], Float[np.ndarray, " episode"]]
"""Given the number of episodes and random numbers, returns an angle for each, in degrees."""

Worth = Callable[[Float32[np.ndarray, "row feature"]], RewardPair]
"""Given what the policy observes, returns a further reward pair of each action, each
(row, action)."""


def branched_returns(
    batch: Batch,
    copies: Batch,
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
        copies: Batch of the same options, three times as large.
        follow: Policy after the first action.
        clock: Whether it observes the time.
        angles: Of each episode in degrees, if the policy observes it.
        worth: Further rewards of actions, the first one's own among them; None for none.
    """
    size, count = batch.size, len(ACTIONS)
    now = batch.save()
    copies.restore(now.rows(np.repeat(np.arange(size), count)))
    same = equivalent_actions(now, batch.options)
    running = (same == np.arange(count)).ravel() & np.repeat(~now.waiting, count)
    total = np.zeros((size * count, 2))
    action = np.tile(np.arange(count), size)
    turned = None if angles is None else np.repeat(angles, count)
    while running.any():
        made = copies.step(action, auto_reset=False, rows=running)
        total[running] += np.column_stack(made.rewards)[running]
        running &= made.ending == int(Ending.NONE)
        rows = np.flatnonzero(running)
        if len(rows):
            seen = observed(copies, clock, turned)[rows]
            action[rows] = follow(seen)
            if worth:
                total[rows] += np.stack(worth(seen), axis=-1)[np.arange(len(rows)), action[rows]]
    shared = np.take_along_axis(total.reshape(size, count, 2), same[..., None], axis=1)
    if worth:
        first = np.stack(worth(observed(batch, clock, angles)), axis=-1)
        shared += np.where(now.waiting[:, None, None], 0.0, first)
    return RewardPair(shared[..., 0], shared[..., 1])


def observed(
    batch: Batch, clock: bool, angles: Float[np.ndarray, " batch"] | None = None
) -> Float32[np.ndarray, "batch feature"]:
    """Return the present observations, followed by the time with a clock, and by the angles."""
    columns = [batch.observation]
    columns += [batch.time] if clock else []
    columns += [] if angles is None else [angles.astype(np.float32)]
    return np.column_stack(columns) if len(columns) > 1 else batch.observation


def equivalent_actions(state: State, options: Options) -> Int64[np.ndarray, "batch action"]:
    """Return for each action the first of those that select the same target speed.

    SLOWER and FASTER select the speeds below and above the one nearest to the present speed, IDLE
    keeps the target speed (`core.ego.choose`); the lowest speed has none below.
    """
    ego = state.vehicles[np.arange(len(state.episodes)), state.episodes["ego"]]
    speeds = np.array(options.target_speeds)
    last = len(speeds) - 1
    share = (ego["speed"] - speeds[0]) / (speeds[last] - speeds[0])
    nearest = np.clip(np.rint(share * last), 0, last).astype(np.int64)
    wanted = np.empty((len(ego), len(ACTIONS)))
    wanted[:, SLOWER] = speeds[np.maximum(nearest - 1, 0)]
    wanted[:, IDLE] = ego["target_speed"]
    wanted[:, FASTER] = speeds[np.minimum(nearest + 1, last)]
    return (wanted[:, :, None] == wanted[:, None, :]).argmax(axis=2)


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
        self._copies = Batch(options, len(ACTIONS) * self._batch.size)

    def __call__(self, follow: Act, visit: Act, rng: np.random.Generator) -> Any:
        """Drive with `visit`, and label the states by rollouts of `follow`."""
        batch, found = self._batch, []
        batch.reset(rng.integers(2**63, size=batch.size, dtype=np.uint64))
        angles = self._angles(batch.size, rng) if self._angles else None
        for _ in range(-(-self._states // batch.size)):
            seen = observed(batch, self._clock, angles)
            copies = self._copies
            returns = branched_returns(batch, copies, follow, self._clock, angles, self._worth)
            found.append((seen, *returns))
            batch.step(visit(seen))
        states, env, social = (
            np.concatenate(column)[: self._states] for column in zip(*found, strict=True)
        )
        from socialiq.learners.policy_iteration.train import Labelled  # learning needs JAX

        return Labelled(states, RewardPair(env, social))
