"""Standardised observations: each feature with mean 0 and deviation 1.

Mean and deviation are over the demonstrations, or, without any, over steps at random in the world.
Features of different units, such as a velocity of 10 m/s and an angle of 0.1 rad, reach small
networks alike. The learner sees standardised observations only; its policy takes them as they are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float, Float32

from socialiq.errors import UserError
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.dial_policy import Dial
from socialiq.nn.q_policy import QPolicy

_LEAST = 1e-3
"""Added to deviations, as Fujimoto and Gu (2021) do."""

EXPLORED = 1000
"""Steps at random from which observations are standardised without demonstrations."""


def explored(
    env: gymnasium.Env[Any, Any], seed: int, steps: int = EXPLORED
) -> Float32[np.ndarray, "row feature"]:
    """Return the flat observations of steps with uniformly drawn actions from a `Box`.

    Args:
        env: Environment of flat observations.
        seed: Seed of the first episode and of the actions.
        steps: Number of steps; the last episode may be cut.

    Returns:
        The observations, first ones of episodes among them, so at least `steps + 1` rows.
    """
    space = env.action_space
    assert isinstance(space, spaces.Box)
    rng = np.random.default_rng(seed)
    observations = [env.reset(seed=seed)[0]]
    for _ in range(steps):
        action = rng.uniform(space.low, space.high).astype(np.float32)
        observation, _, terminated, truncated, _ = env.step(action)
        observations.append(observation)
        if terminated or truncated:
            observations.append(env.reset()[0])
    return np.stack(observations).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Standardisation:
    """An affine change of each feature of an observation.

    Attributes:
        mean: Subtracted.
        deviation: Divided by, above 0; infinite for a feature that is left out, which is then 0.
    """

    mean: Float32[np.ndarray, " feature"]
    deviation: Float32[np.ndarray, " feature"]

    @staticmethod
    def of(
        observation: Float[np.ndarray, "row feature"], left_out: Sequence[int] = ()
    ) -> Standardisation:
        """Return the change of these observations; a feature that never changes keeps its unit.

        Args:
            observation: Observations, (row, feature).
            left_out: Features that the networks don't see, counted from 0.

        Returns:
            The change.

        Raises:
            UserError: If there is no such feature, or none is left.
        """
        observation = np.asarray(observation, np.float64)
        mean = observation.mean(axis=0)
        deviation = observation.std(axis=0)
        deviation = np.where(deviation > 0.0, deviation + _LEAST, 1.0)
        unknown = [feature for feature in left_out if not 0 <= feature < len(mean)]
        if unknown:
            raise UserError(f"no feature {unknown[0]} to leave out: they are 0 to {len(mean) - 1}")
        deviation[list(left_out)] = np.inf
        if np.isinf(deviation).all():
            raise UserError("every feature is left out: keep at least one")
        return Standardisation(mean.astype(np.float32), deviation.astype(np.float32))

    def __call__(self, observation: Any) -> Float32[np.ndarray, "*row feature"]:
        """Return standardised observations."""
        return ((np.asarray(observation) - self.mean) / self.deviation).astype(np.float32)

    def transitions(self, table: Any) -> Any:
        """Return demonstrations, a dataclass, with standardised observations."""
        after = self(table.next_observation)
        return dataclasses.replace(
            table, observation=self(table.observation), next_observation=after
        )

    def environment(self, env: gymnasium.Env[Any, Any]) -> gymnasium.Env[Any, Any]:
        """Return an environment of flat observations with standardised ones.

        Raises:
            UserError: If it has another number of features.
        """
        shape = env.observation_space.shape or (0,)
        if shape != self.mean.shape:
            raise UserError(
                f"the environment has {shape[0]} features and the demonstrations "
                f"{len(self.mean)}: they belong to two worlds"
            )
        space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        return gymnasium.wrappers.TransformObservation(env, self, space)

    def maker(
        self, make: Callable[[], gymnasium.Env[Any, Any]]
    ) -> Callable[[], gymnasium.Env[Any, Any]]:
        """Return a function that makes such environments."""
        return lambda: self.environment(make())

    def policy(self, trained: ActorPolicy | QPolicy | Dial[Any]) -> Any:
        """Return a policy, or dial, of observations as they are; its first layer has the change.

        Inputs after the observation, those of an angle, stay.

        Raises:
            UserError: If it reads the observation by a view.
        """
        if isinstance(trained, Dial):
            return dataclasses.replace(trained, turned=self.policy(trained.turned))
        if trained.view is not None:
            raise UserError("a view reads vehicles in their units: leave --standardise out")
        first, *weights = trained.weights
        bias, *biases = trained.biases
        count = len(self.mean)
        scaled = first.astype(np.float64)
        scaled[:, :count] /= self.deviation
        bias = (bias - scaled[:, :count] @ self.mean).astype(np.float32)
        deviations = [
            None if np.isinf(deviation) else float(deviation) for deviation in self.deviation
        ]
        record = {"mean": self.mean.tolist(), "deviation": deviations}
        return dataclasses.replace(
            trained,
            weights=(scaled.astype(np.float32), *weights),
            biases=(bias, *biases),
            provenance={**trained.provenance, "standardised": record},
        )
