"""How vehicles are put before a perceptron: as they are listed, or as a set seen from the ego.

The intersection's observation is rows of seven numbers (presence, x, y, vx, vy, cos h, sin h), the
ego's first. A perceptron over the flat list has to learn every crossing vehicle once for each row
it may stand in, and distances from pairs of absolute positions. A view takes both off it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import PRNGKeyArray, Shaped

from socialiq.errors import UserError, one_of

ROW = 7  # numbers of a vehicle


class Choice(NamedTuple):
    """What a view does.

    Attributes:
        pooled: Encode every other vehicle by the same layers, and keep sum and maximum over them,
            so that their order doesn't matter; else the rows stand side by side.
        relative: Add each vehicle's position, velocity and heading as the ego sees them.
        scale: Factor on positions and velocities: 5 makes 20 m and 4 m/s one.
    """

    pooled: bool
    relative: bool
    scale: float


CHOICES: dict[str, Choice | None] = {
    "flat": None,
    "flat_scaled": Choice(False, False, 5.0),
    "flat_relative": Choice(False, True, 1.0),
    "flat_relative_scaled": Choice(False, True, 5.0),
    "set_absolute": Choice(True, False, 1.0),
    "set_scaled": Choice(True, False, 5.0),
    "set_relative": Choice(True, True, 1.0),
    "set": Choice(True, True, 5.0),
}
"""Views by name: "flat" is the thesis' plain list, "set" does all three."""

_ENCODER = (64, 64)  # widths of the layers that all vehicles share


class View(eqx.Module):
    """From an observation to what the first layer of a perceptron reads.

    Works on JAX and on NumPy arrays alike, whichever its weights and its input are.

    Attributes:
        weights: Of the layers that all vehicles share, each (outputs, inputs); none where rows
            stand side by side.
        biases: Of the same layers.
        choice: What it does.
        n_features: Length of an observation.
    """

    weights: tuple[Any, ...]
    biases: tuple[Any, ...]
    choice: Choice = eqx.field(static=True)
    n_features: int = eqx.field(static=True)

    @staticmethod
    def initialise(key: PRNGKeyArray, name: str, n_features: int) -> View | None:
        """Draw a view's layers; the flat view has nothing to draw and is None.

        Raises:
            UserError: If the name is unknown, or the observation is no list of vehicles.
        """
        one_of("view", name, tuple(CHOICES))
        choice = CHOICES[name]
        if choice is None:
            return None
        if n_features % ROW or n_features < 2 * ROW:
            raise UserError(
                f"view {name} reads rows of {ROW} numbers, one for each vehicle, and this world's "
                f"observation has {n_features}: use the view flat"
            )
        sizes = (_row_width(choice), *_ENCODER) if choice.pooled else ()
        keys = jax.random.split(key, len(sizes))
        layers = [
            eqx.nn.Linear(inputs, outputs, key=one)
            for inputs, outputs, one in zip(sizes[:-1], sizes[1:], keys, strict=False)
        ]
        weights, biases = (tuple(getattr(one, n) for one in layers) for n in ("weight", "bias"))
        return View(weights, biases, choice, n_features)

    def in_numpy(self) -> View:
        """The same view with NumPy weights."""
        return jax.tree.map(np.asarray, self)

    @property
    def width(self) -> int:
        """Numbers that the perceptron reads."""
        if self.choice.pooled:
            return ROW - 1 + 2 * _ENCODER[-1]
        return ROW - 1 + (self.n_features // ROW - 1) * _row_width(self.choice)

    def __call__(self, observation: Shaped[Any, "*batch feature"]) -> Shaped[Any, "*batch width"]:
        """View one observation, or any number of them."""
        xp = observation.__array_namespace__()
        rows = observation.reshape(*observation.shape[:-1], -1, ROW)
        ego, others = rows[..., 0, :], rows[..., 1:, :]
        own, seen = self._absolute(ego), self._of_others(ego, others)
        if not self.choice.pooled:
            return xp.concatenate([own, seen.reshape(*seen.shape[:-2], -1)], axis=-1)
        for weight, bias in zip(self.weights, self.biases, strict=True):
            seen = xp.maximum(seen @ weight.T + bias, 0.0)
        seen = seen * others[..., :1]  # rows without a vehicle count for nothing
        return xp.concatenate([own, seen.sum(axis=-2), seen.max(axis=-2)], axis=-1)

    def _absolute(self, row: Any) -> Any:
        xp = row.__array_namespace__()
        return xp.concatenate([row[..., 1:5] * self.choice.scale, row[..., 5:]], axis=-1)

    def _of_others(self, ego: Any, others: Any) -> Any:
        """Each other vehicle: presence, absolute, and where chosen as the ego sees it."""
        xp = ego.__array_namespace__()
        columns = [others[..., :1], self._absolute(others)]
        if self.choice.relative:
            ego = ego[..., None, :]
            scale, along = self.choice.scale, ego[..., 5:]
            offset = others[..., 1:3] - ego[..., 1:3]
            columns += [scale * one for one in _turned(offset, along)]
            columns += [scale * one for one in _turned(others[..., 3:5] - ego[..., 3:5], along)]
            columns += _turned(others[..., 5:], along)
        return xp.concatenate(columns, axis=-1) * others[..., :1]


def _turned(vector: Any, along: Any) -> list[Any]:
    """Components along a heading (cos, sin) and to its left, each with a last axis of one."""
    x, y, cos, sin = vector[..., :1], vector[..., 1:], along[..., :1], along[..., 1:]
    return [x * cos + y * sin, y * cos - x * sin]


def _row_width(choice: Choice) -> int:
    return ROW + (6 if choice.relative else 0)
