"""Trained networks as policies in NumPy: greedy, or softmax(Q/τ)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float, Float32

from socialiq.errors import UserError, one_of
from socialiq.nn.saved import Arrays, Header, Saved, SavedNetwork, refusal
from socialiq.nn.unlikeness import PREFIX, RATES, USUAL_RATE, Unlikeness
from socialiq.nn.view import Encoding
from socialiq.types import Memoryless

if TYPE_CHECKING:
    from socialiq.nn.q_network import QNetwork

TRAINABLE = ("relu", "elu")
"""Activations of networks that can be trained."""


class ValuePolicy(Memoryless, Saved):
    """Base class of policies that select actions by their values.

    Attributes:
        temperature: τ of the stochastic policy softmax(Q/τ).
        provenance: JSON-compatible record of how the policy was made.
        rng: Generator of the stochastic policy's draws.
        sha256: SHA-256 of the file's content, for a policy that was loaded.
    """

    temperature: float
    provenance: Mapping[str, Any]
    rng: np.random.Generator
    sha256: str

    @property
    @abstractmethod
    def n_features(self) -> int:
        """Length of an observation."""

    @property
    @abstractmethod
    def n_actions(self) -> int:
        """Number of actions."""

    @abstractmethod
    def q_values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return Q of each observation and action, shape (batch, actions).

        Raises:
            UserError: If an observation has another length or is not finite.
        """

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return softmax(Q/τ), in float64 so that the rows sum to 1."""
        scaled = self.q_values(observations).astype(np.float64) / self.temperature
        powers = np.exp(scaled - scaled.max(axis=1, keepdims=True))
        return powers / powers.sum(axis=1, keepdims=True)

    def choose(self, observation: object, deterministic: bool, /) -> np.ndarray:
        """Return the greedy actions, or ones from softmax(Q/τ).

        Raises:
            UserError: If an observation is nested, has another shape or is not finite.
        """
        numbers = numbers_of(observation)
        batch = numbers if numbers.ndim == 2 else np.atleast_2d(numbers)
        if batch.ndim > 2:
            checked_batch(batch, self.n_features)
        if deterministic:
            actions = self.q_values(batch).argmax(axis=1)
        else:
            cumulative = self.probabilities(batch).cumsum(axis=1)
            draws = self.rng.random((len(batch), 1))
            actions = np.minimum((draws >= cumulative).sum(axis=1), self.n_actions - 1)
        return actions if numbers.ndim == 2 else actions.squeeze(axis=0)


def checked_batch(observations: Any, n_features: int) -> Float32[np.ndarray, "batch feature"]:
    """Return observations as float32.

    Args:
        observations: Observations of any precision, (batch, features).
        n_features: Length of an observation.

    Returns:
        The observations, (batch, features).

    Raises:
        UserError: If an observation has another length than `n_features`, or is not finite.
    """
    batch = np.asarray(observations, np.float32)
    if batch.ndim != 2 or batch.shape[1] != n_features:
        raise UserError(
            f"observation of shape {batch.shape[1:]}: this policy takes ({n_features},)"
        )
    if not np.isfinite(batch).all():
        raise UserError("observation holds NaN or infinity: correct the sensor or the data")
    return batch


def numbers_of(observation: object) -> np.ndarray:
    """Return an observation as float32.

    Raises:
        UserError: If it is nested or not numeric.
    """
    if isinstance(observation, Mapping):
        raise UserError("observation is a dict: this policy takes one array, so flatten it")
    try:
        return np.asarray(observation, np.float32)
    except (TypeError, ValueError) as error:
        raise UserError("observation is not numeric: this policy takes one array") from error


def fields_of_network(network: Any) -> dict[str, Any]:
    """Return a trained network as fields of a `SavedNetwork`; its scale goes into the weights."""
    first, *following = (np.asarray(layer.weight) for layer in network.layers)
    scale = getattr(network, "scale", 1.0)
    first = first if scale == 1.0 else first * np.float32(scale)
    return {
        "weights": (first, *following),
        "biases": tuple(np.asarray(layer.bias) for layer in network.layers),
        "activation": network.activation,
        "view": network.view.in_numpy() if network.view else None,
    }


@dataclass(frozen=True, repr=False)
class QPolicy(SavedNetwork, ValuePolicy):
    """Policy that selects actions from a Q-network: greedy, or from softmax(Q/τ).

    Attributes are those of `SavedNetwork` and `ValuePolicy`, and `unlikeness`, the score of how
    unlike training a state is, if there is one.
    """

    KIND = "policy"
    VERSIONS = 2, 3
    SETTINGS = ("temperature",)
    NO_VIEW: ClassVar = {"view": None}

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str
    temperature: float
    provenance: Mapping[str, Any] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    view: Encoding | None = None
    sha256: str = ""
    unlikeness: Unlikeness | None = None

    @staticmethod
    def of(
        network: Any,
        temperature: float,
        provenance: Mapping[str, Any],
        rng: np.random.Generator | None = None,
    ) -> QPolicy:
        """Build the policy from a trained network; its scale becomes part of the first layer.

        Args:
            network: Trained network, one run: layers, activation, view, and a scale if it has one.
            temperature: τ of the stochastic policy softmax(Q/τ), in units of Q.
            provenance: JSON-compatible record of how the policy was made.
            rng: Generator of the stochastic policy's draws; None is one of seed 0.

        Returns:
            The policy, with NumPy weights and without a score of unlikeness.
        """
        rng = rng or np.random.default_rng(0)
        fields = fields_of_network(network)
        tau = float(temperature)
        return QPolicy(temperature=tau, provenance=provenance, rng=rng, **fields)

    def network(self) -> QNetwork:
        """Return the network, which can be trained: the inverse of `of`.

        Raises:
            UserError: If its activation occurs in imported policies only.
        """
        from socialiq.nn import q_network  # learning needs JAX, acting does not

        one_of("activation of a trainable network", self.activation, TRAINABLE)
        layers, view = q_network.trainable(self)
        return q_network.QNetwork(layers, self.activation, view)

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.weights[-1].shape[0]

    def q_values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return Q of each observation and action, shape (batch, actions)."""
        return self.forward(checked_batch(observations, self.n_features))

    def features(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch output"]:
        """Return the outputs of the last hidden layer, which `unlikeness` reads."""
        batch = checked_batch(observations, self.n_features)
        return self.hidden(self.view(batch) if self.view else batch)

    def alarm(self, rate: float = USUAL_RATE) -> Callable[[np.ndarray], np.ndarray]:
        """Return whether observations are unlike training, at a rate of false alarms.

        Raises:
            UserError: If the policy has no score, or none for the rate.
        """
        if (score := self.unlikeness) is None:
            raise UserError("no score of unlikeness: add one by `socialiq unlikeness`")
        if not RATES[0] <= rate <= RATES[-1]:
            raise UserError(f"a rate of false alarms is from {RATES[0]:g} to {RATES[-1]:g}")
        threshold = np.interp(rate, RATES, score.thresholds)
        return lambda rows: score(self.features(rows)) > threshold

    @property
    def version(self) -> int:
        """Schema version that is written: 3 with a score of unlikeness."""
        return 2 if self.unlikeness is None else 3

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the policy's file."""
        arrays, header = super().content()
        score = vars(self.unlikeness) if self.unlikeness else {}
        return arrays | {PREFIX + name: array for name, array in score.items()}, header

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header, extra: int = 0) -> QPolicy:
        """Build the policy as `SavedNetwork.checked`, with its score of unlikeness if any.

        Args:
            path: The file, which errors name.
            arrays: Named arrays of the file.
            header: Header of the file.
            extra: Number of the first layer's inputs that are not part of the observation.

        Returns:
            The policy.

        Raises:
            UserError: If arrays and header don't agree.
        """
        policy = super().checked(path, arrays, header, extra)
        if not any(name.startswith(PREFIX) for name in arrays):
            return policy
        score = Unlikeness.of_arrays(arrays, policy.weights[-1].shape[1])
        if score is None:
            raise refusal(path, "has a score of unlikeness that doesn't fit its layers")
        return replace(policy, unlikeness=score)

    def has_sound_settings(self) -> bool:
        """Whether the temperature is a positive, finite float."""
        return isinstance(self.temperature, float) and 0.0 < self.temperature < float("inf")
