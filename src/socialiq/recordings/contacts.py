"""When recorded vehicles touch: separating axes of two rectangles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64


def touching(
    centre: Float64[np.ndarray, "pair 2 2"],
    heading: Float64[np.ndarray, "pair 2"],
    size: Float64[np.ndarray, "pair 2 2"],
    moved: Float64[np.ndarray, "pair 2 2"],
) -> Bool[np.ndarray, " pair"]:
    """Whether two rectangles overlap, or will when they have moved on.

    Args:
        centre: x and y of either, m.
        heading: Of either, rad.
        size: Length and width of either, m.
        moved: How far either will move, m; zero asks about now.
    """
    apart = centre[:, 1] - centre[:, 0]
    closing = moved[:, 1] - moved[:, 0]
    along = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    found = np.ones(len(centre), bool)
    for axis in (along[:, 0], along[:, 1], across[:, 0], across[:, 1]):
        reach = sum(
            abs((along[:, one] * axis).sum(-1)) * size[:, one, 0] / 2
            + abs((across[:, one] * axis).sum(-1)) * size[:, one, 1] / 2
            for one in range(2)
        )
        now = (apart * axis).sum(-1)
        then = now + (closing * axis).sum(-1)
        nearest = np.where(now * then <= 0, 0.0, np.minimum(abs(now), abs(then)))
        found &= nearest <= reach
    return found
