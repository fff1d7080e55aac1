"""Networks Q(s, ·) that can be trained: the perceptron of Table C.1, and value and policy apart.

Both read the observation or a view of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.errors import UserError, one_of
from socialiq.nn.view import CHOICES, ENCODER, ROW, Encoding, OneHot, View, row_width

ACTIVATIONS: dict[str, Callable[[Any], Any]] = {"relu": jax.nn.relu, "elu": jax.nn.elu}

# Encodings are NumPy's; in a network their weights are trained.
jax.tree_util.register_dataclass(
    View, data_fields=["weights", "biases"], meta_fields=["choice", "n_features", "times"]
)
jax.tree_util.register_dataclass(OneHot, data_fields=[], meta_fields=["lows", "sizes"])


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
        """Draw a network (`perceptron`).

        Args:
            key: Random key.
            n_features: Length of an observation.
            hidden: Widths of the hidden layers.
            n_actions: Number of actions.
            activation: Name in `ACTIVATIONS` of the activation between layers.
            view: Name in `view.CHOICES` of the encoding of the observation.
            one_hot: Smallest value and number of values of each feature, for observations of
                integers; empty: the network reads the view.
            scale: Common factor of features without a view.
            times: Number of values of the time, the last feature of what a view reads; 0 without.

        Returns:
            The network.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        layers, encoder = perceptron(key, n_features, (*hidden, n_actions), view, one_hot, times)
        return QNetwork(layers, activation, encoder, scale)

    def __call__(self, observation: Float[Array, " feature"]) -> Float[Array, " action"]:
        """Return the values of one observation; use `jax.vmap` for a batch."""
        value = self.view(observation) if self.view else observation
        if self.scale != 1.0:
            value = value * self.scale
        return through(self.layers, self.activation, value)


