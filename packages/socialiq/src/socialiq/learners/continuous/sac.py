"""Soft actor-critic on R(α) (Haarnoja et al. 2018); as a dial, at every angle of a range."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from socialiq.learners.continuous import soft_values as soft
from socialiq.learners.continuous.actor_critic import ActorCritic, Networks, Rows
from socialiq.learners.continuous.config import Hyperparameters, StaticConfig
from socialiq.learners.kernel import Terms
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.actor import frozen
from socialiq.social.angle import score


class SoftActorCritic(ActorCritic):
    """Reinforcement learning on λR(α) plus the entropy; needs a world and no demonstrations."""

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = Hyperparameters
    name: ClassVar[str] = "sac"

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Losses of the critics, the actor and a tuned temperature, in one sum."""
        rows, for_target, for_actor = batch, *jax.random.split(batch.key)
        target = self.target(network, target_network, rows, for_target, hyperparameters)
        seen = self.seen(rows.batch.observation, rows.direction)
        q = jax.vmap(network.critics)(seen, rows.batch.action)
        terms = {"critic": soft.critic_loss(q, target)}
        terms |= self.improvement(network, seen, for_actor, hyperparameters)
        total = terms["critic"] + terms["actor"] + terms.get("tuning", 0.0)
        return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}

    def target(
        self,
        network: Networks,
        target_network: Networks,
        rows: Rows,
        key: Array,
        hyperparameters: HyperparameterArrays,
    ) -> Float[Array, " batch"]:
        """Y = λR(α) + γ (1 - d) V(s'), V(s') = E_π[min_i Q_i - τ log π] of the target critics."""
        after = self.seen(rows.batch.next_observation, rows.direction)
        temperature = self.temperature(network, hyperparameters)
        count = self.static.actions_per_state
        drawn = soft.draw_actions(network.actor, after, key, count)
        q = soft.drawn_values(target_network.critics, after, drawn).min(axis=-1)
        value = soft.soft_value(q, drawn, temperature)
        follows = self.continued(value, rows.batch, temperature, hyperparameters)
        reward = hyperparameters.strength * score(rows.direction, rows.batch.target)
        return frozen(reward + hyperparameters.discount * follows)
