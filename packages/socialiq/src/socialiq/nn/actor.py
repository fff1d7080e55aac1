"""Actor and twin critics: networks of a policy of continuous actions and of its values.

Their input `seen` is an observation; of a dial it ends with the inputs of the angle
(`nn.dial_network.angle_columns`). A view encodes the observation alone.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.q_network import Encoding, affine_layers, encoding, through

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
        view: Encoding of the observation that the first layer reads; None for none.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    size: int = eqx.field(static=True)
    scale: float = eqx.field(static=True, default=1.0)
    view: Encoding | None = None

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_inputs: int,
        hidden: tuple[int, ...],
        size: int,
        activation: str = "relu",
        scale: float = 1.0,
        stochastic: bool = True,
        view: str = "flat",
        times: int = 0,
        extra: int = 0,
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
            view: A name of `nn.view.CHOICES`.
            times: Number of values of the time, the last feature of what a view reads.
            extra: Inputs after the observation, those of an angle.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        outputs = 2 * size if stochastic else size
        seen = encoding(key, n_inputs - extra, view, (), times)
        width = seen.width + extra if seen else n_inputs
        layers = affine_layers(key, (width, *hidden, outputs))
        return Actor(layers, activation, size, scale, seen)

    def __call__(
        self, seen: Float[Array, " input"]
    ) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        """Return mean and log-deviation of u, of a = tanh(u); use `jax.vmap` for a batch.

        Without deviations the second is the lower end of `LOG_STD`.
        """
        value = through(self.layers, self.activation, encoded(self.view, seen) * self.scale)
        mean = value[: self.size]
        if len(value) == self.size:
            return mean, jnp.full_like(mean, LOG_STD[0])
        return mean, jnp.clip(value[self.size :], *LOG_STD)


def encoded(view: Encoding | None, seen: Float[Array, " input"]) -> Float[Array, " encoded"]:
    """Return an input with its observation as a view encodes it; further inputs stay."""
    if view is None:
        return seen
    count = view.n_features
    return jnp.concatenate([view(seen[:count]), seen[count:]])


class Critic(eqx.Module):
    """Q(s, a) of continuous actions: a number from an input, encoded if need be, and an action.

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
        view: Encoding of the observation that both read; None for none.
    """

    first: Critic
    second: Critic
    view: Encoding | None = None

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_inputs: int,
        hidden: tuple[int, ...],
        size: int,
        activation: str = "relu",
        scale: float = 1.0,
        view: str = "flat",
        times: int = 0,
        extra: int = 0,
    ) -> TwinCritics:
        """Draw both; arguments and errors as of `Actor.initialise`."""
        seen = encoding(key, n_inputs - extra, view, (), times)
        width = seen.width + extra if seen else n_inputs
        widths, keys = (width + size, *hidden, 1), jax.random.split(key)
        both = (Critic(affine_layers(one, widths), activation, scale) for one in keys)
        return TwinCritics(*both, view=seen)

    def __call__(
        self, seen: Float[Array, " input"], action: Float[Array, " size"]
    ) -> Float[Array, " 2"]:
        """Return both values of one action; use `jax.vmap` for a batch."""
        read = encoded(self.view, seen)
        return jnp.stack([self.first(read, action), self.second(read, action)])


def frozen(network: Any) -> Any:
    """Return a network whose weights have no gradient."""
    return jax.tree.map(jax.lax.stop_gradient, network)
