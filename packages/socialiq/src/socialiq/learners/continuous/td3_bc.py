"""TD3+BC on R(α) (Fujimoto and Gu 2021): offline, a deterministic actor near the demonstrations.

The actor learns at each update; the paper's delay of every second one is left out, since actor and
critics take one step of Adam together here.
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.continuous import soft_values as soft
from socialiq.learners.continuous.actor_critic import ActorCritic, Networks, Rows
from socialiq.learners.continuous.config import OfflineHyperparameters, OfflineStaticConfig
from socialiq.learners.kernel import Terms
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.actor import frozen
from socialiq.social.angle import score


class TD3BC(ActorCritic):
    """The best supported actions for R(α), by demonstrations alone."""

    StaticConfig: ClassVar[type] = OfflineStaticConfig
    Hyperparameters: ClassVar[type] = OfflineHyperparameters
    name: ClassVar[str] = "td3_bc"
    stochastic: ClassVar[bool] = False
    online: ClassVar[bool] = False
    shown: ClassVar[bool] = True

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Losses of the critics and of the actor, in one sum."""
        rows = batch
        target = self.target(target_network, rows, rows.key, hyperparameters)
        seen = self.seen(rows.batch.observation, rows.direction)
        q = jax.vmap(network.critics)(seen, rows.batch.action)
        action = jnp.tanh(jax.vmap(network.actor)(seen)[0])
        value = jax.vmap(frozen(network.critics))(seen, action)[:, 0]
        gap = jnp.mean(jnp.square(action - rows.batch.action))
        terms = {
            "critic": soft.critic_loss(q, target),
            "actor": -normalised(value, hyperparameters.q_weight) + gap,
            "gap": gap,
        }
        total = terms["critic"] + terms["actor"]
        return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}

    def target(
        self,
        target_network: Networks,
        rows: Rows,
        key: PRNGKeyArray,
        hyperparameters: HyperparameterArrays,
    ) -> Float[Array, " batch"]:
        """Y = λR(α) + γ (1 - d) min_i Q_i(s', a' + noise) of the target networks (TD3)."""
        one = hyperparameters
        after = self.seen(rows.batch.next_observation, rows.direction)
        action = jnp.tanh(jax.vmap(target_network.actor)(after)[0])
        noise = one.target_noise * jax.random.normal(key, action.shape)
        action = jnp.clip(action + jnp.clip(noise, -one.noise_clip, one.noise_clip), -1.0, 1.0)
        value = jax.vmap(target_network.critics)(after, action).min(axis=-1)
        follows = self.continued(value, rows.batch, jnp.zeros(()), one)
        reward = one.strength * score(rows.direction, rows.batch.target)
        return frozen(reward + one.discount * follows)


def normalised(value: Float[Array, " batch"], weight: Any) -> Float[Array, ""]:
    """Weight `E[Q] / E[|Q|]`, the divisor without gradient (Fujimoto and Gu 2021, Eq 4)."""
    size = jax.lax.stop_gradient(jnp.mean(jnp.abs(value)))
    return weight * jnp.mean(value) / jnp.maximum(size, 1e-6)
