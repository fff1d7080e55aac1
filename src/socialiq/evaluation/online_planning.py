"""Online planning: a rollout policy that simulates its actions in states consistent with its view.

Unlike `oracle_lookahead` it is a policy: it knows the observation, and how traffic moves, but
neither the others' destinations nor who will come. It draws these, takes each action in each draw,
drives on by its network for some decisions, and takes the network's value of where that leads (a
rollout algorithm, one step of policy improvement: Bertsekas and Tsitsiklis 1996, Neuro-Dynamic
Programming, section 6.1).
"""

from __future__ import annotations

import zlib
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int64

from socialiq.errors import UserError
from socialiq.social.angle import exact_weights, score
from socialiq.types import Ending
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.imagination import imagined
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import ACTIONS


@runtime_checkable
class Valued(Protocol):
    """A policy that tells what its actions are worth, as `nn.q_policy.QPolicy` does."""

    def q_values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Q of each action."""
        ...


class RolloutPolicy:
    """The rollout policy of a network.

    Args:
        policy: Whose values and actions are improved on.
        options: The scenario that it believes to be in.
        angle: At which rewards are scored, in degrees: that of the network.
        draws: States drawn for each observation.
        decisions: Decisions played out in each, the first one included.
        doubt: Standard errors, over the draws, by which an action must beat the network's own.
        discount: γ of the network.

    Raises:
        UserError: If draws or decisions are not positive.
    """

    def __init__(
        self,
        policy: Valued,
        options: Options,
        angle: float,
        draws: int = 16,
        decisions: int = 3,
        doubt: float = 1.0,
        discount: float = 0.99,
    ) -> None:
        for name, value in (("draws", draws), ("decisions", decisions)):
            if value < 1:
                raise UserError(f"{name} must be at least 1, got {value}")
        self._policy, self._options, self._weights = policy, options, exact_weights(angle)
        self._draws, self._decisions = draws, decisions
        self._doubt, self._discount = doubt, discount
        self._batch: Batch | None = None  # of the last call; the next has most often its size

    def predict(
        self,
        observation: np.ndarray,
        state: None = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[Int64[np.ndarray, ...], None]:
        """The action that surely comes out best; the same for the same view."""
        seen = np.asarray(observation, np.float32)
        rows = np.atleast_2d(seen)
        own = np.asarray(self._policy.q_values(rows)).argmax(axis=1)
        gain = self.values(rows)
        gain = gain - np.take_along_axis(gain, own[:, None, None], axis=2)
        # The best of three noisy means is too good; the network's own action needs no proof.
        error = gain.std(axis=1, ddof=min(1, self._draws - 1)) / np.sqrt(self._draws)
        best = (gain.mean(axis=1) - self._doubt * error).argmax(axis=1)
        return best.reshape(seen.shape[:-1]), state

    def values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch draw action"]:
        """What each action is worth in each draw."""
        size, copies = len(observations), self._draws * len(ACTIONS)
        seen = np.repeat(observations, copies, axis=0)
        # By view, so that no draw is the lot of every decision; the same for all its actions.
        first = np.array([zlib.crc32(one.tobytes()) for one in observations], np.uint64) << 20
        entropy = first[:, None] + np.arange(self._draws, dtype=np.uint64)
        batch = self._batch_of(len(seen))
        batch.restore(imagined(self._options, seen, np.repeat(entropy.ravel(), len(ACTIONS))))
        action = np.tile(np.arange(len(ACTIONS)), size * self._draws)
        return self._played(batch, action).reshape(size, self._draws, len(ACTIONS))

    def _batch_of(self, size: int) -> Batch:
        if self._batch is None or self._batch.size != size:
            self._batch = Batch(self._options, size)
        return self._batch

    def _played(
        self, batch: Batch, action: Int64[np.ndarray, " copy"]
    ) -> Float[np.ndarray, " copy"]:
        earned = np.zeros(batch.size)
        running, factor, worth = np.ones(batch.size, bool), 1.0, np.zeros(batch.size)
        for _ in range(self._decisions):
            made = batch.step(action, auto_reset=False, rows=running)
            earned[running] += factor * score(self._weights, made.rewards)[running]
            running &= made.ending == int(Ending.NONE)
            factor *= self._discount
            if not running.any():
                return earned
            values = np.asarray(self._policy.q_values(batch.observation))
            action, worth = values.argmax(axis=1), values.max(axis=1)
        earned[running] += factor * worth[running]
        return earned
