"""Oracle lookahead: performance of a policy with the true future traffic.

At every decision the state is copied once for each action, the action is taken, and the policy
drives each copy to the end of its episode. The copies draw the same random numbers as the episode
itself will, so the best action is known in advance. This is one step of policy improvement, not a
bound: a better base policy would give more.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64

from socialiq.evaluation.branching import branched_returns
from socialiq.evaluation.episodes import Episodes, episodes_of
from socialiq.social.angle import exact_weights, score
from socialiq.types import Policy
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import ACTIONS


class OracleLookahead:
    """Policy with oracle lookahead in the batch that it drives.

    Args:
        policy: Policy that drives the copies; one with `n_features` one more than the
            observation's observes the time.
        batch: Batch that it drives, on the core.
        angle: At which totals are scored, in degrees.
    """

    def __init__(self, policy: Policy, batch: Batch, angle: float) -> None:
        self._policy, self._batch, self._weights = policy, batch, exact_weights(angle)
        self._copies = Batch(batch.options, len(ACTIONS) * batch.size)
        self._clock = getattr(policy, "n_features", None) == batch.observation.shape[1] + 1

    def predict(
        self,
        observation: np.ndarray,  # noqa: ARG002  the batch's state is used
        state: None = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[Int64[np.ndarray, " batch"], None]:
        """Choose the action of each episode with the best known end."""
        return self.totals().argmax(axis=1), state

    def totals(self) -> Float[np.ndarray, "batch action"]:
        """Return the score that each action gives from now to the end of its episode."""
        returns = branched_returns(
            self._batch,
            self._copies,
            lambda seen: np.asarray(self._policy.predict(seen)[0]),
            self._clock,
        )
        return score(self._weights, returns)


def with_oracle_lookahead(
    options: Options, policy: Policy, seeds: np.ndarray, angle: float, size: int = 256
) -> Episodes:
    """Run the episodes of a policy with oracle lookahead.

    Args:
        options: The scenario.
        policy: Policy that drives the copies.
        seeds: One for each episode.
        angle: At which totals are scored, in degrees.
        size: Number of episodes side by side.
    """
    batch = Batch(options, min(size, len(seeds)))
    return episodes_of(batch, OracleLookahead(policy, batch, angle), seeds)
