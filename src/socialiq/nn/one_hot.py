"""Integer features put before a perceptron one place for each value, as a table would index them.

A perceptron over raw coordinates has to bend around every rule that holds in one cell only. In a
gridworld one place for each value takes that off it.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Shaped

from socialiq.errors import UserError


class OneHot(eqx.Module):
    """From integer features to zeros and ones; works on JAX and on NumPy arrays alike.

    A value outside its feature's range is all zeros.

    Attributes:
        lows: Smallest value of each feature.
        sizes: Number of values of each feature.
    """

    lows: tuple[int, ...] = eqx.field(static=True)
    sizes: tuple[int, ...] = eqx.field(static=True)

    @staticmethod
    def of(values: tuple[tuple[int, int], ...]) -> OneHot:
        """Of (smallest value, number of values) for each feature.

        Raises:
            UserError: If there is no feature, or one without values.
        """
        if not values or any(size < 1 for _, size in values):
            raise UserError("one_hot needs (smallest value, number of values) for each feature")
        lows, sizes = zip(*values, strict=True)
        return OneHot(tuple(map(int, lows)), tuple(map(int, sizes)))

    def in_numpy(self) -> OneHot:
        """Itself: it has no weights."""
        return self

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return len(self.sizes)

    @property
    def width(self) -> int:
        """Numbers that the perceptron reads."""
        return sum(self.sizes)

    def __call__(self, observation: Shaped[Any, "*batch feature"]) -> Shaped[Any, "*batch width"]:
        """Encode one observation, or any number of them."""
        xp = observation.__array_namespace__()
        places = [
            observation[..., number, None] == np.arange(low, low + size, dtype=np.float32)
            for number, (low, size) in enumerate(zip(self.lows, self.sizes, strict=True))
        ]
        return xp.concatenate(places, axis=-1).astype(np.float32)
