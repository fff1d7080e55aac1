"""Implicit Q-learning on R(α), offline (Kostrikov et al. 2022).

Q is never asked for an action that the data don't have: V is an upper expectile of Q over the
demonstrated actions, Q is fitted to r + γ V(s'), and the policy clones the demonstrations with the
weight exp(β (Q - V)).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.baselines.bellman import log_likelihood, of_taken
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.settings import check_above_zero, check_shares
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score

LARGEST_WEIGHT = 100.0
"""Bound of exp(β (Q - V)), as in the paper."""


@dataclass(frozen=True)
class StaticConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    endings: Endings = field(default_factory=Endings)
    """Value of V(s') after each kind of ending."""


@dataclass(frozen=True)
class Hyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    expectile: float = 0.7
    """Expectile of Q over demonstrated actions that V is: 0.5 the mean, towards 1 the maximum."""
    inverse_temperature: float = 3.0
    """β of the policy's weights."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        super().__post_init__()
        check_shares(self, ("expectile",))
        check_above_zero(self, ("inverse_temperature",))


class Networks(NamedTuple):
    """Q(s, ·), V(s), and the policy's logits."""

    values: QNetwork
    state_value: QNetwork
    policy: QNetwork


class ImplicitQLearning(Learner):
    """Implicit Q-learning of demonstrations; the policy is a network of its own."""

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = Hyperparameters
    name: ClassVar[str] = "implicit_q_learning"

    def network(self, key: PRNGKeyArray) -> Networks:
        """Draw three networks of the same hidden layers."""
        one, (n_features, n_actions) = self.static, self.sizes
        return Networks(
            *(
                QNetwork.initialise(
                    of_part,
                    n_features,
                    one.hidden,
                    outputs,
                    one.activation,
                    one.view,
                    scale=one.input_scale,
                )
                for of_part, outputs in zip(
                    jax.random.split(key, 3), (n_actions, 1, n_actions), strict=True
                )
            )
        )

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Sum of the three losses; none has a gradient in another's network."""
        return implicit_loss(network, target_network, batch, hyperparameters, self.static)

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> QPolicy:  # noqa: ARG002
        """Return the cloned policy."""
        return QPolicy.of(state.network.policy, 1.0, self.record(hyperparameters))


def expectile_loss(
    difference: Float[Array, " batch"], expectile: Float[Array, ""] | float
) -> Float[Array, ""]:
    """``E[|τ - 1(u < 0)| u²]`` of differences u (their Eq 5)."""
    return jnp.mean(jnp.abs(expectile - (difference < 0)) * jnp.square(difference))


def implicit_loss(
    network: Networks,
    target_network: Networks,
    batch: Batch,
    hyperparameters: HyperparameterArrays,
    static: StaticConfig,
) -> tuple[Float[Array, ""], Terms]:
    """Losses of V (Eq 5), of Q (Eq 6) and of the policy (Eq 7), each with its own batch mean."""
    observation, action = batch.observation, batch.action
    steady = of_taken(jax.vmap(target_network.values)(observation), action)
    value = jax.vmap(network.state_value)(observation)[:, 0]
    next_value = jax.vmap(network.state_value)(batch.next_observation)[:, 0]
    follows = losses.continuation(next_value, batch.ending, static.endings.by_kind(), 0.0)
    reward = hyperparameters.strength * score(hyperparameters.weights, batch.target)
    target = jax.lax.stop_gradient(reward + hyperparameters.discount * follows)
    q = of_taken(jax.vmap(network.values)(observation), action)
    advantage = jax.lax.stop_gradient(steady - value)
    weight = jnp.minimum(jnp.exp(hyperparameters.inverse_temperature * advantage), LARGEST_WEIGHT)
    cloned = log_likelihood(jax.vmap(network.policy)(observation), action)
    terms = {
        "state_value": expectile_loss(
            jax.lax.stop_gradient(steady) - value, hyperparameters.expectile
        ),
        "values": jnp.mean(jnp.square(target - q)),
        "policy": -jnp.mean(weight * cloned),
    }
    return sum(terms.values(), jnp.zeros(())), terms | {"loss": sum(terms.values(), jnp.zeros(()))}
