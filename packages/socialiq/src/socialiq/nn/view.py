"""Encodings of an observation for a perceptron: vehicles as a list or a set, integers one-hot.

The observation `rows-1` is rows of seven numbers (presence, x, y, vx, vy, cos h, sin h), the ego's
first, and with a clock the time at the end. The observation `route-1` has numbers of the ego, then
rows of further road users that are relative to it already (`worlds.highway.observation`).

A perceptron over the flat list has to learn each vehicle's effect once for each row that it may
occupy, and distances from pairs of absolute positions. In a gridworld an input for each value makes
rules that hold in one cell easy to fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32, Shaped

from socialiq.errors import UserError
from socialiq.physics import wrapped
from socialiq.types import RewardPair


@dataclass(frozen=True)
class OneHot:
    """Encoder from integer features to zeros and ones, for JAX and NumPy arrays.

    Each feature has a smallest and a number of values; one outside is encoded as all zeros.
    """

    lows: tuple[int, ...]
    sizes: tuple[int, ...]

    @staticmethod
    def of(values: tuple[tuple[int, int], ...]) -> OneHot:
        """Build the encoder from (smallest value, number of values) of each feature, at least one.

        Raises:
            UserError: If there is no feature, or one without values.
        """
        if not values or any(size < 1 for _, size in values):
            raise UserError("one_hot needs (smallest value, number of values) for each feature")
        lows, sizes = zip(*values, strict=True)
        return OneHot(tuple(map(int, lows)), tuple(map(int, sizes)))

    def in_numpy(self) -> OneHot:
        """Return the encoder itself: it has no weights."""
        return self

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return len(self.sizes)

    @property
    def width(self) -> int:
        """Number of inputs of the perceptron."""
        return sum(self.sizes)

    def __call__(self, observation: Shaped[Any, "*batch feature"]) -> Shaped[Any, "*batch width"]:
        """Encode observations along the last axis."""
        xp = observation.__array_namespace__()
        equal = [
            observation[..., number, None] == np.arange(low, low + size, dtype=np.float32)
            for number, (low, size) in enumerate(zip(self.lows, self.sizes, strict=True))
        ]
        return xp.concatenate(equal, axis=-1).astype(np.float32)


ROW = 7
"""Numbers of a vehicle."""

ROWS = (ROW, ROW)
ROUTE = (38, 53)
"""Numbers of the ego, and of each further road user, in the schemas of observations."""


class Choice(NamedTuple):
    """Properties of a view.

    Attributes:
        pooled: Encode every other vehicle by the same layers, and keep sum and maximum over them,
            so that their order doesn't matter; else the rows are concatenated.
        relative: Add each vehicle's position, velocity and heading relative to the ego.
        scale: Factor on positions and velocities: 5 maps 20 m and 4 m/s to 1.
        ahead: Add how close each vehicle comes to the ego in the next seconds (`closeness`).
        layout: Numbers of the ego and of each further road user; `relative`, `scale` and `ahead`
            are of `ROWS` alone.
    """

    pooled: bool
    relative: bool
    scale: float
    ahead: bool = False
    layout: tuple[int, int] = ROWS

    @property
    def is_of_rows(self) -> bool:
        """Whether the observation is rows of vehicles, the ego's first."""
        return self.layout == ROWS

    def fitting(self, listed: int) -> Choice | None:
        """Return the same choice in the layout of an observation; None if it has none.

        Args:
            listed: Length of the observation without the time.
        """
        for layout in (ROWS, ROUTE):
            ego, user = layout
            if listed > ego and (listed - ego) % user == 0:
                return self._replace(layout=layout)
        return None

    def described(self) -> dict[str, Any]:
        """Return the properties as a file has them: `ahead` and `layout` only where they differ."""
        properties = self._asdict()
        if not self.ahead:
            del properties["ahead"]
        if self.is_of_rows:
            del properties["layout"]
        return properties

    @staticmethod
    def of_described(described: Mapping[str, Any]) -> Choice:
        """Return the properties of `described`."""
        pooled, relative, scale = (described[name] for name in Choice._fields[:3])
        layout = tuple(described.get("layout", ROWS))
        return Choice(pooled, relative, scale, described.get("ahead", False), layout)


