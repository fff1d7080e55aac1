"""Trained dial of two angles: the social angle, and the class angle of r_social."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from socialiq.nn.dial_policy import DialPolicy, range_of
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.saved import Arrays, Header, Saved, refusal
from socialiq.social.angle import class_weights

if TYPE_CHECKING:
    from socialiq.nn.dial_network import DialNetwork


@dataclass(frozen=True, repr=False)
class ClassDial(Saved):
    """One network for every social angle of a range and every class angle from 0 to 90 degrees.

    Attributes:
        turned: The network as a policy whose last inputs are (cos a, sin a cos b, sin a sin b).
            Its outputs are Q of all actions, or with pairs those of each of three rewards.
        low: Smallest trained social angle, in degrees.
        high: Largest trained social angle, in degrees.
        pairs: Whether the outputs are by reward: r_env, vehicles, road users who can be hurt.
    """

    KIND = "class-dial"

    turned: QPolicy
    low: float
    high: float
    pairs: bool = False

    @staticmethod
    def of(
        network: DialNetwork,
        temperature: float,
        low: float,
        high: float,
        provenance: Mapping[str, Any],
    ) -> ClassDial:
        """Build the dial from a trained network.

        Args:
            network: Network of both angles, one run.
            temperature: τ of the stochastic policy softmax(Q/τ), in units of reward.
            low: Smallest trained social angle, in degrees.
            high: Largest trained social angle, in degrees.
            provenance: JSON-compatible record of how the dial was made.

        Returns:
            The dial, with NumPy weights.
        """
        return ClassDial(QPolicy.of(network, temperature, provenance), low, high, network.pairs)

    def network(self) -> DialNetwork:
        """Return the network, which can be trained: the inverse of `of`, without settings."""
        from socialiq.nn.dial_network import DialNetwork  # learning needs JAX, acting does not

        turned = self.turned.network()
        return DialNetwork(turned.layers, turned.activation, turned.view, self.pairs)

    def of_class(self, class_angle: float) -> DialPolicy:
        """Return the dial of one class angle b in degrees, an ordinary dial of the social angle.

        Its input of sin a, and with pairs its outputs of r_social, are those of both classes
        weighed by (cos b, sin b).

        Raises:
            UserError: If the class angle is not in [0, 90].
        """
        classes = np.array(class_weights(class_angle), self.turned.weights[0].dtype)
        first, *weights = self.turned.weights
        biases = list(self.turned.biases)
        of_social = (first[:, -2:] @ classes)[:, None]
        weights = [np.concatenate([first[:, :-2], of_social], axis=1), *weights]
        if self.pairs:
            for last in (weights, biases):
                env, *social = np.split(last[-1], 3)
                last[-1] = np.concatenate([env, np.tensordot(classes, social, 1)])
        provenance = {**self.turned.provenance, "class_angle": class_angle}
        layers = {"weights": tuple(weights), "biases": tuple(biases)}
        turned = replace(self.turned, **layers, provenance=provenance)
        return DialPolicy(turned, self.low, self.high, self.pairs)

    @property
    def provenance(self) -> Mapping[str, Any]:
        """JSON-compatible record of how the dial was made."""
        return self.turned.provenance

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.of_class(0.0).n_features

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.of_class(0.0).n_actions

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the dial's file."""
        arrays, header = self.turned.content()
        return arrays, header | {"low": self.low, "high": self.high, "pairs": self.pairs}

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> ClassDial:
        """Build a dial from a file's content, as `Saved.checked`.

        Args:
            path: The file, which errors name.
            arrays: Named arrays of the file.
            header: Header of the file.

        Returns:
            The dial.

        Raises:
            UserError: If arrays and header don't agree.
        """
        turned = QPolicy.checked(path, arrays, header, extra=3)
        pairs = header.get("pairs")
        if type(pairs) is not bool or (pairs and turned.n_actions % 3):
            raise refusal(path, "has no values of three rewards for each action")
        return cls(turned, *range_of(path, header), pairs)
