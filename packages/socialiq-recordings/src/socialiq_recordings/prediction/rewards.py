"""Rewards of an acceleration before it is made: seconds that the driver and others gain or lose.

The driver takes the acceleration for a second and keeps its speed then. Others drive by the IDM
behind their own leaders, who keep their speeds, once beside the driver and once in its absence;
nothing after the moment is known. Both rewards are in seconds: metres over one speed.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from socialiq.physics import ballistic
from socialiq.types import RewardPair
from socialiq_recordings.prediction.following import accelerations, literature
from socialiq_recordings.prediction.situations import Situations

AHEAD = 5.0  # s over which progress and losses are counted
UNIT = 10.0  # m/s; metres are divided by it
_DT = 0.25  # s
_STEPS = round(AHEAD / _DT)

Metres = Float64[np.ndarray, "moment candidate"]
Course = Float64[np.ndarray, "step moment candidate"]


def rewards(situations: Situations, grid: Float64[np.ndarray, " candidate"]) -> RewardPair:
    """Return r_env and r_social of each acceleration of a grid in m/s², each (moment, candidate).

    r_env is the driver's progress beyond that at its present speed. r_social is minus what the
    other vehicle of the conflict and the follower lose against the driver's absence.
    """
    shape = (len(situations), len(grid))
    path = [(np.zeros(shape), np.broadcast_to(situations.speed[:, None], shape))]
    for step in range(_STEPS):
        path.append(_on(path[-1], np.broadcast_to(grid * (step * _DT < 1.0), shape)))
    driven, speed = (np.stack(column) for column in zip(*path, strict=True))
    env = (driven[-1] - AHEAD * situations.speed[:, None]) / UNIT
    lost, follows = np.zeros(shape), np.isfinite(situations.behind)
    for rows, losses in ((situations.conflict, _lost_in_conflict), (follows, _lost_behind)):
        lost[rows] += losses(situations.rows(rows), driven[:, rows], speed[:, rows])
    return RewardPair(env, 0.0 - lost / UNIT)  # 0, not -0


def _on(vehicle: tuple[Metres, Metres], rate: Metres) -> tuple[Metres, Metres]:
    """Return the metres driven and the speeds of vehicles a step later."""
    driven, after = ballistic(vehicle[1], rate, _DT)
    return vehicle[0] + driven, after


def _others(
    speed: Float64[np.ndarray, " moment"], shape: tuple[int, ...]
) -> tuple[Float64[np.ndarray, "moment one parameter"], tuple[Metres, Metres]]:
    """Return the IDM's log-parameters and the states of vehicles that wish to keep their speeds."""
    model = np.tile(literature(), (len(speed), 1, 1))
    model[:, 0, 0] = np.maximum(model[:, 0, 0], np.log(np.maximum(speed, 1.0)))
    return model, (np.zeros(shape), np.broadcast_to(speed[:, None], shape))


def _lost_behind(situations: Situations, driven: Course, speed: Course) -> Metres:
    """Return the metres that followers lose because the driver is ahead of them."""
    model, begin = _others(situations.behind_speed, driven.shape[1:])
    gap, ahead = situations.behind[:, None], situations.leader_speed[:, None]
    free = (situations.behind + situations.length + situations.gap)[:, None]
    behind = absent = begin
    for step in range(_STEPS):
        to_driver = gap + driven[step] - behind[0]
        behind = _on(behind, accelerations(model, behind[1], to_driver, speed[step]))
        left = free + ahead * step * _DT - absent[0]
        absent = _on(absent, accelerations(model, absent[1], left, ahead))
    return np.maximum(absent[0] - behind[0], 0.0)


def _lost_in_conflict(situations: Situations, driven: Course, speed: Course) -> Metres:
    """Return the metres that other vehicles of conflicts lose because the driver comes first."""
    model, begin = _others(situations.other_speed, driven.shape[1:])
    ahead, stand = situations.other_leader_speed[:, None], np.zeros(driven.shape[1:])
    enters, leaves = (
        _reached(driven, speed, metres)
        for metres in (situations.to_area, situations.to_area + situations.through)
    )
    with np.errstate(divide="ignore"):
        other_enters = np.maximum(situations.other_to_area, 0.0) / situations.other_speed
    first = enters <= other_enters[:, None]

    def behind_leader(vehicle: tuple[Metres, Metres]) -> Metres:
        gap = situations.other_gap[:, None] + ahead * now - vehicle[0]
        return accelerations(model, vehicle[1], gap, ahead)

    partner = absent = begin
    for step in range(_STEPS):
        now = step * _DT
        to_area, left = situations.other_to_area[:, None] - partner[0], leaves - now
        # It would arrive at its speed before the driver has left.
        blocked = first & (to_area > 0) & (left > 0) & (to_area < left * partner[1])
        free, stopping = behind_leader(partner), accelerations(model, partner[1], to_area, stand)
        rate = np.where(blocked, np.minimum(free, stopping), free)
        beyond = driven[step] - situations.to_area[:, None]
        follows = first & situations.merging[:, None] & (beyond >= 0)
        gap = to_area + beyond - situations.length[:, None]
        following = accelerations(model, partner[1], gap, speed[step])
        rate = np.where(follows, np.minimum(rate, following), rate)
        partner, absent = _on(partner, rate), _on(absent, behind_leader(absent))
    return np.maximum(absent[0] - partner[0], 0.0)


def _reached(driven: Course, speed: Course, metres: Float64[np.ndarray, " moment"]) -> Metres:
    """Return the times at which drivers have gone some metres, s; infinite if they stand before."""
    times = np.full(driven.shape[1:], np.inf)
    for step in range(_STEPS, -1, -1):
        left = metres[:, None] - driven[step]
        at = step * _DT + np.maximum(left, 0.0) / np.maximum(speed[step], 1e-9)
        passed = (left <= 0) | (driven[min(step + 1, _STEPS)] >= metres[:, None])
        times = np.where(
            passed | ((step == _STEPS) & (speed[step] > 0)), np.minimum(times, at), times
        )
    return times
