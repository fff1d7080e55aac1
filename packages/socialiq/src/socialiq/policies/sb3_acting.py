"""Parts of a policy of Stable-Baselines3 around its network: exploration and normalisation."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.nn.q_policy import QPolicy, checked_batch, numbers_of
from socialiq.types import Policy

STATISTICS = "vecnormalize.json"
"""Member of the zip with the statistics of `VecNormalize`, which its owner adds."""
Batch = Float[np.ndarray, "batch feature"]
Chances = Float[np.ndarray, "batch action"]


@dataclass(frozen=True)
class Normalised:
    """Policy of observations that are normalised first, as `VecNormalize` does."""

    policy: Any  # policy of the normalised observations
    mean: Float[np.ndarray, " feature"]  # mean of each feature in training
    deviation: Float[np.ndarray, " feature"]  # √(variance + ε) of each feature
    clip: float  # largest size of a normalised feature

    def normal(self, observations: Any) -> Float32[np.ndarray, "batch feature"]:
        """Return normalised observations; `UserError` for an observation that doesn't fit."""
        batch = checked_batch(observations, len(self.mean))
        scaled = (batch - self.mean) / self.deviation
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions, as `types.Policy`; `UserError` for an observation that doesn't fit."""
        numbers = numbers_of(observation)
        batch = self.normal(np.atleast_2d(numbers))
        batch = batch if numbers.ndim == 2 else batch[0]
        return self.policy.predict(batch, state, episode_start, deterministic)


class SoftNormalised(Normalised):
    """The same of a policy that gives its probabilities."""

    def probabilities(self, observations: Batch) -> Chances:
        """Return the probability of each action."""
        return self.policy.probabilities(self.normal(observations))


def normalised(policy: Policy, content: bytes, n_features: int, source: str) -> Policy:
    """Return a policy with its normalisation; `UserError` if the numbers can't be statistics.

    The content is a JSON object with mean and var (one number a feature), epsilon and clip_obs, by
    the names of `VecNormalize`; or `{"norm_obs": false}`. `source` is the file's name in messages.
    """
    refusal = UserError(
        f"{source}: {STATISTICS} is no object of mean and var, {n_features} finite numbers each, "
        "epsilon and clip_obs: write them as VecNormalize has them"
    )
    try:
        numbers = json.loads(content)
        if numbers == {"norm_obs": False}:
            return policy
        mean, variance = (np.array(numbers[name], np.float64) for name in ("mean", "var"))
        epsilon, clip = float(numbers.get("epsilon", 1e-8)), float(numbers.get("clip_obs", 10.0))
        sound = mean.shape == variance.shape == (n_features,) and clip > 0.0
        sound = sound and bool(np.isfinite(mean).all() and np.isfinite(variance).all())
        sound = sound and epsilon >= 0.0 and bool((variance + epsilon > 0.0).all())
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        OverflowError,
        RecursionError,
    ) as error:
        raise refusal from error
    if not sound:
        raise refusal
    kind = SoftNormalised if isinstance(policy, SoftPolicy) else Normalised
    return kind(policy, mean, np.sqrt(variance + epsilon), clip)


@dataclass(frozen=True)
class EpsilonGreedy:
    """Policy that takes the best action, or with probability ε a uniformly random one.

    Stable-Baselines3 draws once for all observations of a call; here every observation has its own
    draw, so that episodes do not depend on the batch. For a single observation the distribution is
    the same.
    """

    greedy: QPolicy
    epsilon: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def probabilities(self, observations: Batch) -> Chances:
        """Return the probability of each action."""
        best = self.greedy.q_values(observations).argmax(axis=1)
        n_actions = self.greedy.n_actions
        return (1.0 - self.epsilon) * np.eye(n_actions)[best] + self.epsilon / n_actions

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions, as `types.Policy`; `UserError` for an observation that doesn't fit."""
        best, state = self.greedy.predict(observation, state, episode_start)
        if deterministic:
            return best, state
        explores = self.rng.random(best.shape) < self.epsilon
        random = self.rng.integers(self.greedy.n_actions, size=best.shape)
        return np.where(explores, random, best), state
