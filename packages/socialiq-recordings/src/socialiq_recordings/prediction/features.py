"""Features of situations: bounded numbers for learned models, 0 where nothing is there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from socialiq_recordings.prediction.following import literature, next_second
from socialiq_recordings.prediction.situation import Situations

NAMES = (
    "speed",
    "moving",
    "leader_near",
    "leader_headway",
    "leader_slower",
    "idm",
    "follower_near",
    "follower_faster",
    "junction_near",
    "left",
    "right",
    "limit",
    "gives_way",
    "conflict",
    "arrives",
    "other_arrives",
    "first",
    "merging",
    "other_speed",
)
"""Columns of `features`."""

_NEAR = 20.0  # m over which nearness falls by e
_SPEED = 10.0  # m/s
_LONG = 5.0  # s; longer times are all the same


def features(seen: Situations) -> Float64[np.ndarray, "moment feature"]:
    """Return what models learn from, in the order of `NAMES`; of about unit size.

    Args:
        seen: Situations.
    """
    leads, follows = np.isfinite(seen.gap), np.isfinite(seen.behind)
    conflict = seen.conflict
    arrives, other = (
        _time(gap, speed)
        for gap, speed in ((seen.to_area, seen.speed), (seen.other_to_area, seen.other_speed))
    )
    limit = np.where(np.isfinite(seen.limit), seen.limit, 0.0)
    columns = (
        seen.speed / _SPEED,
        seen.moving,
        _near(seen.gap),
        np.where(leads, 1 - _time(seen.gap, seen.speed) / _LONG, 0.0),
        np.where(leads, (seen.speed - seen.leader_speed) / _SPEED, 0.0),
        np.clip(next_second(literature(), seen), -4.0, 2.0),
        _near(seen.behind),
        np.where(follows, (seen.behind_speed - seen.speed) / _SPEED, 0.0),
        _near(seen.to_junction),
        np.clip(seen.turn, 0.0, 90.0) / 90.0,
        np.clip(-seen.turn, 0.0, 90.0) / 90.0,
        limit / _SPEED,
        seen.gives_way,
        conflict,
        np.where(conflict, 1 - arrives / _LONG, 0.0),
        np.where(conflict, 1 - other / _LONG, 0.0),
        np.where(conflict, np.clip(other - arrives, -_LONG, _LONG) / _LONG, 0.0),
        seen.merging & conflict,
        np.where(conflict, seen.other_speed / _SPEED, 0.0),
    )
    return np.stack([np.asarray(one, np.float64) for one in columns], axis=1)


def _near(metres: Float64[np.ndarray, " moment"]) -> Float64[np.ndarray, " moment"]:
    return np.exp(-np.maximum(metres, 0.0) / _NEAR)


def _time(
    metres: Float64[np.ndarray, " moment"], speed: Float64[np.ndarray, " moment"]
) -> Float64[np.ndarray, " moment"]:
    """Return the time to drive a distance, s; at most `_LONG`, also where nothing is there."""
    return np.clip(np.maximum(metres, 0.0) / np.maximum(speed, 0.1), 0.0, _LONG)
