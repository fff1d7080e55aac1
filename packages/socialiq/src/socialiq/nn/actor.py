"""Actor and twin critics: networks of a policy of continuous actions and of its values.

Their input is an observation; of a dial it ends with the inputs of the angle
(`nn.view.angle_columns`). A view encodes the observation alone. The policy is a squashed
Gaussian: a = tanh(u) with u ~ N(mean, std²), a density on (-1, 1)^size (Haarnoja et al. 2018, soft
actor-critic, appendix C).
"""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.q_network import affine_layers, encoding, perceptron, through
from socialiq.nn.saved import LOG_STD
from socialiq.nn.view import Encoding


class Actor(eqx.Module):
    """Mean and log-deviation of a squashed Gaussian, or a mean alone.

    Attributes are those of `QNetwork`, and `size`, the length of an action. The last layer gives
    the means, then the log-deviations if there are any.
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
        """Draw a network (`q_network.perceptron`), with deviations if it is stochastic.

        Args:
            key: Random key.
            n_inputs: Number of inputs: the observation, and `extra` inputs after it.
            hidden: Widths of the hidden layers.
            size: Length of an action.
            activation: Name in `q_network.ACTIVATIONS` of the activation between layers.
            scale: Factor of the first layer's inputs.
            stochastic: Whether the last layer gives log-deviations too.
            view: Name in `view.CHOICES` of the encoding of the observation.
            times: Number of values of the time, the last feature of what a view reads; 0 without.
            extra: Number of inputs of an angle.

        Returns:
            The actor.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        widths = (*hidden, 2 * size if stochastic else size)
        layers, encoder = perceptron(key, n_inputs - extra, widths, view, (), times, extra)
        return Actor(layers, activation, size, scale, encoder)

    def __call__(
        self, inputs: Float[Array, " input"]
    ) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        """Return mean and log-deviation of u; without deviations the lower end of `LOG_STD`."""
        value = through(self.layers, self.activation, encoded(self.view, inputs) * self.scale)
        mean = value[: self.size]
        if len(value) == self.size:
            return mean, jnp.full_like(mean, LOG_STD[0])
        return mean, jnp.clip(value[self.size :], *LOG_STD)


def encoded(view: Encoding | None, inputs: Float[Array, " input"]) -> Float[Array, " encoded"]:
    """Return an input with its observation as a view encodes it; further inputs stay.

    Args:
        view: Encoding of the observation; None returns the input unchanged.
        inputs: One observation, then the inputs of an angle if there are any.

    Returns:
        The encoded observation, then the same further inputs.
    """
    if view is None:
        return inputs
    count = view.n_features
    return jnp.concatenate([view(inputs[:count]), inputs[count:]])


class Critic(eqx.Module):
    """Q(s, a) of continuous actions; `scale` is a factor of the features, not of the action."""

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    scale: float = eqx.field(static=True, default=1.0)

    def __call__(
        self, inputs: Float[Array, " input"], action: Float[Array, " size"]
    ) -> Float[Array, ""]:
        """Return the value of one action; use `jax.vmap` for a batch."""
        joined = jnp.concatenate([inputs * self.scale, action])
        return through(self.layers, self.activation, joined)[0]


class TwinCritics(eqx.Module):
    """Two critics that share a view (Fujimoto et al. 2018); their minimum overestimates less."""

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
        """Draw both critics, each from its own key.

        Args:
            key: Random key.
            n_inputs: Number of inputs without the action: the observation, and `extra` inputs after
                it.
            hidden: Widths of the hidden layers of each critic.
            size: Length of an action.
            activation: Name in `q_network.ACTIVATIONS` of the activation between layers.
            scale: Factor of the first layer's inputs, without the action.
            view: Name in `view.CHOICES` of the encoding of the observation, which both critics
                read.
            times: Number of values of the time, the last feature of what a view reads; 0 without.
            extra: Number of inputs of an angle.

        Returns:
            The critics.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        encoder = encoding(key, n_inputs - extra, view, times=times)
        width = encoder.width + extra if encoder else n_inputs
        widths = width + size, *hidden, 1
        keys = jax.random.split(key)
        critics = (Critic(affine_layers(half, widths), activation, scale) for half in keys)
        return TwinCritics(*critics, view=encoder)

    def __call__(
        self, inputs: Float[Array, " input"], action: Float[Array, " size"]
    ) -> Float[Array, " 2"]:
        """Return both values of one action; use `jax.vmap` for a batch."""
        features = encoded(self.view, inputs)
        return jnp.stack([self.first(features, action), self.second(features, action)])


def frozen(network: Any) -> Any:
    """Return a network whose weights have no gradient."""
    return jax.tree.map(jax.lax.stop_gradient, network)


Row = Float[Array, " size"]
Scalar = Float[Array, ""]

EDGE = 1e-3
"""Distance from a bound to which actions are moved: at the bound itself the density is 0 or
infinite. Demonstrators that press a control to its end have many such actions."""


def squash_log_slope(u: Row) -> Row:
    """Return log(1 - tanh(u)²) as 2 (log 2 - u - log(1 + e^-2u)), which doesn't round to log 0."""
    return 2.0 * (math.log(2.0) - u - jax.nn.softplus(-2.0 * u))


def log_density_before(u: Row, mean: Row, log_std: Row) -> Scalar:
    """Return log π(tanh(u)) = Σ log N(u; mean, std²) - Σ log(1 - tanh(u)²).

    This is Eq 21 of Haarnoja et al. 2018, for one row; sums run over the numbers of an action.

    Args:
        u: Action before the tangent is taken.
        mean: Mean of u.
        log_std: Logarithm of the standard deviation of u.

    Returns:
        The log-density of the action, in nats.
    """
    standardised = (u - mean) * jnp.exp(-log_std)
    gaussian = -0.5 * jnp.square(standardised) - log_std - 0.5 * math.log(2.0 * math.pi)
    return jnp.sum(gaussian - squash_log_slope(u))


def log_density(action: Row, mean: Row, log_std: Row) -> Scalar:
    """Return log π(a) of an action, which is moved to at least `EDGE` from the bounds.

    Args:
        action: One action in [-1, 1].
        mean: Mean of u, the action before the tangent is taken.
        log_std: Logarithm of the standard deviation of u.

    Returns:
        The log-density, in nats.
    """
    inside = jnp.clip(action, -1.0 + EDGE, 1.0 - EDGE)
    return log_density_before(jnp.arctanh(inside), mean, log_std)


def draw(noise: Row, mean: Row, log_std: Row) -> tuple[Row, Scalar]:
    """Return the action tanh(mean + std noise) and its log-density.

    Args:
        noise: Standard normal noise, one number for each of an action.
        mean: Mean of u, the action before the tangent is taken.
        log_std: Logarithm of the standard deviation of u.

    Returns:
        The action in (-1, 1), and its log-density in nats.
    """
    u = mean + jnp.exp(log_std) * noise
    return jnp.tanh(u), log_density_before(u, mean, log_std)
