"""Rewards that a choice of acceleration would bring: own progress, and what others lose.

The driver takes the acceleration for a second and keeps its speed then. Others drive by the IDM
behind their own leaders, who keep their speeds, once beside the driver and once in its absence, as
in `conflicts.counterfactual`; but nothing after the moment is known here. Both rewards are in
seconds: metres divided by one speed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from socialiq.types import RewardPair
from socialiq_recordings.prediction.following import accelerations, literature
from socialiq_recordings.prediction.situation import Situations, ballistic

AHEAD = 5.0
"""s over which progress and losses are counted."""

UNIT = 10.0
"""m/s; metres are divided by it."""

_DT = 0.25  # s

Metres = Float64[np.ndarray, "moment candidate"]


class _Driven(NamedTuple):
    """Vehicles at a step.

    Attributes:
        driven: Since the moment, m.
        speed: m/s.
    """

    driven: Metres
    speed: Metres


def rewards(seen: Situations, grid: Float64[np.ndarray, " candidate"]) -> RewardPair:
    """Return r_env and r_social of each acceleration, each (moment, candidate).

    r_env is the driver's progress beyond that at its present speed. r_social is minus what the
    other vehicle of the conflict and the follower lose against the driver's absence.

    Args:
        seen: Situations.
        grid: Accelerations, m/s².
    """
    shape = (len(seen), len(grid))
    path = _path(np.broadcast_to(seen.speed[:, None], shape), np.broadcast_to(grid, shape))
    env = (path[-1].driven - AHEAD * seen.speed[:, None]) / UNIT
    lost = np.zeros(shape)
    lost[seen.conflict] += _lost_in_conflict(seen.rows(seen.conflict), _some(path, seen.conflict))
    followed = np.isfinite(seen.behind)
    lost[followed] += _lost_behind(seen.rows(followed), _some(path, followed))
    return RewardPair(env, 0.0 - lost / UNIT)  # 0, not -0


def _path(speed: Metres, rate: Metres) -> list[_Driven]:
    """Return the driver at the begin and at the end of every step."""
    made = [_Driven(np.zeros(speed.shape), speed)]
    for step in range(round(AHEAD / _DT)):
        now = rate if step * _DT < 1.0 else np.zeros(rate.shape)
        driven, after = ballistic(made[-1].speed, now, _DT)
        made.append(_Driven(made[-1].driven + driven, after))
    return made


def _some(path: list[_Driven], mask: Bool[np.ndarray, " moment"]) -> list[_Driven]:
    return [_Driven(one.driven[mask], one.speed[mask]) for one in path]


def _driver(speed: Float64[np.ndarray, " moment"]) -> Float64[np.ndarray, "moment one parameter"]:
    """Return the IDM's log-parameters of vehicles that wish to go as fast as they do, at least."""
    found = np.tile(literature(), (len(speed), 1, 1))
    found[:, 0, 0] = np.maximum(found[:, 0, 0], np.log(np.maximum(speed, 1.0)))
    return found


def _lost_behind(seen: Situations, path: list[_Driven]) -> Metres:
    """Return the metres that followers lose because the driver is ahead of them."""
    model, shape = _driver(seen.behind_speed), path[0].driven.shape
    gap, ahead = seen.behind[:, None], seen.leader_speed[:, None]
    free = (seen.behind + seen.length + seen.gap)[:, None]
    behind = absent = _Driven(np.zeros(shape), np.broadcast_to(seen.behind_speed[:, None], shape))
    for step, ego in enumerate(path[:-1]):
        behind = _on(
            behind, accelerations(model, behind.speed, gap + ego.driven - behind.driven, ego.speed)
        )
        left = free + ahead * step * _DT - absent.driven
        absent = _on(absent, accelerations(model, absent.speed, left, ahead))
    return np.maximum(absent.driven - behind.driven, 0.0)


def _lost_in_conflict(seen: Situations, path: list[_Driven]) -> Metres:
    """Return the metres that other vehicles of conflicts lose because the driver comes first."""
    model, shape = _driver(seen.other_speed), path[0].driven.shape
    first, leaves = _first(seen, path)
    one = absent = _Driven(np.zeros(shape), np.broadcast_to(seen.other_speed[:, None], shape))
    for step, ego in enumerate(path[:-1]):
        now = step * _DT
        free = _behind_leader(seen, model, one, now)
        blocked = first & _in_the_way(seen, one, leaves - now)
        to_area = seen.other_to_area[:, None] - one.driven
        stopping = accelerations(model, one.speed, to_area, np.zeros(shape))
        rate = np.where(blocked, np.minimum(free, stopping), free)
        beyond = ego.driven - seen.to_area[:, None]
        follows = first & seen.merging[:, None] & (beyond >= 0)
        gap = to_area + beyond - seen.length[:, None]
        following = accelerations(model, one.speed, gap, ego.speed)
        rate = np.where(follows, np.minimum(rate, following), rate)
        one = _on(one, rate)
        absent = _on(absent, _behind_leader(seen, model, absent, now))
    return np.maximum(absent.driven - one.driven, 0.0)


def _on(one: _Driven, rate: Metres) -> _Driven:
    driven, after = ballistic(one.speed, rate, _DT)
    return _Driven(one.driven + driven, after)


def _behind_leader(
    seen: Situations, model: Float64[np.ndarray, "moment one parameter"], other: _Driven, now: float
) -> Metres:
    ahead = seen.other_leader_speed[:, None]
    gap = seen.other_gap[:, None] + ahead * now - other.driven
    return accelerations(model, other.speed, gap, ahead)


def _in_the_way(
    seen: Situations, other: _Driven, leaves: Metres
) -> Bool[np.ndarray, "moment candidate"]:
    """Whether another would arrive at its speed before the driver has left, s from now."""
    to_area = seen.other_to_area[:, None] - other.driven
    return (to_area > 0) & (leaves > 0) & (to_area < leaves * other.speed)


def _first(
    seen: Situations, path: list[_Driven]
) -> tuple[Bool[np.ndarray, "moment candidate"], Metres]:
    """Whether the driver comes first to the area, and when it leaves it, s from the moment."""
    enters = _reached(path, seen.to_area)
    with np.errstate(divide="ignore"):
        other = np.maximum(seen.other_to_area, 0.0) / seen.other_speed
    return enters <= other[:, None], _reached(path, seen.to_area + seen.through)


def _reached(path: list[_Driven], metres: Float64[np.ndarray, " moment"]) -> Metres:
    """Return the times at which drivers have gone some metres, s; infinite if they stand before."""
    found = np.full(path[0].driven.shape, np.inf)
    for step in range(len(path) - 1, -1, -1):
        left = metres[:, None] - path[step].driven
        speed = path[step].speed
        at = step * _DT + np.maximum(left, 0.0) / np.maximum(speed, 1e-9)
        last = step == len(path) - 1
        passed = (left <= 0) | (path[min(step + 1, len(path) - 1)].driven >= metres[:, None])
        found = np.where(passed | (last & (speed > 0)), np.minimum(found, at), found)
    return found
