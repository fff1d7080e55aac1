"""Trained dial (angle-conditioned network): a policy for every social angle of its range."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.nn.q_policy import QPolicy, checked_batch
from socialiq.nn.saved import Arrays, Header, Saved, SavedNetwork, refusal
from socialiq.nn.view import angle_columns, hats
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair

if TYPE_CHECKING:
    from socialiq.nn.dial_network import DialNetwork

Settings = tuple[tuple[float, float], ...]
"""Rows (first angle asked for, angle of the network), both in degrees, the first one rising."""

Network = TypeVar("Network", bound=SavedNetwork)


@dataclass(frozen=True, repr=False)
class Dial(Saved, Generic[Network]):
    """Base class of dials, one network for all social angles of a range.

    Attributes:
        turned: The network as a policy whose first layer also reads the angle, as its last inputs.
        low: Smallest trained social angle, in degrees.
        high: Largest trained social angle, in degrees.
    """

    NETWORK: ClassVar[type[Any]]

    turned: Network
    low: float
    high: float

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        view = self.turned.view
        return view.n_features if view else self.turned.n_features - len(self.angle_inputs(0.0))

    @property
    def provenance(self) -> Mapping[str, Any]:
        """JSON-compatible record of how the dial was made."""
        return self.turned.provenance

    def angle_inputs(self, angle: float) -> np.ndarray:
        """Return the first layer's inputs of an angle in degrees, (cos α, sin α) first."""
        return np.array(exact_weights(angle), self.turned.weights[0].dtype)

    def at(self, angle: float) -> Network:
        """Return the policy of one angle in degrees, an ordinary policy.

        Raises:
            UserError: If the angle is outside the trained range.
        """
        check_in_range(angle, self.low, self.high)
        return self._fixed(angle, {"angle": angle})

    def _fixed(self, angle: float, recorded: Mapping[str, Any]) -> Network:
        """Return the network with the inputs of an angle as a part of its first bias."""
        first, *weights = self.turned.weights
        bias, *biases = self.turned.biases
        turned: Any = self.turned
        inputs = self.angle_inputs(angle)
        biases = (bias + first[:, -len(inputs) :] @ inputs, *biases)
        return replace(
            turned,
            weights=(first[:, : -len(inputs)], *weights),
            biases=biases,
            provenance={**self.provenance, **recorded},
            rng=np.random.default_rng(0),
        )

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the dial's file."""
        arrays, header = self.turned.content()
        return arrays, header | {"low": self.low, "high": self.high}

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> Any:
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
        turned = cls.NETWORK.checked(path, arrays, header, extra=2)
        return cls(turned, *range_of(path, header))