CHOICES: dict[str, Choice | None] = {
    "flat": None,
    "flat_scaled": Choice(False, False, 5.0),
    "flat_relative": Choice(False, True, 1.0),
    "flat_relative_scaled": Choice(False, True, 5.0),
    "set_absolute": Choice(True, False, 1.0),
    "set_scaled": Choice(True, False, 5.0),
    "set_relative": Choice(True, True, 1.0),
    "set": Choice(True, True, 5.0),
    "set_ahead": Choice(True, True, 5.0, True),
}
"""Views by name: "flat" is the plain list of the thesis, "set" has three properties, "set_ahead"
all four."""

SECONDS = tuple(0.5 * number for number in range(11))
"""s ahead at which `closeness` looks."""

PER_SECOND = 0.2
"""Unit of velocities, 20 m/s, over that of positions, 100 m."""

BESIDE = 0.05
ALONG = 0.15
"""5 m and 15 m; vehicles further beside or along are not close."""

ENCODER = (64, 64)
"""Widths of the layers that all vehicles share."""


@dataclass(frozen=True)
class View:
    """Encoder from an observation to a first layer's inputs, of JAX or NumPy arrays.

    Attributes:
        weights: Of the layers shared by all vehicles, each (outputs, inputs); empty if rows are
            concatenated.
        biases: Biases of the same layers.
        choice: Properties of the view.
        n_features: Length of an observation.
        times: Number of values of the time, the last feature, encoded one-hot; 0 without.
    """

    weights: tuple[Any, ...]
    biases: tuple[Any, ...]
    choice: Choice
    n_features: int
    times: int = 0

    def in_numpy(self) -> View:
        """Return the same view with NumPy weights."""
        weights, biases = (tuple(map(np.asarray, arrays)) for arrays in (self.weights, self.biases))
        return replace(self, weights=weights, biases=biases)

    @property
    def width(self) -> int:
        """Number of inputs of the perceptron."""
        of_ego = ego_width(self.choice) + self.times
        if self.choice.pooled:
            return of_ego + 2 * ENCODER[-1]
        ego, user = self.choice.layout
        return of_ego + (self.n_features - ego) // user * row_width(self.choice)

    def __call__(self, observation: Shaped[Any, "*batch feature"]) -> Shaped[Any, "*batch width"]:
        """Encode observations along the last axis; the time comes first."""
        if self.times:
            xp = observation.__array_namespace__()
            time = observation[..., -1:] == np.arange(self.times, dtype=np.float32)
            vehicles = self._vehicles(observation[..., :-1])
            return xp.concatenate([time.astype(np.float32), vehicles], axis=-1)
        return self._vehicles(observation)

    def _vehicles(self, observation: Any) -> Any:
        """Return the features of the ego and of the vehicles around it."""
        xp = observation.__array_namespace__()
        ego, vehicles = self.split(observation)
        of_ego = self.absolute(ego)
        columns = self.of_others(ego, vehicles)
        if not self.choice.pooled:
            return xp.concatenate([of_ego, columns.reshape(*columns.shape[:-2], -1)], axis=-1)
        for weight, bias in zip(self.weights, self.biases, strict=True):
            columns = xp.maximum(columns @ weight.T + bias, 0.0)
        columns = columns * vehicles[..., :1]  # rows without a vehicle have weight 0
        return xp.concatenate([of_ego, columns.sum(axis=-2), columns.max(axis=-2)], axis=-1)

    def split(self, observation: Any) -> tuple[Any, Any]:
        """Return the numbers of the ego, and the rows of further road users on one more axis."""
        ego, user = self.choice.layout
        rows = observation[..., ego:].reshape(*observation.shape[:-1], -1, user)
        return observation[..., :ego], rows

    def absolute(self, row: Any) -> Any:
        """Return a row without its presence, scaled; numbers of another layout as they are."""
        if not self.choice.is_of_rows:
            return row
        xp = row.__array_namespace__()
        return xp.concatenate([row[..., 1:5] * self.choice.scale, row[..., 5:]], axis=-1)

    def of_others(self, ego: Any, vehicles: Any) -> Any:
        """Return features of vehicles around the ego: presence, absolute, and optionally relative.

        Args:
            ego: Row of the ego, (..., 7).
            vehicles: Rows of the vehicles around it, (..., vehicle, 7).

        Returns:
            The features, (..., vehicle, `row_width`); all 0 for a row without a vehicle.
        """
        if not self.choice.is_of_rows:
            return vehicles
        if isinstance(vehicles, np.ndarray):
            return self._of_others_in_numpy(ego, vehicles)
        xp = ego.__array_namespace__()
        columns = [vehicles[..., :1], self.absolute(vehicles)]
        if self.choice.relative:
            ego = ego[..., None, :]
            scale = self.choice.scale
            along = ego[..., 5:]
            offset = vehicles[..., 1:3] - ego[..., 1:3]
            position, velocity = (
                _turned(vector, along) for vector in (offset, vehicles[..., 3:5] - ego[..., 3:5])
            )
            columns += [scale * column for column in (*position, *velocity)]
            columns += _turned(vehicles[..., 5:], along)
            if self.choice.ahead:
                vectors = (xp.concatenate(vector, -1) for vector in (position, velocity))
                columns.append(closeness(*vectors))
        return xp.concatenate(columns, axis=-1) * vehicles[..., :1]

    def _of_others_in_numpy(self, ego: np.ndarray, vehicles: np.ndarray) -> np.ndarray:
        """Return `of_others` to the bit, in few operations: each has a cost at a single row."""
        scale = self.choice.scale
        shape = *vehicles.shape[:-1], row_width(self.choice)
        columns = np.empty(shape, vehicles.dtype)
        columns[..., :ROW] = vehicles
        columns[..., 1:5] *= scale
        if self.choice.relative:
            ego = ego[..., None, :]
            cos = ego[..., 5:6]
            sin = ego[..., 6:]
            # position, velocity, heading; headings are only turned
            offset = vehicles[..., 1:].copy()
            offset[..., :4] -= ego[..., 1:5]
            x = offset[..., ::2]
            y = offset[..., 1::2]
            turned = columns[..., ROW : ROW + 6]
            turned[..., ::2] = x * cos + y * sin
            turned[..., 1::2] = y * cos - x * sin
            if self.choice.ahead:
                columns[..., ROW + 6 :] = closeness(turned[..., :2], turned[..., 2:4])
            turned[..., :4] *= scale
        columns *= vehicles[..., :1]
        return columns


