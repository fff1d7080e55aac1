"""Trained actor as a policy of continuous actions, and its dial: NumPy only, safetensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32

from socialiq.errors import UserError
from socialiq.nn.actor import LOG_STD, Actor
from socialiq.nn.dial_policy import check_in_range, range_of
from socialiq.nn.file_checks import FAULTS, chained, fault_before, view_is_possible
from socialiq.nn.perceptron import ACTIVATIONS, perceptron
from socialiq.nn.q_network import Encoding, linear_layers
from socialiq.nn.q_policy import content_of_view, view_of
from socialiq.nn.value_policy import checked_batch, numbers_of
from socialiq.social.angle import exact_weights
from socialiq.storage import load_arrays, save_arrays

KIND, DIAL_KIND = "actor", "actor-dial"
SCHEMA_VERSION = 1

SQUASHES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh": np.tanh,
    "clip": lambda u: np.clip(u, -1.0, 1.0),  # of imported policies
}
"""Functions from u to the action."""


@dataclass(frozen=True)
class ActorPolicy:
    """Policy of continuous actions in [-1, 1], the ends being the bounds of the world's: tanh(u).

    Deterministic, u is the mean; else it is drawn from N(mean, std²), if the network has
    deviations.

    Attributes:
        weights: Weight matrix of each layer, (outputs, inputs).
        biases: Bias of each layer.
        activation: One of `nn.perceptron.ACTIVATIONS`, applied between layers.
        action_size: Length of an action; the last layer has as many means, and no or as many
            log-deviations.
        provenance: JSON-compatible record of how the policy was made.
        rng: Generator of the stochastic policy's draws.
        sha256: SHA-256 of the file's content, for a policy that was loaded.
        squash: One of `SQUASHES`; "tanh" but for some imported policies.
        view: Encoding of the observation that the first layer reads, with NumPy weights.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str
    action_size: int
    provenance: Mapping[str, Any] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    sha256: str = ""
    squash: str = "tanh"
    view: Encoding | None = None

    @staticmethod
    def of(
        actor: Actor, provenance: Mapping[str, Any], rng: np.random.Generator | None = None
    ) -> ActorPolicy:
        """Build the policy from a trained actor; its scale becomes part of the first layer."""
        first, *others = (np.asarray(layer.weight) for layer in actor.layers)
        return ActorPolicy(
            (first if actor.scale == 1.0 else first * np.float32(actor.scale), *others),
            tuple(np.asarray(layer.bias) for layer in actor.layers),
            actor.activation,
            actor.size,
            provenance,
            np.random.default_rng(0) if rng is None else rng,
            view=actor.view.in_numpy() if actor.view else None,
        )

    def network(self) -> Actor:
        """Return the actor, which can be trained: the inverse of `of`."""
        layers = linear_layers(self.weights, self.biases)
        view = jax.tree.map(jnp.asarray, self.view)
        return Actor(layers, self.activation, self.action_size, view=view)

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.view.n_features if self.view else self.weights[0].shape[1]

    @property
    def n_actions(self) -> int:
        """Number of discrete actions: none."""
        return 0

    @property
    def is_stochastic(self) -> bool:
        """Whether the network has deviations."""
        return len(self.biases[-1]) == 2 * self.action_size

    def gaussian(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> tuple[Float32[np.ndarray, "batch size"], Float32[np.ndarray, "batch size"]]:
        """Return mean and deviation of u for each observation; 0 without deviations.

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        batch = checked_batch(observations, self.n_features)
        batch = self.view(batch) if self.view else batch
        value = perceptron(self.weights, self.biases, self.activation, batch)
        mean = value[:, : self.action_size]
        if not self.is_stochastic:
            return mean, np.zeros_like(mean)
        return mean, np.exp(np.clip(value[:, self.action_size :], *LOG_STD))

    def predict(
        self,
        observation: object,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions in [-1, 1]: the mean u, or a drawn one, squashed.

        Args:
            observation: Shape (features,) or (batch, features).
            state: Returned unchanged; the policy has no memory.
            episode_start: Ignored, for the same reason.
            deterministic: Whether the mean is taken.

        Returns:
            Float32 (size,) or (batch, size), and the state.

        Raises:
            UserError: If an observation is nested, has another shape or is not finite.
        """
        numbers = numbers_of(observation)
        mean, deviation = self.gaussian(np.atleast_2d(numbers))
        if not deterministic and self.is_stochastic:
            mean = mean + deviation * self.rng.standard_normal(mean.shape, np.float32)
        actions = SQUASHES[self.squash](mean)
        return (actions if numbers.ndim == 2 else actions[0]), state

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
        return save_arrays(path, KIND, SCHEMA_VERSION, *self.content(), replace=replace)

    @staticmethod
    def load(path: Path) -> ActorPolicy:
        """Read a policy written by `save`.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        return ActorPolicy.checked(path, *load_arrays(path, KIND, SCHEMA_VERSION))

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the policy's file."""
        arrays = {f"weight_{i}": weight for i, weight in enumerate(self.weights)}
        arrays |= {f"bias_{i}": bias for i, bias in enumerate(self.biases)}
        of_view, described = content_of_view(self.view)
        return arrays | of_view, {
            "activation": self.activation,
            "action_size": self.action_size,
            "squash": self.squash,
            "layers": len(self.weights),
            "provenance": dict(self.provenance),
            **(described if self.view else {}),
        }

    @staticmethod
    def checked(
        path: Path, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any], extra: int = 0
    ) -> ActorPolicy:
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
            policy = None if fault else _of_content(arrays, header)
            fault = fault or _fault_of(policy, extra)
        except FAULTS as error:
            raise UserError(
                f"{path} has a header that doesn't fit its arrays: make the file again"
            ) from error
        if fault or policy is None:
            raise UserError(f"{path} {fault}: make the file again")
        return policy


