"""Online planning: a rollout policy that simulates its actions in states consistent with its view.

Unlike `oracle_lookahead` it is a policy: it has the observation and a model of the traffic, but
neither the destinations of other vehicles nor the later traffic. It draws these, simulates each
action in each draw and some further decisions of its network, and adds the network's value of the
last state (a rollout algorithm, one step of policy improvement: Bertsekas and Tsitsiklis 1996,
Neuro-Dynamic Programming, section 6.1).
"""

from __future__ import annotations

import itertools
import zlib
from typing import Any

import numpy as np
from jaxtyping import Float, Int64

from socialiq.errors import UserError
from socialiq.evaluation.branching import rollouts
from socialiq.social.angle import exact_weights, score
from socialiq.types import Ending, Memoryless
from socialiq.worlds.grammar import road_of
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.intersection.core.imagine import imagined
from socialiq.worlds.intersection.options import ACTIONS, Options
from socialiq.worlds.intersection.world import Intersection


class RolloutPolicy(Memoryless):
    """Rollout policy of a network.

    The time, if the network reads it, goes on in the simulated decisions, and episodes end by it.

    Args:
        policy: Policy to improve, with `q_values`, such as `nn.q_policy.QPolicy`.
        options: Scenario of the simulation.
        angle: Angle of the score in degrees: that of the network.
        draws: Number of states drawn for each observation.
        decisions: Number of simulated decisions, including the first.
        doubt: Standard errors, over the draws, by which an action must exceed the network's own.
        discount: Discount γ of the network.

    Attributes:
        n_features: Length of an observation of the network; None if it doesn't tell.

    Raises:
        UserError: If draws or decisions are not positive.
    """

    def __init__(
        self,
        policy: Any,
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
        self._policy = policy
        self._options = options
        self._weights = exact_weights(angle)
        self.n_features = getattr(policy, "n_features", None)
        self._draws = draws
        self._decisions = decisions
        self._doubt = doubt
        self._discount = discount
        self._batch: Batch | None = None  # of the last call; usually the next has the same size

    def choose(self, observation: np.ndarray, _deterministic: bool, /) -> Int64[np.ndarray, ...]:
        """Choose the significantly best action; equal observations give equal actions.

        Args:
            observation: One observation, or a row for each.
            _deterministic: Not used.

        Returns:
            Number of an action for each observation.
        """
        array = np.asarray(observation, np.float32)
        rows = np.atleast_2d(array)
        greedy = np.asarray(self._policy.q_values(rows)).argmax(axis=1)
        gain = self.values(rows)
        gain = gain - np.take_along_axis(gain, greedy[:, None, None], axis=2)
        # The best of three noisy means is biased upwards; the network's own action needs no test.
        error = gain.std(axis=1, ddof=min(1, self._draws - 1)) / np.sqrt(self._draws)
        best = (gain.mean(axis=1) - self._doubt * error).argmax(axis=1)
        return best.reshape(array.shape[:-1])

    def values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch draw action"]:
        """Return the value of each action in each draw: some decisions, and the network's value."""
        size = len(observations)
        copies = self._draws * len(ACTIONS)
        repeated = np.repeat(observations, copies, axis=0)
        # Seeds depend on the observation, so that draws differ between decisions but not actions.
        first = np.array([zlib.crc32(row.tobytes()) for row in observations], np.uint64) << 20
        entropy = first[:, None] + np.arange(self._draws, dtype=np.uint64)
        entropy = np.repeat(entropy.ravel(), len(ACTIONS))
        timed = self.n_features == road_of(self._options).n_features + 1
        observed = np.ascontiguousarray(repeated[:, :-1]) if timed else repeated
        state = imagined(self._options, observed, entropy)
        if timed:
            state.episodes["time"] = repeated[:, -1] / self._options.policy_frequency
        if self._batch is None or self._batch.size != len(repeated):
            self._batch = Intersection(self._options).batch(len(repeated))
        batch = self._batch
        batch.restore(state)
        action = np.tile(np.arange(len(ACTIONS)), size * self._draws)
        total = np.zeros(batch.size)
        factor = 1.0
        running = np.ones(batch.size, bool)

        def values() -> np.ndarray:
            return np.asarray(self._policy.q_values(batch.seen_by(self._policy)))

        steps = rollouts(batch, action, running, lambda rows: values().argmax(axis=1)[rows])
        for decided, results in itertools.islice(steps, self._decisions):
            total[decided] += factor * score(self._weights, results.rewards)[decided]
            factor *= self._discount
            running = decided & (results.ending == int(Ending.NONE))
        if running.any():
            total[running] += factor * values().max(axis=1)[running]
        return total.reshape(size, self._draws, len(ACTIONS))
