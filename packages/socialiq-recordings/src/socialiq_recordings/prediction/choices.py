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
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.errors import UserError
from socialiq.physics import ballistic
from socialiq.types import RewardPair
from socialiq_recordings.prediction.following import accelerations, literature
from socialiq_recordings.prediction.situations import Situations

_SUM = 1e-6  # by which probabilities of a row may miss 1


@dataclass(frozen=True, eq=False)
class ChoiceTable:
    """Decisions of recorded drivers on a grid of accelerations.

    Raises:
        UserError: If columns don't fit together, or a number is not finite.
    """

    driver: Int64[np.ndarray, " decision"]  # number of the vehicle, one number over all recordings
    # number of the chain of recordings; different chains share no vehicle
    chain: Int64[np.ndarray, " decision"]
    time: Float64[np.ndarray, " decision"]  # s on the recording's clock; ascending within a driver
    # 0 in the first half of the driver's conflicts, 1 in the second: an angle is inferred from the
    # first and scored on the second
    half: Int64[np.ndarray, " decision"]
    # whether the driver and another vehicle are on course for one conflict area
    conflict: Bool[np.ndarray, " decision"]
    # accelerations to choose from, m/s², ascending and equally spaced
    grid: Float64[np.ndarray, " candidate"]
    # log-probability of each by the base predictor; a row's probabilities sum to 1
    log_base: Float64[np.ndarray, "decision candidate"]
    # what each brings the driver: seconds of its own travel time saved, against keeping its speed
    r_env: Float64[np.ndarray, "decision candidate"]
    # what each brings others: minus the seconds that they lose against the driver's absence
    r_social: Float64[np.ndarray, "decision candidate"]
    acceleration: Float64[np.ndarray, " decision"]  # observed mean of the next second, m/s²
    # observed minus expected acceleration of the driver's decision before, m/s²; 0 without one
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
        return len(self.driver)

    @property
    def chosen(self) -> Int64[np.ndarray, " decision"]:
        """Index of the acceleration of the grid that is closest to the observed one."""
        return nearest(self.grid, self.acceleration)

    def rows(self, mask: np.ndarray) -> ChoiceTable:
        """Return only the decisions of a mask, or of indices."""
        columns = {f.name: getattr(self, f.name)[mask] for f in fields(self) if f.name != "grid"}
        return replace(self, **columns)


def nearest(grid: Float64[np.ndarray, " candidate"], values: Any) -> Int64[np.ndarray, " decision"]:
    """Return the index of the closest of equally spaced, ascending accelerations, m/s²."""
    index = np.rint((np.asarray(values) - grid[0]) / (grid[1] - grid[0]))
    return np.clip(index, 0, len(grid) - 1).astype(np.int64)


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
