"""Trained dial (angle-conditioned Q-network): a policy for every social angle of its range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights
from socialiq.storage import load_arrays, save_arrays

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class DialPolicy:
    """Trained dial of `learners.dial`; `at` returns the policy of one angle.

    Attributes:
        turned: The network as a policy whose first layer also reads the direction, as its last two
            inputs. Only `at` uses it.
        low: Smallest trained social angle, in degrees.
        high: Largest trained social angle, in degrees.
    """

    turned: QPolicy
    low: float
    high: float

    @staticmethod
    def of(
        network: DialNetwork,
        temperature: float,
        low: float,
        high: float,
        provenance: Mapping[str, Any],
    ) -> DialPolicy:
        """Build the policy from a trained network."""
        turned = QNetwork(network.layers, network.activation, network.view)
        return DialPolicy(QPolicy.of(turned, temperature, provenance), low, high)

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        view = self.turned.view
        return view.n_features if view else self.turned.weights[0].shape[1] - 2

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.turned.n_actions

    @property
    def provenance(self) -> Mapping[str, Any]:
        """JSON-compatible record of how the dial was made."""
        return self.turned.provenance

    def at(self, angle: float) -> QPolicy:
        """Return the policy of one angle, an ordinary `QPolicy`.

        Args:
            angle: Social angle in degrees.

        Raises:
            UserError: If the angle is outside the trained range.
        """
        if not self.low <= angle <= self.high:
            raise UserError(
                f"angle {angle:g} is outside this dial's range: "
                f"choose one in [{self.low:g}, {self.high:g}] degrees"
            )
        weight, bias = self.turned.weights[0], self.turned.biases[0]
        direction = np.array(exact_weights(angle), weight.dtype)
        return replace(
            self.turned,
            weights=(weight[:, :-2], *self.turned.weights[1:]),
            biases=(bias + weight[:, -2:] @ direction, *self.turned.biases[1:]),
            provenance={**self.provenance, "angle": angle},
            rng=np.random.default_rng(0),
        )

    def save(self, path: Path) -> str:
        """Write the dial to one safetensors file.

        Returns:
            SHA-256 of the content.

        Raises:
            UserError: If the file can't be written.
        """
        arrays, header = self.turned.content()
        header |= {"low": self.low, "high": self.high}
        return save_arrays(path, "dial", SCHEMA_VERSION, arrays, header)

    @staticmethod
    def load(path: Path) -> DialPolicy:
        """Read a dial written by `save`.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        arrays, header = load_arrays(path, "dial", SCHEMA_VERSION)
        low, high = range_of(path, header)
        return DialPolicy(QPolicy.checked(path, arrays, header, extra=2), low, high)


def range_of(path: Path, header: Mapping[str, Any]) -> tuple[float, float]:
    """Return the lowest and the highest angle in a dial's header.

    Raises:
        UserError: If they are missing, or are no range.
    """
    low, high = header.get("low"), header.get("high")
    if isinstance(low, float) and isinstance(high, float) and 0.0 <= low <= high < 360.0:
        return low, high
    raise UserError(f"{path} has no range of angles: make the file again")