@dataclass(frozen=True)
class ActorDial:
    """Trained dial of continuous actions; `at` returns the policy of one angle.

    Attributes:
        turned: The actor as a policy whose first layer also reads (cos α, sin α), as its last
            inputs. Only `at` uses it.
        low: Smallest trained social angle, in degrees.
        high: Largest trained social angle, in degrees.
    """

    turned: ActorPolicy
    low: float
    high: float

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        view = self.turned.view
        return view.n_features if view else self.turned.n_features - 2

    @property
    def n_actions(self) -> int:
        """Number of discrete actions: none."""
        return 0

    @property
    def action_size(self) -> int:
        """Length of an action."""
        return self.turned.action_size

    @property
    def provenance(self) -> Mapping[str, Any]:
        """JSON-compatible record of how the dial was made."""
        return self.turned.provenance

    def at(self, angle: float) -> ActorPolicy:
        """Return the policy of one angle, an ordinary `ActorPolicy`.

        Args:
            angle: Social angle in degrees.

        Raises:
            UserError: If the angle is outside the trained range.
        """
        check_in_range(angle, self.low, self.high)
        weights, biases = list(self.turned.weights), list(self.turned.biases)
        direction = np.array(exact_weights(angle), weights[0].dtype)
        biases[0] = biases[0] + weights[0][:, -2:] @ direction
        weights[0] = weights[0][:, :-2]
        return replace(
            self.turned,
            weights=tuple(weights),
            biases=tuple(biases),
            provenance={**self.provenance, "angle": angle},
            rng=np.random.default_rng(0),
        )

    def save(self, path: Path, replace: bool = True) -> str:
        """Write the dial to one safetensors file; arguments and errors as `ActorPolicy.save`."""
        arrays, header = self.turned.content()
        header |= {"low": self.low, "high": self.high}
        return save_arrays(path, DIAL_KIND, SCHEMA_VERSION, arrays, header, replace)

    @staticmethod
    def load(path: Path) -> ActorDial:
        """Read a dial written by `save`.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        return ActorDial.checked(path, *load_arrays(path, DIAL_KIND, SCHEMA_VERSION))

    @staticmethod
    def checked(
        path: Path, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
    ) -> ActorDial:
        """Build a dial from a file's content, after a check that its parts agree.

        Raises:
            UserError: If they don't agree.
        """
        turned = ActorPolicy.checked(path, arrays, header, extra=2)
        if turned.n_features < 3:
            raise UserError(f"{path} has no inputs of an angle: make the file again")
        return ActorDial(turned, *range_of(path, header))


def _of_content(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> ActorPolicy:
    layers = range(header["layers"])
    return ActorPolicy(
        tuple(arrays[f"weight_{i}"] for i in layers),
        tuple(arrays[f"bias_{i}"] for i in layers),
        header["activation"],
        header["action_size"],
        header["provenance"],
        sha256=header["sha256"],
        squash=header["squash"],
        view=view_of(arrays, header) if header.get("view") else None,
    )


def _fault_of(policy: Any, extra: int) -> str:
    """Return what is wrong with a policy made of a file's content, or ""."""
    size = policy.action_size
    if type(size) is not int or size < 1:
        return "has layers that don't follow one another"
    known = policy.activation in ACTIVATIONS and policy.squash in SQUASHES
    known = known and isinstance(policy.provenance, dict)
    sized = len(policy.biases[-1]) in (size, 2 * size)
    if not (known and sized and view_is_possible(policy.view)):
        return "has layers that don't follow one another"
    inputs = policy.view.width + extra if policy.view else policy.weights[0].shape[1]
    if chained(policy.weights, policy.biases, inputs):
        return ""
    return "has layers that don't follow one another"
