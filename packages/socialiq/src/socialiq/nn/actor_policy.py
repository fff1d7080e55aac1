"""Trained actor as a policy of continuous actions, and its dial: NumPy only, safetensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32

from socialiq.nn.dial_policy import Dial
from socialiq.nn.q_policy import checked_batch, fields_of_network, numbers_of
from socialiq.nn.saved import LOG_STD, SavedNetwork
from socialiq.nn.view import Encoding
from socialiq.types import Memoryless

if TYPE_CHECKING:
    from socialiq.nn.actor import Actor

SQUASHES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh": np.tanh,
    "clip": lambda u: np.clip(u, -1.0, 1.0),  # of imported policies
}
"""Functions from u to the action."""


@dataclass(frozen=True, repr=False)
class ActorPolicy(Memoryless, SavedNetwork):
    """Policy of continuous actions tanh(u) in [-1, 1].

    The ends -1 and 1 are the bounds of the world's own actions. If the policy is deterministic, u
    is the mean. Else it is drawn from N(mean, std²), if the network has deviations.

    Attributes:
        action_size: Length of an action; the last layer has as many means, and as many
            log-deviations or none.
        rng: Generator of the stochastic policy's draws.
        squash: One of `SQUASHES`; "tanh", except in some imported policies.
    """

    KIND = "actor"
    SETTINGS = "action_size", "squash"

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
        """Build the policy from a trained actor; its scale becomes part of the first layer.

        Args:
            actor: The trained actor.
            provenance: JSON-compatible record of how the policy was made.
            rng: Generator of the stochastic policy's draws; None is one of seed 0.

        Returns:
            The policy, with NumPy weights.
        """
        rng = rng or np.random.default_rng(0)
        fields = fields_of_network(actor)
        return ActorPolicy(action_size=actor.size, provenance=provenance, rng=rng, **fields)

    def network(self) -> Actor:
        """Return the actor, which can be trained: the inverse of `of`."""
        from socialiq.nn import actor, q_network  # learning needs JAX, acting does not

        layers, view = q_network.trainable(self)
        return actor.Actor(layers, self.activation, self.action_size, view=view)

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
        value = self.forward(checked_batch(observations, self.n_features))
        mean = value[:, : self.action_size]
        if not self.is_stochastic:
            return mean, np.zeros_like(mean)
        return mean, np.exp(np.clip(value[:, self.action_size :], *LOG_STD))

    def choose(self, observation: object, deterministic: bool, /) -> np.ndarray:
        """Return actions in [-1, 1], float32 (size,) or (batch, size), of the mean or a drawn u.

        Raises:
            UserError: If an observation is nested, has another shape or is not finite.
        """
        numbers = numbers_of(observation)
        mean, deviation = self.gaussian(np.atleast_2d(numbers))
        if not deterministic and self.is_stochastic:
            mean = mean + deviation * self.rng.standard_normal(mean.shape, np.float32)
        actions = SQUASHES[self.squash](mean)
        return actions if numbers.ndim == 2 else actions[0]

    def has_sound_settings(self) -> bool:
        """Whether there are such actions, with a mean and no or a deviation for each number."""
        size = self.action_size
        possible = type(size) is int and size > 0 and self.squash in SQUASHES
        return possible and len(self.biases[-1]) in (size, 2 * size)


@dataclass(frozen=True, repr=False)
class ActorDial(Dial[ActorPolicy]):
    """Trained dial of continuous actions; its attributes are those of `Dial`."""

    KIND = "actor-dial"
    NETWORK = ActorPolicy

    @property
    def n_actions(self) -> int:
        """Number of discrete actions: none."""
        return 0

    @property
    def action_size(self) -> int:
        """Length of an action."""
        return self.turned.action_size
