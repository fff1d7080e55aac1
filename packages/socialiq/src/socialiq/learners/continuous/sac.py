"""Soft actor-critic (Haarnoja et al. 2018) and TD3+BC (Fujimoto and Gu 2021) on R(α)."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.continuous import actor_critic, config
from socialiq.learners.continuous.actor_critic import ActorCritic, Networks, Rows
from socialiq.learners.iq_learn import losses
from socialiq.learners.kernel import Terms
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.actor import frozen
from socialiq.social.angle import score


class SoftActorCritic(ActorCritic):
    """Reinforcement learning on λR(α) plus the entropy; needs a world and no demonstrations."""

    StaticConfig: ClassVar[type] = config.SACConfig
    Hyperparameters: ClassVar[type] = config.SACHyperparameters
    name: ClassVar[str] = "sac"

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the losses of the critics, the actor and a tuned temperature, in one sum.

        Args:
            network: Actor, critics and log τ.
            target_network: Running average of these.
            batch: Rows of own transitions.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and its terms by name; "entropy" and "max_q" are recorded only.
        """
        rows = batch
        for_target, for_actor = jax.random.split(batch.key)
        target = self.target(network, target_network, rows, for_target, hyperparameters)
        inputs = self.inputs(rows.batch.observation, rows.direction)
        q = jax.vmap(network.critics)(inputs, rows.batch.action)
        terms = {"critic": actor_critic.critic_loss(q, target)}
        terms |= self.improvement(network, inputs, for_actor, hyperparameters)
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
        """Return Y = λR(α) + γ (1 - d) V(s'), with V(s') by the target critics.

        V(s') = E_π[min_i Q_i - τ log π].

        Args:
            network: Actor that draws the next actions, and log τ.
            target_network: Critics of Q_i.
            rows: Rows of the update.
            key: Random key of the next actions.
            hyperparameters: Numbers of one run.

        Returns:
            Y of each row, without gradient.
        """
        after = self.inputs(rows.batch.next_observation, rows.direction)
        temperature = self.temperature(network, hyperparameters)
        count = self.static.actions_per_state
        sampled = actor_critic.draw_actions(network.actor, after, key, count)
        q = actor_critic.drawn_values(target_network.critics, after, sampled).min(axis=-1)
        value = actor_critic.soft_value(q, sampled, temperature)
        settings = (self.volume, temperature, hyperparameters, self.static)
        follows = losses.continued(value, rows.batch.ending, *settings)
        reward = hyperparameters.strength * score(rows.direction, rows.batch.target)
        return frozen(reward + hyperparameters.discount * follows)


class TD3BC(ActorCritic):
    """Offline learning of a deterministic actor near the demonstrations (Fujimoto and Gu 2021).

    The actor learns at each update; the paper's delay of every second one is left out, since actor
    and critics take one step of Adam together here.
    """

    StaticConfig: ClassVar[type] = config.TD3BCConfig
    Hyperparameters: ClassVar[type] = config.TD3BCHyperparameters
    name: ClassVar[str] = "td3_bc"
    stochastic: ClassVar[bool] = False
    online: ClassVar[bool] = False
    shown: ClassVar[bool] = True

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the losses of the critics and of the actor, in one sum.

        Args:
            network: Actor and critics.
            target_network: Running average of these.
            batch: Rows of demonstrations.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and its terms by name; "gap", the squared distance from demonstrated actions,
            and "max_q" are recorded only.
        """
        rows = batch
        target = self.target(target_network, rows, rows.key, hyperparameters)
        inputs = self.inputs(rows.batch.observation, rows.direction)
        q = jax.vmap(network.critics)(inputs, rows.batch.action)
        action = jnp.tanh(jax.vmap(network.actor)(inputs)[0])
        value = jax.vmap(frozen(network.critics))(inputs, action)[:, 0]
        gap = jnp.mean(jnp.square(action - rows.batch.action))
        terms = {
            "critic": actor_critic.critic_loss(q, target),
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
        """Return Y = λR(α) + γ (1 - d) min_i Q_i(s', a' + noise) of the target networks (TD3).

        Args:
            target_network: Actor of a', and critics of Q_i.
            rows: Rows of the update.
            key: Random key of the noise.
            hyperparameters: Numbers of one run.

        Returns:
            Y of each row, without gradient.
        """
        numbers = hyperparameters
        after = self.inputs(rows.batch.next_observation, rows.direction)
        action = jnp.tanh(jax.vmap(target_network.actor)(after)[0])
        noise = numbers.target_noise * jax.random.normal(key, action.shape)
        action = jnp.clip(
            action + jnp.clip(noise, -numbers.noise_clip, numbers.noise_clip), -1.0, 1.0
        )
        value = jax.vmap(target_network.critics)(after, action).min(axis=-1)
        settings = (self.volume, jnp.zeros(()), numbers, self.static)
        follows = losses.continued(value, rows.batch.ending, *settings)
        reward = numbers.strength * score(rows.direction, rows.batch.target)
        return frozen(reward + numbers.discount * follows)


def normalised(value: Float[Array, " batch"], weight: Any) -> Float[Array, ""]:
    """Return w E[Q] / E[abs Q], the divisor without gradient (Fujimoto and Gu 2021, Eq 4).

    Args:
        value: Q of each row.
        weight: w.

    Returns:
        The weighted mean; the divisor is at least 1e-6.
    """
    size = jax.lax.stop_gradient(jnp.mean(jnp.abs(value)))
    return weight * jnp.mean(value) / jnp.maximum(size, 1e-6)
