"""One-hot encoding of integer features.

A perceptron over raw coordinates fits rules that hold in one cell only with difficulty. In a
gridworld an input for each value of a feature makes this easy.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Shaped

from socialiq.errors import UserError


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
