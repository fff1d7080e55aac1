"""Conflicts at the intersection's junction, from the ego's observation at a decision."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32

from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.policies import LOOK_FROM, STOP_LINE
from socialiq.worlds.intersection.state import POSITION_RANGE

CONFLICT_SECONDS = 3.0  # time within which a crossing vehicle must reach the junction to count

APPROACH_X = 2.0  # m, centre of the ego's approach lane


def entered(observation: Float32[np.ndarray, "batch feature"]) -> Bool[np.ndarray, " batch"]:
    """Whether the ego's centre has passed its stop line."""
    return _metres(observation[:, 2]) < STOP_LINE


def at_junction(observation: Float32[np.ndarray, "batch feature"]) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is in the junction, or no more than `LOOK_FROM` before its stop line."""
    x, y = _metres(observation[:, 1]), _metres(observation[:, 2])
    return (np.abs(x) <= STOP_LINE) & (y >= -STOP_LINE) & (y <= STOP_LINE + LOOK_FROM)


def conflict(
    observation: Float32[np.ndarray, "batch feature"], seconds: float
) -> Bool[np.ndarray, " batch"]:
    """Whether a crossing vehicle is in the junction, or will be there soon at its speed.

    The rule-based drivers of `policies.gap` use the same criterion. The ego may be anywhere.

    Args:
        observation: Observations of the egos.
        seconds: Largest time until the vehicle reaches the junction.
    """
    seen = policies.in_metres(observation)
    # A follower doesn't cross, even if the ego has left the shared lane.
    seen[:, 0, 1] = APPROACH_X
    return np.any(policies.conflict(seen, seconds), axis=1)


def conflict_at_junction(
    observation: Float32[np.ndarray, "batch feature"],
) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is at the junction and has a conflict within `CONFLICT_SECONDS` there."""
    found = at_junction(observation)
    near = np.flatnonzero(found)
    found[near] = conflict(observation[near], CONFLICT_SECONDS)
    return found


def _metres(position: Float32[np.ndarray, " batch"]) -> Float[np.ndarray, " batch"]:
    return position.astype(np.float64) * POSITION_RANGE
