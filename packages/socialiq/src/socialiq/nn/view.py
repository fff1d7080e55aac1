"""Encodings of an observation for a perceptron: vehicles as a list or a set, integers one-hot.

The intersection's observation is rows of seven numbers (presence, x, y, vx, vy, cos h, sin h), the
ego's first, and with a clock the time at the end. A perceptron over the flat list has to learn each
vehicle's effect once for each row that it may occupy, and distances from pairs of absolute
positions. A view avoids both.

A perceptron over raw coordinates fits rules that hold in one cell only with difficulty. In a
gridworld an input for each value of a feature makes this easy.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float32, PRNGKeyArray, Shaped

from socialiq.errors import UserError, one_of


class OneHot(eqx.Module):
    """Encoder from integer features to zeros and ones, for JAX and NumPy arrays.

    A value outside its feature's range is encoded as all zeros.

    Attributes:
        lows: Smallest value of each feature.
        sizes: Number of values of each feature.
    """

    lows: tuple[int, ...] = eqx.field(static=True)
    sizes: tuple[int, ...] = eqx.field(static=True)

    @staticmethod
    def of(values: tuple[tuple[int, int], ...]) -> OneHot:
        """Build the encoder from (smallest value, number of values) of each feature.

        Raises:
            UserError: If there is no feature, or a feature without values.
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
        places = [
            observation[..., number, None] == np.arange(low, low + size, dtype=np.float32)
            for number, (low, size) in enumerate(zip(self.lows, self.sizes, strict=True))
        ]
        return xp.concatenate(places, axis=-1).astype(np.float32)


ROW = 7  # numbers of a vehicle


class Choice(NamedTuple):
    """Properties of a view.

    Attributes:
        pooled: Encode every other vehicle by the same layers, and keep sum and maximum over them,
            so that their order doesn't matter; else the rows are concatenated.
        relative: Add each vehicle's position, velocity and heading relative to the ego.
        scale: Factor on positions and velocities: 5 maps 20 m and 4 m/s to 1.
        ahead: Add how close each vehicle comes to the ego in the next seconds (`closeness`).
    """

    pooled: bool
    relative: bool
    scale: float
    ahead: bool = False

    def described(self) -> dict[str, Any]:
        """Return the properties as a file has them: `ahead` only where it is true."""
        found = self._asdict()
        return found if self.ahead else {name: found[name] for name in self._fields[:-1]}

    @staticmethod
    def of_described(described: Mapping[str, Any]) -> Choice:
        """Return the properties of `described`."""
        pooled, relative, scale = (described[name] for name in Choice._fields[:-1])
        return Choice(pooled, relative, scale, described.get("ahead", False))


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

BESIDE, ALONG = 0.05, 0.15
"""5 m and 15 m; vehicles further beside or along are not close."""

_ENCODER = (64, 64)  # widths of the shared layers of all vehicles


