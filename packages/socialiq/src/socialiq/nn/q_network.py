"""Multi-layer perceptron Q(s, ·) of Table C.1, over the observation or a view of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.view import OneHot, View

ACTIVATIONS: dict[str, Callable[[Any], Any]] = {"relu": jax.nn.relu, "elu": jax.nn.elu}

Encoding = View | OneHot
"""Encodings that a first layer may read instead of the observation."""


@runtime_checkable
class ValueNetwork(Protocol):
    """Network from an observation to a value per action, whose policy a `QPolicy` holds.

    The layers' outputs may differ from the values by a number of the state.
    """

    @property
    def layers(self) -> tuple[Any, ...]:
        """Affine layers, with the activation between them."""
        ...

    @property
    def activation(self) -> str:
        """Name in `ACTIVATIONS` of the activation between layers."""
        ...

    @property
    def view(self) -> Encoding | None:
        """Encoding of the observation that the first layer reads; None for none."""
        ...

    @property
    def scale(self) -> float:
        """Common factor of the features; only without a view."""
        ...

    def __call__(self, observation: Float[Array, " feature"]) -> Float[Array, " action"]:
        """Return the values of one observation."""
        ...


class QNetwork(eqx.Module):
    """Q-network, from an observation to a value per action.

    Attributes:
        layers: Affine layers, with the activation between them.
        activation: Name in `ACTIVATIONS`.
        view: Encoding of the observation that the first layer reads; None for none.
        scale: Common factor of the features; only without a view.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    view: Encoding | None = None
    scale: float = eqx.field(static=True, default=1.0)

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_features: int,
        hidden: tuple[int, ...],
        n_actions: int,
        activation: str = "relu",
        view: str = "flat",
        one_hot: tuple[tuple[int, int], ...] = (),
        scale: float = 1.0,
        times: int = 0,
    ) -> QNetwork:
        """Draw weights and biases uniformly within ±1/sqrt(fan-in).

        Args:
            key: Random key.
            n_features: Length of an observation.
            hidden: Widths of the hidden layers.
            n_actions: Number of actions.
            activation: Activation between layers.
            view: A name of `nn.view.CHOICES`.
            one_hot: Smallest value and number of values of each feature; none for the view.
            scale: Common factor of the features; only without a view.
            times: Number of values of the time, the last feature of what a view reads.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        seen = encoding(key, n_features, view, one_hot, times)
        inputs = seen.width if seen else n_features
        layers = affine_layers(key, (inputs, *hidden, n_actions))
        return QNetwork(layers, activation, seen, scale)

    def __call__(self, observation: Float[Array, " feature"]) -> Float[Array, " action"]:
        """Return the values of one observation; use `jax.vmap` for a batch."""
        value = self.view(observation) if self.view else observation
        if self.scale != 1.0:
            value = value * self.scale
        return through(self.layers, self.activation, value)


def encoding(
    key: PRNGKeyArray,
    n_features: int,
    view: str,
    one_hot: tuple[tuple[int, int], ...],
    times: int = 0,
) -> Encoding | None:
    """Return the encoding of a first layer: one-hot if the values are given, else a view.

    Args:
        key: Random key.
        n_features: Length of an observation.
        view: A name of `nn.view.CHOICES`.
        one_hot: Smallest value and number of values of each feature; none for the view.
        times: Number of values of the time, the last feature of what a view reads; 0 for none.

    Raises:
        UserError: If the view is unknown or doesn't fit the observation.
    """
    if one_hot:
        return OneHot.of(one_hot)
    return View.initialise(jax.random.fold_in(key, 0), view, n_features, times)


def affine_layers(key: PRNGKeyArray, sizes: Sequence[int]) -> tuple[eqx.nn.Linear, ...]:
    """Return affine layers of the given widths, beginning with the input's."""
    keys = jax.random.split(key, len(sizes) - 1)
    return tuple(
        eqx.nn.Linear(inputs, outputs, key=one)
        for inputs, outputs, one in zip(sizes[:-1], sizes[1:], keys, strict=True)
    )


def through(
    layers: Sequence[eqx.nn.Linear], activation: str, value: Float[Array, " input"]
) -> Float[Array, " output"]:
    """Apply layers to a value, with the activation between them."""
    *inner, last = layers
    for layer in inner:
        value = ACTIVATIONS[activation](layer(value))
    return last(value)


def network_of(networks: Any, run: int) -> Any:
    """Return one of many networks whose arrays share a leading run axis."""
    return jax.tree.map(lambda leaf: leaf[run], networks)


def linear_layers(
    weights: Sequence[np.ndarray], biases: Sequence[np.ndarray]
) -> tuple[eqx.nn.Linear, ...]:
    """Return layers that can be trained, of the weights and biases of a saved policy."""
    key = jax.random.key(0)  # of weights that are replaced
    return tuple(
        eqx.tree_at(
            lambda layer: (layer.weight, layer.bias),
            eqx.nn.Linear(weight.shape[1], weight.shape[0], key=key),
            (jnp.asarray(weight), jnp.asarray(bias)),
        )
        for weight, bias in zip(weights, biases, strict=True)
    )