Encoding = View | OneHot
"""Encodings that a first layer may read instead of the observation."""


class PresentRows:
    """A pooled view in NumPy that encodes only the vehicles that are present, which is faster.

    At the intersection an ego sees two or three of nine possible vehicles. The result is that of
    the view itself, except that sums are taken in another order, so last bits differ.

    Attributes:
        view: The view, with NumPy weights; its activations are not negative, so that a row without
            a vehicle, which counts as 0, is never greater than one with a vehicle.
    """

    def __init__(self, view: View) -> None:
        self.view = view

    def __call__(
        self, observation: Float32[np.ndarray, "batch feature"]
    ) -> Float32[np.ndarray, "batch width"]:
        """Encode observations; the time comes first."""
        times = self.view.times
        listed = observation[:, :-1] if times else observation
        ego, vehicles = self.view.split(listed)
        present = vehicles[..., 0] > 0
        counts = present.sum(axis=1)
        egos = np.repeat(ego, counts, axis=0)
        columns = self.view.of_others(egos, vehicles[present][:, None])[:, 0]
        for weight, bias in zip(self.view.weights, self.view.biases, strict=True):
            columns = np.maximum(columns @ weight.T + bias, 0.0)
        pooled = np.zeros((2, len(observation), columns.shape[1]), np.float32)
        columns *= vehicles[present][:, :1]  # the class of who is there
        if len(columns):
            occupied = counts > 0
            first = np.append(0, counts[occupied].cumsum()[:-1])
            pooled[0, occupied] = np.add.reduceat(columns, first, axis=0)
            pooled[1, occupied] = np.maximum.reduceat(columns, first, axis=0)
        time = observation[:, -1:] == np.arange(times, dtype=np.float32)
        clock = [time.astype(np.float32)] if times else []
        return np.concatenate([*clock, self.view.absolute(ego), *pooled], axis=-1)


