"""Logged episodes beside the policy to be evaluated: what both estimators read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError

Chances = Callable[[np.ndarray], np.ndarray]
"""Probabilities of a policy's actions, (state, action), for observations (state, feature)."""


@dataclass(frozen=True, eq=False)
class Logged:
    """Whole episodes, their distinct observations numbered.

    Attributes:
        data: The episodes.
        observations: Every distinct observation.
        state: Number of each row's observation.
        next_state: Number of each row's next observation.
        horizon: Steps of the longest episode: the time limit, if one was cut.
    """

    data: Demonstrations
    observations: Float[np.ndarray, "state feature"]
    state: Int[np.ndarray, " transition"]
    next_state: Int[np.ndarray, " transition"]
    horizon: int

    @staticmethod
    def of(data: Demonstrations) -> Logged:
        """Number the observations.

        Raises:
            UserError: If steps of an episode are missing, or there is one episode only.
        """
        data.totals()  # refuses episodes with gaps
        if data.n_episodes < 2:
            raise UserError("one episode has no interval: give two episodes or more")
        both = np.concatenate([data.observation, data.next_observation])
        distinct, number = np.unique(both, axis=0, return_inverse=True)
        state, next_state = np.split(number.reshape(-1), 2)
        return Logged(data, distinct, state, next_state, int(data.step.max()) + 1)

    @property
    def tabular(self) -> bool:
        """Whether observations recur often enough for tables: five times in the mean."""
        return 5 * len(np.unique(self.state)) <= len(self.state)

    @property
    def rewards(self) -> Float[np.ndarray, "transition 2"]:
        """Return r_env and r_social as columns."""
        return np.stack(self.data.rewards, axis=1)

    def chances(self, policy: Chances) -> Float[np.ndarray, "state action"]:
        """Return a policy's probabilities at every distinct observation.

        Raises:
            UserError: If the policy is not one of the data's actions.
        """
        found = np.asarray(policy(self.observations), np.float64)
        if found.shape != (len(self.observations), self.data.n_actions):
            raise UserError(
                f"the policy has {found.shape[-1]} actions, the data {self.data.n_actions}: "
                "give data of the world it was trained for"
            )
        return found

    def by_step(self, values: np.ndarray, fill: float) -> np.ndarray:
        """Return values of rows as (episode, step, ...), filled beyond an episode's end."""
        shape = (self.data.n_episodes, self.horizon, *values.shape[1:])
        found = np.full(shape, fill, np.float64)
        found[self.data.episode, self.data.step] = values
        return found
