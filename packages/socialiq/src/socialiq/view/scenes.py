"""Vehicles of the intersection from what the ego observed: their places, and who is who."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float32
from scipy.optimize import linear_sum_assignment

from socialiq.worlds.highway.state import FEATURES
from socialiq.worlds.intersection.state import POSITION_RANGE, SPEED_RANGE

FURTHEST = 7.0
"""Metres between a vehicle and where its speed would have taken it, within which it is the same."""

_FAR = 1e6


def scenes_of(
    observations: Float32[np.ndarray, "time feature"], seconds: float
) -> list[list[list[float | int]]]:
    """Return the vehicles of each observation.

    Args:
        observations: The ego's observations, in order; a clock at their end is ignored.
        seconds: Time between two of them.

    Returns:
        By time, a row for each vehicle: x, y in m, heading in rad, speed in m/s, and a number that
        the same vehicle keeps. The ego comes first.
    """
    rows = len(FEATURES) * (observations.shape[1] // len(FEATURES))
    before, names, scenes = np.empty((0, 7)), np.empty(0, int), []
    next_name = 0
    for rows_of_scene in observations[:, :rows].reshape(len(observations), -1, len(FEATURES)):
        now = rows_of_scene[rows_of_scene[:, 0] > 0].astype(np.float64)
        numbers = _matched(before, names, now, seconds)
        new = np.flatnonzero(numbers < 0)
        numbers[new] = next_name + np.arange(len(new))
        next_name += len(new)
        scenes.append(
            [_vehicle(vehicle, int(name)) for vehicle, name in zip(now, numbers, strict=True)]
        )
        before, names = now, numbers
    return scenes


def _matched(before: Any, names: np.ndarray, now: Any, seconds: float) -> np.ndarray:
    """Return for each vehicle its name of before; -1 for a new one. The ego stays the ego."""
    numbers = np.full(len(now), -1)
    if not len(before) or not len(now):
        return numbers
    expected = before[:, 1:3] * POSITION_RANGE + before[:, 3:5] * SPEED_RANGE * seconds
    places = now[:, 1:3] * POSITION_RANGE
    apart = np.linalg.norm(expected[:, None] - places[None], axis=-1)
    apart[0, 1:] = apart[1:, 0] = _FAR
    apart[0, 0] = 0.0
    for old, new in zip(*linear_sum_assignment(apart), strict=True):
        if apart[old, new] <= FURTHEST:
            numbers[new] = names[old]
    return numbers


def _vehicle(row: Any, name: int) -> list[float | int]:
    _, x, y, vx, vy, cosine, sine = row.tolist()
    heading = float(np.arctan2(sine, cosine))
    speed = float(np.hypot(vx, vy)) * SPEED_RANGE
    return [x * POSITION_RANGE, y * POSITION_RANGE, heading, speed, name]
