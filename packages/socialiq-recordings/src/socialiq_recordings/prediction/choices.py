"""Choices of recorded drivers: at each decision some accelerations, and what each would bring.

A row is a decision. All of a row but the observed acceleration is known at its time, and the
base predictor was trained without the vehicles of the row's chain. A driver of angle α chooses
with p(a | s, α) proportional to p_base(a | s) exp(β R(α)), R(α) = cos α r_env + sin α r_social
(Eq 4.3).

Rewards of a choice: the driver takes the acceleration for a second and keeps its speed then. Others
drive by the IDM behind their own leaders, who keep their speeds, once beside the driver and once in
its absence; nothing after the moment is known. Both rewards are in seconds: metres over one speed.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.errors import UserError
from socialiq.types import RewardPair
from socialiq_recordings.physics import ballistic
from socialiq_recordings.prediction.following import accelerations, literature
from socialiq_recordings.prediction.situations import Situations

_SUM = 1e-6  # by which probabilities of a row may miss 1


@dataclass(frozen=True, eq=False)
class ChoiceTable:
    """Decisions of recorded drivers on a grid of accelerations.

    Attributes:
        driver: Number of the vehicle, one number over all recordings.
        chain: Number of the chain of recordings; different chains share no vehicle.
        site: Number of the site.
        time: s on the recording's clock; ascending within a driver.
        half: 0 in the first half of the driver's conflicts, 1 in the second. An angle is inferred
            from the first and scored on the second.
        conflict: Whether the driver and another vehicle are on course for one conflict area.
        moving: Whether the vehicle moves.
        grid: Accelerations to choose from, m/s², ascending and equally spaced.
        log_base: Log-probability of each by the base predictor; a row's probabilities sum to 1.
        r_env: What each brings the driver: seconds of its own travel time saved, against keeping
            its speed.
        r_social: What each brings others: minus the seconds that they lose against the driver's
            absence.
        acceleration: Observed mean of the next second, m/s².
        residual: Observed minus expected acceleration of the driver's decision before, m/s²; 0
            where there is none.

    Raises:
        UserError: If columns don't fit together, or a number is not finite.
    """

    driver: Int64[np.ndarray, " decision"]
    chain: Int64[np.ndarray, " decision"]
    site: Int64[np.ndarray, " decision"]
    time: Float64[np.ndarray, " decision"]
    half: Int64[np.ndarray, " decision"]
    conflict: Bool[np.ndarray, " decision"]
    moving: Bool[np.ndarray, " decision"]
    grid: Float64[np.ndarray, " candidate"]
    log_base: Float64[np.ndarray, "decision candidate"]
    r_env: Float64[np.ndarray, "decision candidate"]
    r_social: Float64[np.ndarray, "decision candidate"]
    acceleration: Float64[np.ndarray, " decision"]
    residual: Float64[np.ndarray, " decision"]

    # Run-time type checkers leave the constructor to `__post_init__`, whose lines say what to do.
    __no_type_check__: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check every column."""
        grid, decisions = self.grid, len(self.driver)
        steps = np.diff(grid) if grid.ndim == 1 else np.zeros(0)
        if len(steps) < 1 or not (steps > 0).all() or np.ptp(steps) > 1e-9 * len(grid):
            raise UserError("grid must be two or more ascending, equally spaced accelerations")
        for field in fields(self):
            column = getattr(self, field.name)
            wide = field.name in ("log_base", "r_env", "r_social")
            shape = (decisions, len(grid)) if wide else (decisions,)
            if field.name != "grid" and column.shape != shape:
                raise UserError(f"column {field.name} has the shape {column.shape}, not {shape}")
            if column.dtype.kind == "f" and not np.isfinite(column).all():
                raise UserError(f"column {field.name} holds a number that is not finite")
        if decisions and np.abs(np.exp(self.log_base).sum(axis=1) - 1).max() > _SUM:
            raise UserError("log_base must be log-probabilities that sum to 1 in each row")
        if not np.isin(self.half, (0, 1)).all():
            raise UserError("half must be 0 or 1")

    def __len__(self) -> int:
        """Return the number of decisions."""
        return len(self.driver)

    @property
    def chosen(self) -> Int64[np.ndarray, " decision"]:
        """Index of the acceleration of the grid that is closest to the observed one."""
        return nearest(self.grid, self.acceleration)

    def rows(self, mask: Bool[np.ndarray, " decision"]) -> ChoiceTable:
        """Return only some decisions.

        Args:
            mask: Those to keep.
        """
        columns = {f.name: getattr(self, f.name)[mask] for f in fields(self) if f.name != "grid"}
        return replace(self, **columns)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all columns by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def nearest(grid: Float64[np.ndarray, " candidate"], values: Any) -> Int64[np.ndarray, " decision"]:
    """Return the index of the closest acceleration of an equally spaced grid.

    Args:
        grid: m/s², ascending.
        values: m/s², one for each decision.
    """
    index = np.rint((np.asarray(values) - grid[0]) / (grid[1] - grid[0]))
    return np.clip(index, 0, len(grid) - 1).astype(np.int64)


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
    states = [_Driven(np.zeros(speed.shape), speed)]
    for step in range(round(AHEAD / _DT)):
        now = rate if step * _DT < 1.0 else np.zeros(rate.shape)
        driven, after = ballistic(states[-1].speed, now, _DT)
        states.append(_Driven(states[-1].driven + driven, after))
    return states