class DuelingNetwork(eqx.Module):
    """Q-network of two networks without common weights: the soft value of a state, and logits.

    Q(s, a) = V(s) + τ log softmax(l(s))(a). Then τ logsumexp(Q/τ) is V and softmax(Q/τ) is
    softmax(l), whatever the weights: any Q has exactly one such form, and a policy is as easy to
    fit as a classifier's. Wang et al. 2016 separate value and advantage in this sense for a hard
    maximum. As a policy it is τ l(s), which is Q less a number of the state.

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
        """Draw both networks, each from its own key.

        Args:
            key: Random key.
            temperature: τ, in units of Q.
            n_features: Length of an observation.
            hidden: Widths of the hidden layers of each network.
            n_actions: Number of actions.
            activation: Name in `ACTIVATIONS` of the activation between layers.
            view: Name in `view.CHOICES` of the encoding of the observation.
            scale: Common factor of features without a view.

        Returns:
            The network.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        for_value, for_logits = jax.random.split(key)
        value, logits = (
            QNetwork.initialise(half, n_features, hidden, outputs, activation, view, scale=scale)
            for half, outputs in ((for_value, 1), (for_logits, n_actions))
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
        return (*inner, jax.tree.map(lambda leaf: leaf * self.temperature, last))

    @property
    def activation(self) -> str:
        """Activation of the logits."""
        return self.logits.activation

    @property
    def scale(self) -> float:
        """Scale of the logits."""
        return self.logits.scale

    @property
    def view(self) -> Encoding | None:
        """View of the logits."""
        return self.logits.view


ValueNetwork = QNetwork | DuelingNetwork
"""Network from an observation to a value per action, whose policy a `QPolicy` holds."""


def encoding(
    key: PRNGKeyArray,
    n_features: int,
    view: str,
    one_hot: tuple[tuple[int, int], ...] = (),
    times: int = 0,
) -> Encoding | None:
    """Return the encoding of a first layer: one-hot if the values are given, else a view.

    Args:
        key: Random key of a view's layers.
        n_features: Length of an observation.
        view: Name in `view.CHOICES`.
        one_hot: Smallest value and number of values of each feature; empty: the view is used.
        times: Number of values of the time, the last feature of what a view reads; 0 without.

    Returns:
        The encoding; None for the flat view, which has no layers.

    Raises:
        UserError: If the view is unknown or doesn't fit the observation.
    """
    if one_hot:
        return OneHot.of(one_hot)
    one_of("view", view, tuple(CHOICES))
    unfitted = CHOICES[view]
    if unfitted is None:
        return None
    listed = n_features - bool(times)
    choice = unfitted.fitting(listed)
    if choice is None:
        raise UserError(
            f"view {view} reads rows of {ROW} numbers, one for each vehicle, and this world's "
            f"observation has {listed}: use the view flat"
        )
    sizes = (row_width(choice), *ENCODER) if choice.pooled else ()
    # A key more than layers, as ever.
    keys = jax.random.split(jax.random.fold_in(key, 0), len(sizes))
    layers = [
        eqx.nn.Linear(inputs, outputs, key=layer_key)
        for inputs, outputs, layer_key in zip(sizes[:-1], sizes[1:], keys, strict=False)
    ]
    weights, biases = (
        tuple(getattr(layer, name) for layer in layers) for name in ("weight", "bias")
    )
    return View(weights, biases, choice, n_features, times)


def perceptron(
    key: PRNGKeyArray,
    n_features: int,
    widths: Sequence[int],
    view: str,
    one_hot: tuple[tuple[int, int], ...] = (),
    times: int = 0,
    extra: int = 0,
) -> tuple[tuple[eqx.nn.Linear, ...], Encoding | None]:
    """Draw layers, uniformly within ±1/sqrt(fan-in), and the encoding that the first one reads.

    Args:
        key: Random key.
        n_features: Length of an observation.
        widths: Widths of the hidden layers, then the number of outputs.
        view: Name in `view.CHOICES` of the encoding of the observation.
        one_hot: Smallest value and number of values of each feature; empty: the view is used.
        times: Number of values of the time, the last feature of what a view reads; 0 without.
        extra: Number of inputs of an angle after the observation.

    Returns:
        The layers, and the encoding; None for the flat view.

    Raises:
        UserError: If the view is unknown or doesn't fit the observation.
    """
    encoder = encoding(key, n_features, view, one_hot, times)
    inputs = (encoder.width if encoder else n_features) + extra
    return affine_layers(key, (inputs, *widths)), encoder


def affine_layers(key: PRNGKeyArray, sizes: Sequence[int]) -> tuple[eqx.nn.Linear, ...]:
    """Return affine layers, drawn uniformly within ±1/sqrt(fan-in).

    Args:
        key: Random key.
        sizes: Number of inputs of the first layer, then the outputs of each layer.

    Returns:
        The layers, one fewer than the sizes.
    """
    keys = jax.random.split(key, len(sizes) - 1)
    return tuple(
        eqx.nn.Linear(inputs, outputs, key=layer_key)
        for inputs, outputs, layer_key in zip(sizes[:-1], sizes[1:], keys, strict=True)
    )


def through(
    layers: Sequence[eqx.nn.Linear], activation: str, value: Float[Array, " input"]
) -> Float[Array, " output"]:
    """Apply layers to a value, with the activation between them.

    Args:
        layers: Layers in their order.
        activation: Name in `ACTIVATIONS`.
        value: Inputs of the first layer, without a batch axis.

    Returns:
        Outputs of the last layer, to which no activation is applied.
    """
    *inner, last = layers
    for layer in inner:
        value = ACTIVATIONS[activation](layer(value))
    return last(value)


def network_of(networks: Any, run: int) -> Any:
    """Return one of many networks whose arrays share a leading run axis.

    Args:
        networks: Networks, or any tree of arrays, with the run axis.
        run: Index of the run.

    Returns:
        The same tree without the run axis.
    """
    return jax.tree.map(lambda leaf: leaf[run], networks)


def trainable(policy: Any) -> tuple[tuple[eqx.nn.Linear, ...], Encoding | None]:
    """Return layers and encoding of a saved policy as arrays that can be trained."""
    key = jax.random.key(0)  # of weights that are replaced
    layers = tuple(
        with_weights(eqx.nn.Linear(*reversed(weight.shape), key=key), weight, bias)
        for weight, bias in zip(policy.weights, policy.biases, strict=True)
    )
    return layers, jax.tree.map(jnp.asarray, policy.view)


def with_weights(layer: eqx.nn.Linear, weight: Any, bias: Any) -> eqx.nn.Linear:
    """Return a layer with these weights and biases.

    Args:
        layer: The layer that is copied.
        weight: Weight matrix, (outputs, inputs).
        bias: Bias, (outputs,).

    Returns:
        A layer with JAX arrays; `layer` is unchanged.
    """
    arrays = (jnp.asarray(weight), jnp.asarray(bias))
    return eqx.tree_at(lambda linear: (linear.weight, linear.bias), layer, arrays)
