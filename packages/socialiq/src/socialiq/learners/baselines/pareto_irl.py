"""Pareto inverse reinforcement learning (ParIRL, Kim et al. 2024): a front from two experts.

A reward is inferred for the egoists and one for the altruists. A policy in between is one of the
reward whose squared distances to both, weighted by its preference, are least: their weighted mean.
One network conditioned on the preference learns all of them by acting in the world. The paper
distils the front into a diffusion model and measures distances of rewards by EPIC; here both are
linear, so the network can learn the interpolated rewards themselves.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from socialiq.learners.collect import Act, Source
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn import losses
from socialiq.nn.q_network import QNetwork
from socialiq.types import Ending, RewardPair


class InferredReward(eqx.Module):
    """Reward that a trained IQ-Learn implies, r̂ = Q(s, a) - γ (1 - d) V(s') (Eq 2.6).

    Attributes:
        network: Its Q.
        temperature: τ of V.
        discount: γ.
    """

    network: QNetwork
    temperature: float
    discount: float

    def __call__(
        self,
        observation: Float[Array, " feature"],
        action: Int[Array, ""],
        following: Float[Array, " feature"],
        ending: Int[Array, ""],
    ) -> Float[Array, ""]:
        """Return r̂ of one transition; after any ending nothing follows."""
        value = losses.soft_value(self.network(following), self.temperature)
        follows = jnp.where(ending == int(Ending.NONE), value, 0.0)
        return self.network(observation)[action] - self.discount * follows


Rewards = tuple[InferredReward, InferredReward]
"""The egoists' and the altruists' rewards."""


@eqx.filter_jit
def inferred_pair(rewards: Rewards, batch: Batch) -> RewardPair:
    """Return the pair of inferred rewards of transitions, in the place of (r_env, r_social)."""
    given = (batch.observation, batch.action, batch.next_observation, batch.ending)
    return RewardPair(*(jax.vmap(one)(*given) for one in rewards))


def inferring(source: Source, rewards: Rewards) -> Source:
    """Return a source outside JAX whose pair of rewards is inferred."""

    def relabelled(act: Act, rng: Any) -> Batch:
        batch = source(act, rng)
        return batch._replace(target=inferred_pair(rewards, batch))

    return relabelled