def _some(path: list[_Driven], mask: Bool[np.ndarray, " moment"]) -> list[_Driven]:
    return [_Driven(state.driven[mask], state.speed[mask]) for state in path]


def _driver(speed: Float64[np.ndarray, " moment"]) -> Float64[np.ndarray, "moment one parameter"]:
    """Return the IDM's log-parameters of vehicles that wish to go as fast as they do, at least."""
    parameters = np.tile(literature(), (len(speed), 1, 1))
    parameters[:, 0, 0] = np.maximum(parameters[:, 0, 0], np.log(np.maximum(speed, 1.0)))
    return parameters


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
    partner = absent = _Driven(np.zeros(shape), np.broadcast_to(seen.other_speed[:, None], shape))
    for step, ego in enumerate(path[:-1]):
        now = step * _DT
        free = _behind_leader(seen, model, partner, now)
        blocked = first & _in_the_way(seen, partner, leaves - now)
        to_area = seen.other_to_area[:, None] - partner.driven
        stopping = accelerations(model, partner.speed, to_area, np.zeros(shape))
        rate = np.where(blocked, np.minimum(free, stopping), free)
        beyond = ego.driven - seen.to_area[:, None]
        follows = first & seen.merging[:, None] & (beyond >= 0)
        gap = to_area + beyond - seen.length[:, None]
        following = accelerations(model, partner.speed, gap, ego.speed)
        rate = np.where(follows, np.minimum(rate, following), rate)
        partner = _on(partner, rate)
        absent = _on(absent, _behind_leader(seen, model, absent, now))
    return np.maximum(absent.driven - partner.driven, 0.0)


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
        other_enters = np.maximum(seen.other_to_area, 0.0) / seen.other_speed
    return enters <= other_enters[:, None], _reached(path, seen.to_area + seen.through)


def _reached(path: list[_Driven], metres: Float64[np.ndarray, " moment"]) -> Metres:
    """Return the times at which drivers have gone some metres, s; infinite if they stand before."""
    times = np.full(path[0].driven.shape, np.inf)
    for step in range(len(path) - 1, -1, -1):
        left = metres[:, None] - path[step].driven
        speed = path[step].speed
        at = step * _DT + np.maximum(left, 0.0) / np.maximum(speed, 1e-9)
        last = step == len(path) - 1
        passed = (left <= 0) | (path[min(step + 1, len(path) - 1)].driven >= metres[:, None])
        times = np.where(passed | (last & (speed > 0)), np.minimum(times, at), times)
    return times