class View(eqx.Module):
    """Encoder from an observation to the inputs of a perceptron's first layer.

    It accepts JAX and NumPy arrays, as weights and as input.

    Attributes:
        weights: Weights of the layers shared by all vehicles, each (outputs, inputs); empty if
            rows are concatenated.
        biases: Biases of the same layers.
        choice: Properties of the view.
        n_features: Length of an observation.
        times: Number of values of the time, the last feature, which are encoded one-hot: 0, 1,
            ..., times - 1. 0: there is no time.
    """

    weights: tuple[Any, ...]
    biases: tuple[Any, ...]
    choice: Choice = eqx.field(static=True)
    n_features: int = eqx.field(static=True)
    times: int = eqx.field(static=True, default=0)

    @staticmethod
    def initialise(key: PRNGKeyArray, name: str, n_features: int, times: int = 0) -> View | None:
        """Draw a view's layers; the flat view has none and is None.

        Args:
            key: Random key.
            name: A name of `CHOICES`.
            n_features: Length of an observation, the time included.
            times: Number of values of the time, the last feature; 0 for none.

        Raises:
            UserError: If the name is unknown, or the observation is not a list of vehicles.
        """
        one_of("view", name, tuple(CHOICES))
        choice = CHOICES[name]
        if choice is None:
            return None
        listed = n_features - bool(times)
        if listed % ROW or listed < 2 * ROW:
            raise UserError(
                f"view {name} reads rows of {ROW} numbers, one for each vehicle, and this world's "
                f"observation has {listed}: use the view flat"
            )
        sizes = (row_width(choice), *_ENCODER) if choice.pooled else ()
        keys = jax.random.split(key, len(sizes))
        layers = [
            eqx.nn.Linear(inputs, outputs, key=one)
            for inputs, outputs, one in zip(sizes[:-1], sizes[1:], keys, strict=False)
        ]
        weights, biases = (tuple(getattr(one, n) for one in layers) for n in ("weight", "bias"))
        return View(weights, biases, choice, n_features, times)

    def in_numpy(self) -> View:
        """Return the same view with NumPy weights."""
        return jax.tree.map(np.asarray, self)

    @property
    def width(self) -> int:
        """Number of inputs of the perceptron."""
        own = ROW - 1 + self.times
        if self.choice.pooled:
            return own + 2 * _ENCODER[-1]
        return own + (self.n_features // ROW - 1) * row_width(self.choice)

    def __call__(self, observation: Shaped[Any, "*batch feature"]) -> Shaped[Any, "*batch width"]:
        """Encode observations along the last axis; the time comes first."""
        if self.times:
            xp = observation.__array_namespace__()
            time = observation[..., -1:] == np.arange(self.times, dtype=np.float32)
            seen = self._vehicles(observation[..., :-1])
            return xp.concatenate([time.astype(np.float32), seen], axis=-1)
        return self._vehicles(observation)

    def _vehicles(self, observation: Any) -> Any:
        """Return the features of the ego and of the other vehicles."""
        xp = observation.__array_namespace__()
        rows = observation.reshape(*observation.shape[:-1], -1, ROW)
        ego, others = rows[..., 0, :], rows[..., 1:, :]
        own, seen = self.absolute(ego), self.of_others(ego, others)
        if not self.choice.pooled:
            return xp.concatenate([own, seen.reshape(*seen.shape[:-2], -1)], axis=-1)
        for weight, bias in zip(self.weights, self.biases, strict=True):
            seen = xp.maximum(seen @ weight.T + bias, 0.0)
        seen = seen * others[..., :1]  # rows without a vehicle have weight 0
        return xp.concatenate([own, seen.sum(axis=-2), seen.max(axis=-2)], axis=-1)

    def absolute(self, row: Any) -> Any:
        """Return a row without its presence, scaled."""
        xp = row.__array_namespace__()
        return xp.concatenate([row[..., 1:5] * self.choice.scale, row[..., 5:]], axis=-1)

    def of_others(self, ego: Any, others: Any) -> Any:
        """Return features of the other vehicles: presence, absolute, and optionally relative."""
        xp = ego.__array_namespace__()
        columns = [others[..., :1], self.absolute(others)]
        if self.choice.relative:
            ego = ego[..., None, :]
            scale, along = self.choice.scale, ego[..., 5:]
            offset = others[..., 1:3] - ego[..., 1:3]
            place, motion = (
                _turned(one, along) for one in (offset, others[..., 3:5] - ego[..., 3:5])
            )
            columns += [scale * one for one in (*place, *motion)]
            columns += _turned(others[..., 5:], along)
            if self.choice.ahead:
                columns.append(closeness(xp.concatenate(place, -1), xp.concatenate(motion, -1)))
        return xp.concatenate(columns, axis=-1) * others[..., :1]


class PresentRows:
    """A pooled view in NumPy that encodes only the vehicles that are there: faster, and the same.

    At the intersection an ego sees two or three of nine possible vehicles. Sums are taken in
    another order than by the view itself, so last bits differ.

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
        vehicles = observation[:, :-1] if times else observation
        rows = vehicles.reshape(len(observation), -1, ROW)
        ego, others = rows[:, 0], rows[:, 1:]
        present = others[..., 0] > 0
        counts = present.sum(axis=1)
        seen = self.view.of_others(np.repeat(ego, counts, axis=0), others[present][:, None])[:, 0]
        for weight, bias in zip(self.view.weights, self.view.biases, strict=True):
            seen = np.maximum(seen @ weight.T + bias, 0.0)
        pooled = np.zeros((2, len(rows), seen.shape[1]), np.float32)
        if len(seen):
            some = counts > 0
            first = np.append(0, counts[some].cumsum()[:-1])
            pooled[0, some] = np.add.reduceat(seen, first, axis=0)
            pooled[1, some] = np.maximum.reduceat(seen, first, axis=0)
        time = observation[:, -1:] == np.arange(times, dtype=np.float32)
        known = [time.astype(np.float32)] if times else []
        return np.concatenate([*known, self.view.absolute(ego), *pooled], axis=-1)


def closeness(place: Any, motion: Any) -> Any:
    """Return how close vehicles come to the ego at each of `SECONDS`, if all keep their velocities.

    A rule that brakes for who comes into the strip ahead needs a quotient of distances and speeds,
    which a small network learns from many rows only. These are such quantities: the product of two
    hats, 5 m to either side and 15 m before and behind, and the same times the distance ahead.

    Args:
        place: Relative position along the ego's heading and to its left, in units of 100 m, last
            axis of length 2.
        motion: Relative velocity, in units of 20 m/s.

    Returns:
        Last axis: for each moment the closeness, in [0, 1]; then for each the closeness times the
        distance ahead in units of 15 m.
    """
    xp = place.__array_namespace__()
    seconds = PER_SECOND * np.asarray(SECONDS, np.float32)
    ahead = (place[..., :1] + motion[..., :1] * seconds) / ALONG
    beside = (place[..., 1:] + motion[..., 1:] * seconds) / BESIDE
    hats = [xp.maximum(1.0 - xp.abs(one), 0.0) for one in (ahead, beside)]
    close = hats[0] * hats[1]
    return xp.concatenate([close, close * ahead], axis=-1)


def _turned(vector: Any, along: Any) -> list[Any]:
    """Return components along a heading (cos, sin) and to its left, last axes of length 1."""
    x, y, cos, sin = vector[..., :1], vector[..., 1:], along[..., :1], along[..., 1:]
    return [x * cos + y * sin, y * cos - x * sin]


def row_width(choice: Choice) -> int:
    """Return the number of features of another vehicle."""
    return ROW + (6 if choice.relative else 0) + (2 * len(SECONDS) if choice.ahead else 0)
