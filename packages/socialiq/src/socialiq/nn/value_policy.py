"""Policies that select actions by their values: greedily, or from softmax(Q/τ)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from scipy.special import softmax

from socialiq.errors import UserError


class ValuePolicy(ABC):
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

    @abstractmethod
    def save(self, path: Path, replace: bool = True) -> str:
        """Write the policy to one safetensors file; return the SHA-256 of its content."""

    def checked_batch(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float32[np.ndarray, "batch feature"]:
        """Return observations as float32.

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        return checked_batch(observations, self.n_features)

    def check_shape(self, batch: np.ndarray) -> None:
        """Raise an error for observations of another length."""
        check_shape(batch, self.n_features)

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return softmax(Q/τ), in float64 so that the rows sum to 1."""
        return softmax(self.q_values(observations).astype(np.float64) / self.temperature, axis=1)

    def predict(
        self,
        observation: object,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions, greedily or from softmax(Q/τ).

        Args:
            observation: Shape (features,) or (batch, features).
            state: Returned unchanged; the policy has no memory.
            episode_start: Ignored, for the same reason.
            deterministic: Whether to select greedily; else sample from softmax(Q/τ).

        Raises:
            UserError: If an observation is nested, has another shape or is not finite.
        """
        numbers = numbers_of(observation)
        batch = np.atleast_2d(numbers)
        self.check_shape(batch)
        if deterministic:
            actions = self.q_values(batch).argmax(axis=1)
        else:
            cumulative = self.probabilities(batch).cumsum(axis=1)
            draws = self.rng.random((len(batch), 1))
            actions = np.minimum((draws >= cumulative).sum(axis=1), self.n_actions - 1)
        return (actions if numbers.ndim == 2 else actions.squeeze(axis=0)), state


def checked_batch(
    observations: Float[np.ndarray, "batch feature"], n_features: int
) -> Float32[np.ndarray, "batch feature"]:
    """Return observations as float32.

    Args:
        observations: Of any precision.
        n_features: Length that the policy takes.

    Raises:
        UserError: If an observation has another length or is not finite.
    """
    batch = np.asarray(observations, np.float32)
    check_shape(batch, n_features)
    if not np.isfinite(batch).all():
        raise UserError("observation holds NaN or infinity: correct the sensor or the data")
    return batch


def check_shape(batch: np.ndarray, n_features: int) -> None:
    """Raise an error for observations of another length than a policy takes."""
    if batch.ndim != 2 or batch.shape[1] != n_features:
        raise UserError(
            f"observation of shape {batch.shape[1:]}: this policy takes ({n_features},)"
        )


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
