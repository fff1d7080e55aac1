"""What the seed of an episode tells before anybody drives: its stratum."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

from socialiq.evaluation.junction import CONFLICT_SECONDS
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.state import FEATURES, POSITION_RANGE, SPEED_RANGE

_SOON = 5  # steps of a gridworld within which the first conflicts are decided


def of_intersection(observation: Float32[np.ndarray, "episode feature"]) -> dict[str, np.ndarray]:
    """Labels from what the ego sees when its episode begins.

    Args:
        observation: At the reset.

    Returns:
        `density`: how many others it sees. `conflict`: whether somebody who crosses is in the
        junction, or will be within the 3 s in which the ego could be there. `right_of_way`:
        whether one of these comes on the other road, which has priority over the ego's, or all
        are oncoming.
    """
    seen = observation.reshape(len(observation), -1, len(FEATURES)).astype(np.float64)
    seen[..., 1:3] *= POSITION_RANGE
    seen[..., 3:5] *= SPEED_RANGE
    others = (seen[:, 1:, 0] > 0).sum(axis=1)
    crossing = policies.conflict(seen, CONFLICT_SECONDS)
    other_road = np.abs(seen[:, 1:, 3]) > np.abs(seen[:, 1:, 4])
    met, yielding = crossing.any(axis=1), (crossing & other_road).any(axis=1)
    return {
        "density": np.select([others <= 1, others <= 3], ["0 to 1", "2 to 3"], "4 or more"),
        "conflict": np.where(met, "at once", "none yet"),
        "right_of_way": np.select([yielding, met], ["theirs", "oncoming"], "nobody crosses"),
    }


def of_grid(
    fate: Float[np.ndarray, "episode draw"], chance: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """Labels from the draws that decide where vehicles may spawn; none if nothing is drawn.

    Args:
        fate: Of `grid_play.fates`.
        chance: Probability of each chance outcome; the last is a spawn.
    """
    if len(chance) == 1:
        return {}
    spawns = (fate[:, 1 : 1 + _SOON] >= 1.0 - chance[-1]).sum(axis=1)
    return {"density": np.select([spawns == 0, spawns == 1], ["0", "1"], "2 or more")}
