"""Actor and twin critics: networks of a policy of continuous actions and of its values.

Their input `seen` is an observation; of a dial it ends with the inputs of the angle
(`nn.dial_network.angle_columns`).
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.q_network import affine_layers, through

LOG_STD = (-5.0, 2.0)
"""Range of the logarithm of the standard deviation before the tangent is taken. A narrower policy
has a density of e^5 for each number of an action, a wider one puts nearly all on the bounds."""


class Actor(eqx.Module):
    """Mean and log-deviation of a squashed Gaussian, or a mean alone.

    Attributes:
        layers: Affine layers, with the activation between them; the last gives the means, then the
            log-deviations if there are any.
        activation: Name in `q_network.ACTIVATIONS`.
        size: Length of an action.
        scale: Common factor of the features.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    size: int = eqx.field(static=True)
    scale: float = eqx.field(static=True, default=1.0)

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_inputs: int,
        hidden: tuple[int, ...],
        size: int,
        activation: str = "relu",
        scale: float = 1.0,
        stochastic: bool = True,
    ) -> Actor:
        """Draw weights and biases uniformly within ±1/sqrt(fan-in).

        Args:
            key: Random key.
            n_inputs: Length of the input.
            hidden: Widths of the hidden layers.
            size: Length of an action.
            activation: Between layers.
            scale: Common factor of the features.
            stochastic: Whether there are deviations.
        """
        outputs = 2 * size if stochastic else size
        layers = affine_layers(key, (n_inputs, *hidden, outputs))
        return Actor(layers, activation, size, scale)

    def __call__(
        self, seen: Float[Array, " input"]
    ) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        """Return mean and log-deviation of u, of a = tanh(u); use `jax.vmap` for a batch.

        Without deviations the second is the lower end of `LOG_STD`.
        """
        value = through(self.layers, self.activation, seen * self.scale)
        mean = value[: self.size]
        if len(value) == self.size:
            return mean, jnp.full_like(mean, LOG_STD[0])
        return mean, jnp.clip(value[self.size :], *LOG_STD)


class Critic(eqx.Module):
    """Q(s, a) of continuous actions: a number from an input and an action.

    Attributes:
        layers: Affine layers, with the activation between them.
        activation: Name in `q_network.ACTIVATIONS`.
        scale: Common factor of the features; not of the action.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    scale: float = eqx.field(static=True, default=1.0)

    def __call__(
        self, seen: Float[Array, " input"], action: Float[Array, " size"]
    ) -> Float[Array, ""]:
        """Return the value of one action; use `jax.vmap` for a batch."""
        both = jnp.concatenate([seen * self.scale, action])
        return through(self.layers, self.activation, both)[0]


class TwinCritics(eqx.Module):
    """Two critics with weights of their own (Fujimoto et al. 2018): their minimum errs less high.

    Attributes:
        first: One.
        second: The other.
    """

    first: Critic
    second: Critic

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_inputs: int,
        hidden: tuple[int, ...],
        size: int,
        activation: str = "relu",
        scale: float = 1.0,
    ) -> TwinCritics:
        """Draw both; arguments as of `Actor.initialise`."""
        widths = (n_inputs + size, *hidden, 1)
        keys = jax.random.split(key)
        return TwinCritics(*(Critic(affine_layers(one, widths), activation, scale) for one in keys))

    def __call__(
        self, seen: Float[Array, " input"], action: Float[Array, " size"]
    ) -> Float[Array, " 2"]:
        """Return both values of one action; use `jax.vmap` for a batch."""
        return jnp.stack([self.first(seen, action), self.second(seen, action)])


def frozen(network: Any) -> Any:
    """Return a network whose weights have no gradient."""
    return jax.tree.map(jax.lax.stop_gradient, network)
