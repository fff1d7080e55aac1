"""Trained network as a policy: NumPy only, `predict` as in Stable-Baselines3, safetensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError, one_of
from socialiq.nn import perceptron
from socialiq.nn.file_checks import FAULTS, fault_before, fault_of
from socialiq.nn.q_network import ACTIVATIONS as TRAINABLE
from socialiq.nn.q_network import Encoding, QNetwork, ValueNetwork, linear_layers
from socialiq.nn.value_policy import ValuePolicy
from socialiq.nn.view import Choice, OneHot, View
from socialiq.storage import load_arrays, save_arrays

SCHEMA_VERSION = 2

ACTIVATIONS = tuple(perceptron.ACTIVATIONS)
"""Names of the activations of a policy."""


@dataclass(frozen=True)
class QPolicy(ValuePolicy):
    """Policy that selects actions from a Q-network: greedy, or from softmax(Q/τ).

    Attributes:
        weights: Weight matrix of each layer, (outputs, inputs).
        biases: Bias of each layer.
        activation: One of `ACTIVATIONS`, applied between layers.
        temperature: τ of the stochastic policy softmax(Q/τ).
        provenance: JSON-compatible record of how the policy was made.
        rng: Generator of the stochastic policy's draws.
        view: Encoding of the observation that the first layer reads, with NumPy weights.
        sha256: SHA-256 of the file's content, for a policy that was loaded.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str
    temperature: float
    provenance: Mapping[str, Any] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    view: Encoding | None = None
    sha256: str = ""

    @staticmethod
    def of(
        network: ValueNetwork,
        temperature: float,
        provenance: Mapping[str, Any],
        rng: np.random.Generator | None = None,
    ) -> QPolicy:
        """Build the policy from a trained network; its scale becomes part of the first layer."""
        first, *others = (np.asarray(layer.weight) for layer in network.layers)
        return QPolicy(
            (first if network.scale == 1.0 else first * np.float32(network.scale), *others),
            tuple(np.asarray(layer.bias) for layer in network.layers),
            network.activation,
            float(temperature),
            provenance,
            np.random.default_rng(0) if rng is None else rng,
            network.view.in_numpy() if network.view else None,
        )

    def network(self) -> QNetwork:
        """Return the network, which can be trained: the inverse of `of`.

        Raises:
            UserError: If its activation is of an imported policy.
        """
        one_of("activation of a trainable network", self.activation, tuple(TRAINABLE))
        view = jax.tree.map(jnp.asarray, self.view)
        return QNetwork(linear_layers(self.weights, self.biases), self.activation, view)

    def with_clock(self, times: int) -> QPolicy:
        """Return the same policy for observations that end with the time, which it ignores.

        A run that begins with it can learn to use the time.

        Args:
            times: Number of values of the time, 0, 1, ..., times - 1.

        Raises:
            UserError: If its view isn't of vehicles, or has a clock.
        """
        if not isinstance(self.view, View) or self.view.times:
            raise UserError("a clock can be added to a network with a view of vehicles, once")
        seen = dataclasses.replace(self.view, n_features=self.view.n_features + 1, times=times)
        first, *others = self.weights
        ignored = np.zeros((len(first), times), first.dtype)  # a view puts the time first
        return dataclasses.replace(self, weights=(np.hstack([ignored, first]), *others), view=seen)

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.view.n_features if self.view else self.weights[0].shape[1]

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.weights[-1].shape[0]

    def q_values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return Q of each observation and action, shape (batch, actions).

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        value = self.checked_batch(observations)
        value = self.view(value) if self.view else value
        return perceptron.perceptron(self.weights, self.biases, self.activation, value)

    def save(self, path: Path, replace: bool = True) -> str:
        """Write the policy to one safetensors file.

        Args:
            path: The file; its folder must exist.
            replace: Whether a file there is replaced.

        Returns:
            SHA-256 of the content.

        Raises:
            UserError: If the file can't be written.
        """
        return save_arrays(path, "policy", SCHEMA_VERSION, *self.content(), replace=replace)

    @staticmethod
    def load(path: Path) -> QPolicy:
        """Read a policy written by `save`.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        return QPolicy.checked(path, *load_arrays(path, "policy", SCHEMA_VERSION))

    @staticmethod
    def checked(
        path: Path, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any], extra: int = 0
    ) -> QPolicy:
        """Build a policy from a file's content, after a check that its parts agree.

        Args:
            path: The file, for messages.
            arrays: Its arrays.
            header: Its header.
            extra: Inputs of the first layer that are not part of the observation.

        Raises:
            UserError: If they don't agree.
        """
        fault = fault_before(arrays, header)
        try:
            policy = None if fault else QPolicy.of_content(arrays, header)
            fault = fault or fault_of(policy, ACTIVATIONS, extra)
        except FAULTS as error:
            raise UserError(
                f"{path} has a header that doesn't fit its arrays: make the file again"
            ) from error
        if fault or policy is None:
            raise UserError(f"{path} {fault}: make the file again")
        return policy

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the policy's file."""
        arrays = {f"weight_{i}": weight for i, weight in enumerate(self.weights)}
        arrays |= {f"bias_{i}": bias for i, bias in enumerate(self.biases)}
        header = {
            "activation": self.activation,
            "temperature": self.temperature,
            "layers": len(self.weights),
            "view": None,
            "provenance": dict(self.provenance),
        }
        of_view, described = content_of_view(self.view)
        return arrays | of_view, header | described

    @staticmethod
    def of_content(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> QPolicy:
        """Build a policy from a file's content, the inverse of `content`."""
        layers = range(header["layers"])
        return QPolicy(
            tuple(arrays[f"weight_{i}"] for i in layers),
            tuple(arrays[f"bias_{i}"] for i in layers),
            header["activation"],
            header["temperature"],
            header["provenance"],
            view=view_of(arrays, header),
            sha256=header["sha256"],
        )


def content_of_view(view: Encoding | None) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the named arrays of an encoding, and what it adds to the header of a policy's file."""
    if isinstance(view, OneHot):
        return {}, {"one_hot": {"lows": view.lows, "sizes": view.sizes}}
    if view is None:
        return {}, {}
    arrays = {f"view_weight_{i}": weight for i, weight in enumerate(view.weights)}
    arrays |= {f"view_bias_{i}": bias for i, bias in enumerate(view.biases)}
    described: dict[str, Any] = {
        **view.choice.described(),
        "layers": len(view.weights),
        "n_features": view.n_features,
    }
    if view.times:
        described["times"] = view.times
    return arrays, {"view": described}


def view_of(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> Encoding | None:
    """Return the view described by a file."""
    if places := header.get("one_hot"):
        return OneHot(tuple(places["lows"]), tuple(places["sizes"]))
    described = header["view"]
    if described is None:
        return None
    layers = range(described["layers"])
    return View(
        tuple(arrays[f"view_weight_{i}"] for i in layers),
        tuple(arrays[f"view_bias_{i}"] for i in layers),
        Choice.of_described(described),
        described["n_features"],
        described.get("times", 0),
    )
