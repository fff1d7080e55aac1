"""Trained dial (angle-conditioned Q-network): a policy for every social angle of its range."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.nn import perceptron
from socialiq.nn.dial_network import DialNetwork, angle_columns, hats
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.value_policy import checked_batch
from socialiq.social.angle import exact_weights
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import RewardPair

SCHEMA_VERSION = 1
SECOND_VERSION = 2
"""Schema version of dials with pairs, settings or knots: a reader of version 1 would take pairs for
twice as many actions, leave the settings out, and take the hats of an angle for features."""

VERSIONS = (SCHEMA_VERSION, SECOND_VERSION)
"""Schema versions that are read."""

Settings = tuple[tuple[float, float], ...]
"""Rows (first angle asked for, angle of the network), both in degrees, the first one rising."""


@dataclass(frozen=True)
class DialPolicy:
    """Trained dial of `learners.dial`; `at` returns the policy of one angle.

    Attributes:
        turned: The network as a policy whose first layer also reads the angle, as its last inputs:
            the direction, then the hat functions around the knots. Only `at` uses it.
        low: Smallest trained social angle, in degrees.
        high: Largest trained social angle, in degrees.
        pairs: Whether the last layer gives Q_env of all actions, then Q_social of all actions.
        settings: The network's angle for the angles asked for (`evaluation.dial.calibrated`), each
            row from its first angle to that of the next; none for the angle itself.
        knots: Centres of the hat functions of the angle, in degrees; none for the direction alone.
    """

    turned: QPolicy
    low: float
    high: float
    pairs: bool = False
    settings: Settings = ()
    knots: tuple[float, ...] = ()

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
        policy = QPolicy.of(turned, temperature, provenance)
        return DialPolicy(policy, low, high, network.pairs, knots=network.knots)

    def network(self) -> DialNetwork:
        """Return the network, which can be trained: the inverse of `of`, without settings."""
        turned = self.turned.network()
        return DialNetwork(turned.layers, turned.activation, turned.view, self.pairs, self.knots)

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        view = self.turned.view
        inputs = self.turned.weights[0].shape[1] - 2 - len(self.knots)
        return view.n_features if view else inputs

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.turned.n_actions // 2 if self.pairs else self.turned.n_actions

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
        check_in_range(angle, self.low, self.high)
        setting = self.setting(angle)
        weights, biases = list(self.turned.weights), list(self.turned.biases)
        weight = weights[0]
        direction = np.array(exact_weights(setting), weight.dtype)
        inputs = np.append(direction, hats(np.array(setting), self.knots) if self.knots else [])
        of_angle = weight[:, -len(inputs) :] @ inputs.astype(weight.dtype)
        weights[0], biases[0] = weight[:, : -len(inputs)], biases[0] + of_angle
        if self.pairs:
            weights[-1], biases[-1] = (
                np.tensordot(direction, part.reshape(2, self.n_actions, *part.shape[1:]), 1)
                for part in (weights[-1], biases[-1])
            )
        set_to = {"setting": setting} if self.settings else {}
        return replace(
            self.turned,
            weights=tuple(weights),
            biases=tuple(biases),
            provenance={**self.provenance, "angle": angle, **set_to},
            rng=np.random.default_rng(0),
        )

    def q_values_at(
        self,
        observations: Float[np.ndarray, "batch feature"],
        angles: Float[np.ndarray, " batch"],
    ) -> Float[np.ndarray, "batch action"]:
        """Return Q of each observation and action, each observation at an angle of its own.

        Up to rounding the values of `at` of each row's angle.

        Args:
            observations: The observations.
            angles: Social angle of each, in degrees.

        Raises:
            UserError: If an observation has another length or is not finite, or an angle is
                outside the trained range.
        """
        for end in (angles.min(), angles.max()) if len(angles) else ():
            check_in_range(float(end), self.low, self.high)
        value = checked_batch(observations, self.n_features)
        value = self.turned.view(value) if self.turned.view else value
        settings = np.array([self.setting(one) for one in angles.tolist()], np.float64)
        radians = np.deg2rad(settings)
        direction = RewardPair(np.cos(radians), np.sin(radians))
        columns = np.concatenate(angle_columns(direction, self.knots), axis=1)
        inputs = np.concatenate([value, columns.astype(value.dtype)], axis=1)
        turned = self.turned
        found = perceptron.perceptron(turned.weights, turned.biases, turned.activation, inputs)
        if not self.pairs:
            return found
        env, social = np.split(found, 2, axis=1)
        return np.asarray(direction.env[:, None] * env + direction.social[:, None] * social)

    def setting(self, angle: float) -> float:
        """Return the network's angle for an angle that is asked for, in degrees."""
        own = angle
        for first, network in self.settings:
            own = network if angle >= first else own
        return own

    def save(self, path: Path, replace: bool = True) -> str:
        """Write the dial to one safetensors file.

        Args:
            path: The file; its folder must exist.
            replace: Whether a file there is replaced.

        Returns:
            SHA-256 of the content.

        Raises:
            UserError: If the file can't be written.
        """
        plain = not (self.pairs or self.settings or self.knots)
        version = SCHEMA_VERSION if plain else SECOND_VERSION
        return save_arrays(path, "dial", version, *self.content(), replace)

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the dial's file."""
        arrays, header = self.turned.content()
        header |= {"low": self.low, "high": self.high}
        if self.pairs or self.settings or self.knots:
            header |= {"pairs": self.pairs, "settings": [list(row) for row in self.settings]}
        if self.knots:
            header |= {"knots": list(self.knots)}
        return arrays, header

    @staticmethod
    def load(path: Path) -> DialPolicy:
        """Read a dial written by `save`.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        return DialPolicy.checked(path, *load_arrays(path, "dial", VERSIONS))

    @staticmethod
    def checked(
        path: Path, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
    ) -> DialPolicy:
        """Build a dial from a file's content, after a check that its parts agree.

        Raises:
            UserError: If they don't agree.
        """
        knots = _knots_of(path, header)
        turned = QPolicy.checked(path, arrays, header, extra=2 + len(knots))
        low, high = range_of(path, header)
        pairs = header.get("pairs", False)
        if type(pairs) is not bool or (pairs and turned.n_actions % 2):
            raise UserError(f"{path} has no pair of values for each action: make the file again")
        return DialPolicy(turned, low, high, pairs, _settings_of(path, header, low, high), knots)


def check_in_range(angle: float, low: float, high: float) -> None:
    """Raise an error for an angle outside a dial's range, all in degrees."""
    if not low <= angle <= high:
        raise UserError(
            f"angle {angle:g} is outside this dial's range: "
            f"choose one in [{low:g}, {high:g}] degrees"
        )