@dataclass(frozen=True, repr=False)
class DialPolicy(Dial[QPolicy]):
    """Trained dial of `learners.dial`; its attributes are those of `Dial`, and those below.

    Attributes:
        pairs: Whether the last layer gives Q_env of all actions, then Q_social of all actions.
        settings: The network's angle for the angles asked for (`evaluation.dial.calibrated`), each
            row from its first angle to that of the next; none for the angle itself.
        knots: Centres of the hat functions of the angle, in degrees; none for the direction alone.
    """

    # A reader of version 1 would take pairs for twice as many actions, leave the settings out, and
    # take the hats of an angle for features.
    KIND = "dial"
    VERSIONS = 1, 2
    NETWORK = QPolicy

    pairs: bool = False
    settings: Settings = ()
    knots: tuple[float, ...] = ()

    def with_times(self, times: int) -> DialPolicy:
        """Return the dial for a clock of `times` values, a multiple of the number that it reads.

        Value t acts as t modulo the present number. A clock may then carry more than the time, as
        with `perception.FrontEnd.exit`.

        Raises:
            UserError: If the dial does not observe the time, or `times` is no multiple of the
                present number of values.
        """
        view: Any = self.turned.view
        own = getattr(view, "times", 0)
        if not own or times % own:
            raise UserError(f"this dial reads {own} values of the time: give one with a clock")
        first, *weights = self.turned.weights
        first = np.concatenate([first[:, :own]] * (times // own) + [first[:, own:]], axis=1)
        turned = replace(self.turned, weights=(first, *weights), view=replace(view, times=times))
        return replace(self, turned=turned)

    @staticmethod
    def of(
        network: DialNetwork,
        temperature: float,
        low: float,
        high: float,
        provenance: Mapping[str, Any],
    ) -> DialPolicy:
        """Build the policy from a trained network.

        Args:
            network: Trained network, one run.
            temperature: τ of the stochastic policy softmax(Q/τ), in units of reward.
            low: Smallest trained social angle, in degrees.
            high: Largest trained social angle, in degrees.
            provenance: JSON-compatible record of how the dial was made.

        Returns:
            The dial, with NumPy weights and without settings.
        """
        turned = QPolicy.of(network, temperature, provenance)
        return DialPolicy(turned, low, high, network.pairs, knots=network.knots)

    def network(self) -> DialNetwork:
        """Return the network, which can be trained: the inverse of `of`, without settings."""
        from socialiq.nn.dial_network import DialNetwork  # learning needs JAX, acting does not

        turned = self.turned.network()
        return DialNetwork(turned.layers, turned.activation, turned.view, self.pairs, self.knots)

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.turned.n_actions // 2 if self.pairs else self.turned.n_actions

    @property
    def version(self) -> int:
        """Schema version that is written: the first that has what the dial has."""
        return 2 if self.pairs or self.settings or self.knots else 1

    def angle_inputs(self, angle: float) -> np.ndarray:
        """Return the first layer's inputs of an angle in degrees: the direction, then the hats."""
        direction = super().angle_inputs(angle)
        if not self.knots:
            return direction
        return np.append(direction, hats(np.array(angle), self.knots)).astype(direction.dtype)

    def at(self, angle: float) -> QPolicy:
        """Return the policy of one angle in degrees; with pairs its Q is the score of both values.

        Raises:
            UserError: If the angle is outside the trained range.
        """
        check_in_range(angle, self.low, self.high)
        setting = self.setting(angle)
        recorded = {"setting": setting} if self.settings else {}
        policy = self._fixed(setting, {"angle": angle, **recorded})
        if not self.pairs:
            return policy
        direction = super().angle_inputs(setting)
        weight, bias = (  # of the score: that of two affine functions is one
            np.tensordot(direction, array.reshape(2, self.n_actions, *array.shape[1:]), 1)
            for array in (policy.weights[-1], policy.biases[-1])
        )
        weights = *policy.weights[:-1], weight
        biases = *policy.biases[:-1], bias
        return replace(policy, weights=weights, biases=biases)

    def q_values_at(
        self,
        observations: Float[np.ndarray, "batch feature"],
        angles: Float[np.ndarray, " batch"],
    ) -> Float[np.ndarray, "batch action"]:
        """Return Q of each observation at its angle: up to rounding the values of `at`.

        Args:
            observations: Observations, (batch, feature).
            angles: Angle of each observation, in degrees.

        Returns:
            Q, (batch, action); with pairs the scores of both values.

        Raises:
            UserError: If an observation has another length or is not finite, or an angle is outside
                the trained range.
        """
        for end in (angles.min(), angles.max()) if len(angles) else ():
            check_in_range(float(end), self.low, self.high)
        value = checked_batch(observations, self.n_features)
        value = self.turned.view(value) if self.turned.view else value
        settings = np.array([self.setting(angle) for angle in angles.tolist()], np.float64)
        radians = np.deg2rad(settings)
        direction = RewardPair(np.cos(radians), np.sin(radians))
        columns = np.concatenate(angle_columns(direction, self.knots), axis=1)
        inputs = np.concatenate([value, columns.astype(value.dtype)], axis=1)
        outputs = self.turned.layers(inputs)
        if not self.pairs:
            return outputs
        env, social = np.split(outputs, 2, axis=1)
        return np.asarray(direction.env[:, None] * env + direction.social[:, None] * social)

    def setting(self, angle: float) -> float:
        """Return the network's angle for an angle that is asked for, in degrees."""
        setting = angle
        for first, network in self.settings:
            setting = network if angle >= first else setting
        return setting

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the dial's file."""
        arrays, header = super().content()
        if self.version > 1:
            header |= {"pairs": self.pairs, "settings": [list(row) for row in self.settings]}
        if self.knots:
            header |= {"knots": list(self.knots)}
        return arrays, header

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> DialPolicy:
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
        knots = header.get("knots", [])
        numbers = isinstance(knots, list) and all(
            type(knot) is float and abs(knot) <= 720.0 for knot in knots
        )
        gaps = np.diff(knots) if numbers else np.zeros(0)
        even = len(gaps) and 0.0 < gaps.sum() <= 360.0 and np.ptp(gaps) < 1e-6 * gaps.sum()
        if knots != [] and not even:
            raise refusal(path, "has no angles of its hat functions")
        turned = QPolicy.checked(path, arrays, header, extra=2 + len(knots))
        low, high = range_of(path, header)
        pairs = header.get("pairs", False)
        if type(pairs) is not bool or (pairs and turned.n_actions % 2):
            raise refusal(path, "has no pair of values for each action")
        try:
            rows = tuple((first, network) for first, network in header.get("settings", []))
        except (TypeError, ValueError):
            rows = ((np.nan, np.nan),)
        inside = all(type(angle) is float and low <= angle <= high for row in rows for angle in row)
        if not (inside and all(row[0] < later[0] for row, later in itertools.pairwise(rows))):
            raise refusal(path, "has no settings of angles")
        return cls(turned, low, high, pairs, rows, tuple(knots))


def knots_between(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return angles at equal distances.

    Args:
        low: First angle, in degrees.
        high: Last angle, in degrees.
        count: Number of angles.

    Returns:
        The angles in degrees; none for a count of 0.
    """
    return tuple(np.linspace(low, high, count).tolist())


def check_in_range(angle: float, low: float, high: float) -> None:
    """Raise an error for an angle outside a dial's range.

    Args:
        angle: Social angle, in degrees.
        low: Smallest trained angle, in degrees.
        high: Largest trained angle, in degrees.

    Raises:
        UserError: If the angle is below `low` or above `high`.
    """
    if not low <= angle <= high:
        raise UserError(
            f"angle {angle:g} is outside this dial's range: "
            f"choose one in [{low:g}, {high:g}] degrees"
        )


def range_of(path: Path, header: Header) -> tuple[float, float]:
    """Return the lowest and the highest angle in a dial's header.

    Args:
        path: The file, which errors name.
        header: Header of the file.

    Returns:
        The two angles, in degrees.

    Raises:
        UserError: If the header has no two floats with 0 <= low <= high < 360.
    """
    low = header.get("low")
    high = header.get("high")
    if isinstance(low, float) and isinstance(high, float) and 0.0 <= low <= high < 360.0:
        return low, high
    raise refusal(path, "has no range of angles")
