"""The multi-layer perceptron Q(s, ·) of Table C.1, over the observation or a view of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.one_hot import OneHot
from socialiq.nn.view import View

ACTIVATIONS: dict[str, Callable[[Any], Any]] = {"relu": jax.nn.relu, "elu": jax.nn.elu}

Encoding = View | OneHot
"""What a first layer may read instead of the observation."""


class QNetwork(eqx.Module):
    """Observation in, one value per action out.

    Attributes:
        layers: Affine layers; the activation stands between them.
        activation: Name in `ACTIVATIONS`.
        view: What the first layer reads instead of the observation itself.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    view: Encoding | None = None

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_features: int,
        hidden: tuple[int, ...],
        n_actions: int,
        activation: str = "relu",
        view: str = "flat",
        one_hot: tuple[tuple[int, int], ...] = (),
    ) -> QNetwork:
        """Draw weights and biases uniformly within ±1/sqrt(fan-in).

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        seen = encoding(key, n_features, view, one_hot)
        inputs = seen.width if seen else n_features
        return QNetwork(affine_layers(key, (inputs, *hidden, n_actions)), activation, seen)

    def __call__(self, observation: Float[Array, " feature"]) -> Float[Array, " action"]:
        """Values of one observation; `jax.vmap` for a batch."""
        value = self.view(observation) if self.view else observation
        return through(self.layers, self.activation, value)


def encoding(
    key: PRNGKeyArray, n_features: int, view: str, one_hot: tuple[tuple[int, int], ...]
) -> Encoding | None:
    """What a first layer reads: one place for each value if the values are told, else a view.

    Raises:
        UserError: If the view is unknown or doesn't fit the observation.
    """
    if one_hot:
        return OneHot.of(one_hot)
    return View.initialise(jax.random.fold_in(key, 0), view, n_features)


def affine_layers(key: PRNGKeyArray, sizes: Sequence[int]) -> tuple[eqx.nn.Linear, ...]:
    """Layers of these widths, the inputs' first."""
    keys = jax.random.split(key, len(sizes) - 1)
    return tuple(
        eqx.nn.Linear(inputs, outputs, key=one)
        for inputs, outputs, one in zip(sizes[:-1], sizes[1:], keys, strict=True)
    )


def through(
    layers: Sequence[eqx.nn.Linear], activation: str, value: Float[Array, " input"]
) -> Float[Array, " output"]:
    """Pass a value through layers, with the activation between them."""
    *inner, last = layers
    for layer in inner:
        value = ACTIVATIONS[activation](layer(value))
    return last(value)


def network_of(networks: Any, run: int) -> Any:
    """One network of many whose arrays share a leading run axis."""
    return jax.tree.map(lambda leaf: leaf[run], networks)
