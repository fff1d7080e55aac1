"""Q-network in two parts: the soft value of a state, and the logits of the soft policy.

    Q(s, a) = V(s) + τ log softmax(l(s))(a)

Then τ logsumexp(Q/τ) is V and softmax(Q/τ) is softmax(l), whatever the weights: any Q has exactly
one such form. In a plain network differences between actions of size τ are small beside values of
the size of a return, and an error of the value drowns them. Here a policy is as easy to fit as a
classifier's. Wang et al. 2016 separate value and advantage in this sense for a hard maximum.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.q_network import Encoding, QNetwork


class DuelingNetwork(eqx.Module):
    """Q-network of two networks without common weights.

    It has the attributes of the logits' `QNetwork` in units of Q: as a policy it is τ l(s), which
    is Q less a number of the state.

    Attributes:
        value: V, one output.
        logits: l, one output for each action.
        temperature: τ, which isn't trained.
    """

    value: QNetwork
    logits: QNetwork
    temperature: Float[Array, ""]

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        temperature: Float[Array, ""] | float,
        n_features: int,
        hidden: tuple[int, ...],
        n_actions: int,
        activation: str = "relu",
        view: str = "flat",
        scale: float = 1.0,
    ) -> DuelingNetwork:
        """Draw weights and biases uniformly within ±1/sqrt(fan-in).

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        for_value, for_logits = jax.random.split(key)
        value, logits = (
            QNetwork.initialise(one, n_features, hidden, outputs, activation, view, scale=scale)
            for one, outputs in ((for_value, 1), (for_logits, n_actions))
        )
        return DuelingNetwork(value, logits, jnp.asarray(temperature, jnp.float32))

    def __call__(self, observation: Float[Array, " feature"]) -> Float[Array, " action"]:
        """Return the values of one observation; use `jax.vmap` for a batch."""
        advantage = jax.nn.log_softmax(self.logits(observation))
        return self.value(observation) + jax.lax.stop_gradient(self.temperature) * advantage

    @property
    def layers(self) -> tuple[Any, ...]:
        """Layers of the logits, the last one in units of Q."""
        *inner, last = self.logits.layers
        scaled = jax.tree.map(lambda leaf: leaf * self.temperature, last)
        return (*inner, scaled)

    @property
    def activation(self) -> str:
        """Activation between layers."""
        return self.logits.activation

    @property
    def scale(self) -> float:
        """Common factor of the features."""
        return self.logits.scale

    @property
    def view(self) -> Encoding | None:
        """Encoding of the observation that the first layer reads; None for none."""
        return self.logits.view