def closeness(position: Any, velocity: Any) -> Any:
    """Return how close vehicles come to the ego at each of `SECONDS`, if all keep their velocities.

    A rule that brakes for a vehicle that comes into the strip ahead needs a quotient of distances
    and speeds, which a small network learns from many rows only. The closeness is the product of
    two hats, 5 m to either side and 15 m before and behind.

    Args:
        position: Position relative to the ego, along its heading and to its left, in units of 100
            m; last axis of length 2.
        velocity: Velocity relative to the ego in the same directions, in units of 20 m/s; last axis
            of length 2.

    Returns:
        On the last axis the closeness at each moment, in [0, 1], then for each moment the closeness
        times the distance ahead in units of 15 m.
    """
    xp = position.__array_namespace__()
    seconds = PER_SECOND * np.asarray(SECONDS, np.float32)
    ahead = (position[..., :1] + velocity[..., :1] * seconds) / ALONG
    beside = (position[..., 1:] + velocity[..., 1:] * seconds) / BESIDE
    hats = [xp.maximum(1.0 - xp.abs(distance), 0.0) for distance in (ahead, beside)]
    close = hats[0] * hats[1]
    return xp.concatenate([close, close * ahead], axis=-1)


def _turned(vector: Any, along: Any) -> list[Any]:
    """Return components along a heading (cos, sin) and to its left, last axes of length 1."""
    x = vector[..., :1]
    y = vector[..., 1:]
    cos = along[..., :1]
    sin = along[..., 1:]
    return [x * cos + y * sin, y * cos - x * sin]


def ego_width(choice: Choice) -> int:
    """Return the number of features of the ego."""
    return ROW - 1 if choice.is_of_rows else choice.layout[0]


def row_width(choice: Choice) -> int:
    """Return the number of features of another road user."""
    if not choice.is_of_rows:
        return choice.layout[1]
    return ROW + (6 if choice.relative else 0) + (2 * len(SECONDS) if choice.ahead else 0)


def hats(degrees: Any, knots: tuple[float, ...]) -> Any:
    """Return the hat functions ``max(0, 1 - |α - k| / h)`` of an angle, with knots k at distance h.

    Their weighted sums are the continuous functions that are linear between knots. The values of
    an angle's best actions have kinks where the policy changes: linear pieces follow these, while
    (cos α, sin α) alone rounds them off and so favours the action whose value has the kink.

    Args:
        degrees: Angles in degrees, a NumPy or JAX array; whole turns don't matter.
        knots: Centres of the hats in degrees, at least two, at equal distances.

    Returns:
        The hats of each angle, on one more axis, of the knots.
    """
    middle = (knots[0] + knots[-1]) / 2
    distance = knots[1] - knots[0]
    offset = wrapped(degrees - middle, 180.0)  # of the angle from the middle knot
    centres = np.array(knots, np.float32) - np.float32(middle)
    xp = degrees.__array_namespace__()
    return xp.maximum(1.0 - xp.abs(offset[..., None] - centres) / distance, 0.0)


def angle_columns(direction: RewardPair, knots: tuple[float, ...]) -> list[Any]:
    """Return the first layer's inputs of directions: the pair, then the hats.

    Args:
        direction: (cos α, sin α), NumPy or JAX arrays; sin α may have parts by class, without
            knots.
        knots: Centres of the hats in degrees; none for the pair alone.

    Returns:
        The parts of the direction stacked on one more axis, then the hats if there are knots.
    """
    xp = direction.env.__array_namespace__()
    pair = xp.stack(direction.parts, axis=-1)
    if not knots:
        return [pair]
    return [pair, hats(xp.rad2deg(xp.arctan2(direction.social, direction.env)), knots)]