def range_of(path: Path, header: Mapping[str, Any]) -> tuple[float, float]:
    """Return the lowest and the highest angle in a dial's header.

    Raises:
        UserError: If they are missing, or are no range.
    """
    low, high = header.get("low"), header.get("high")
    if isinstance(low, float) and isinstance(high, float) and 0.0 <= low <= high < 360.0:
        return low, high
    raise UserError(f"{path} has no range of angles: make the file again")


def _knots_of(path: Path, header: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the knots in a dial's header, none if it has none.

    Raises:
        UserError: If they are not at equal, positive distances within a turn.
    """
    knots = header.get("knots", [])
    numbers = isinstance(knots, list) and all(
        type(one) is float and abs(one) <= 720.0 for one in knots
    )
    if knots == [] or (numbers and len(knots) > 1):
        gaps = np.diff(knots)
        if not knots or (0.0 < gaps.sum() <= 360.0 and np.ptp(gaps) < 1e-6 * gaps.sum()):
            return tuple(knots)
    raise UserError(f"{path} has no angles of its hat functions: make the file again")


def _settings_of(path: Path, header: Mapping[str, Any], low: float, high: float) -> Settings:
    """Return the settings in a dial's header, all within its range.

    Raises:
        UserError: If they are none.
    """
    rows = header.get("settings", [])
    try:
        found = tuple((first, network) for first, network in rows)
    except (TypeError, ValueError):
        found = ((np.nan, np.nan),)
    known = all(type(one) is float and low <= one <= high for row in found for one in row)
    if known and all(one[0] < other[0] for one, other in itertools.pairwise(found)):
        return found
    raise UserError(f"{path} has no settings of angles: make the file again")
