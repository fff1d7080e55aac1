"""Traffic that recordings show, and the population of drivers that is calibrated on it.

Each parameter of the IDM and of gap acceptance has a normal distribution, clipped to an interval; a
driver draws its own when it enters. What the recording shows too rarely keeps the value of the
literature, and says so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.optimize import least_squares

from socialiq.types import Row
from socialiq.worlds.intersection.options import Normal
from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.measures import gaps, pet
from socialiq_recordings.conflicts.ways import Way, leader, on_way
from socialiq_recordings.physics import Idm, acceleration
from socialiq_recordings.world.lines import curvature, line_of

_MOVING = 2.0  # m/s
_STANDING = 0.5  # m/s
_FREE = 4.0  # s; a leader further ahead does not bind
_STEADY = 1.5  # m/s; largest difference of speeds in steady following
_CURVED = 1 / 80  # 1/m; sharper ways are curves
_AHEAD = 60.0  # m; further leaders are not followed
_SECOND = 1.0  # s between the moments


class Followed(NamedTuple):
    """Moments at which a vehicle follows another.

    Attributes:
        speed: m/s.
        gap: Between bumpers, m.
        leader_speed: m/s.
        acceleration: Of the next second, m/s².
    """

    speed: Float64[np.ndarray, " moment"]
    gap: Float64[np.ndarray, " moment"]
    leader_speed: Float64[np.ndarray, " moment"]
    acceleration: Float64[np.ndarray, " moment"]


class Observed(NamedTuple):
    """Quantities of the traffic of some recordings.

    Attributes:
        speeds: Of all vehicles at all moments, m/s.
        free_speeds: Fastest of each vehicle without leader or curve, m/s.
        headways: Median gap by speed of each vehicle that follows steadily, s.
        standing_gaps: Median gap of each vehicle that stands behind another, m.
        lateral: v² κ in curves, m/s².
        followed: Moments of following.
        pets: Post-encroachment times of conflicts, s.
        accepted: Gaps and lags accepted, s.
        vehicles: Number of vehicles.
    """

    speeds: Float64[np.ndarray, " moment"]
    free_speeds: Float64[np.ndarray, " vehicle"]
    headways: Float64[np.ndarray, " vehicle"]
    standing_gaps: Float64[np.ndarray, " vehicle"]
    lateral: Float64[np.ndarray, " moment"]
    followed: Followed
    pets: Float64[np.ndarray, " conflict"]
    accepted: Float64[np.ndarray, " conflict"]
    vehicles: int


def observe(every: Sequence[Encounters], kept: Sequence[set[int]]) -> Observed:
    """Return what some recordings show.

    Args:
        every: Encounters of each recording.
        kept: Tracks of each that count, so that a vehicle in two recordings counts once.
    """
    rows: dict[str, list[float]] = {
        name: []
        for name in (*Observed._fields, *Followed._fields)
        if name not in ("followed", "vehicles")
    }
    vehicles = 0
    for encounters, tracks in zip(every, kept, strict=True):
        for way in encounters.ways.values():
            if way.track in tracks:
                _vehicle(encounters, way, rows)
                vehicles += 1
        _conflicts(encounters, tracks, rows)
    arrays = {name: np.array(values, np.float64) for name, values in rows.items()}
    followed = Followed(*(arrays.pop(name) for name in Followed._fields))
    return Observed(**arrays, followed=followed, vehicles=vehicles)


def _vehicle(encounters: Encounters, way: Way, rows: dict[str, list[float]]) -> None:
    """Add the moments of a vehicle, one a second."""
    second = max(1, round(_SECOND / way.dt))
    bends = curvature(line_of(way))
    free, headways, standing = [], [], []
    for frame in range(way.first, way.last + 1, second):
        along, speed = way.state(frame)
        rows["speeds"].append(speed)
        bend = float(bends[min(int(along), len(bends) - 1)])
        ahead = leader(way, along, on_way(encounters.scene, way, frame, encounters.config.slack))
        if bend > _CURVED and speed > _MOVING:
            rows["lateral"].append(speed**2 * bend)
        elif ahead.gap > _FREE * speed and speed > _MOVING:
            free.append(speed)
        if not 0 < ahead.gap < _AHEAD:
            continue
        if speed > _MOVING and abs(speed - ahead.speed) < _STEADY and ahead.gap < _FREE * speed:
            headways.append(ahead.gap / speed)
        if speed < _STANDING and ahead.speed < _STANDING and ahead.gap < 10.0:
            standing.append(ahead.gap)
        if frame + second <= way.last and max(speed, ahead.speed) > _STANDING:
            rows["speed"].append(speed)
            rows["gap"].append(ahead.gap)
            rows["leader_speed"].append(ahead.speed)
            rows["acceleration"].append((way.state(frame + second)[1] - speed) / _SECOND)
    for name, values, best in (
        ("free_speeds", free, np.max),
        ("headways", headways, np.median),
        ("standing_gaps", standing, np.median),
    ):
        if values:
            rows[name].append(float(best(values)))


def _conflicts(encounters: Encounters, tracks: set[int], rows: dict[str, list[float]]) -> None:
    for meeting in encounters.meetings():
        if meeting.ego.track not in tracks and meeting.other.track not in tracks:
            continue
        if meeting.ego.track < meeting.other.track and np.isfinite(pet(meeting)):
            rows["pets"].append(pet(meeting))
        if meeting.ego_first:
            gap, lag = gaps(encounters, meeting)
            rows["accepted"] += [seconds for seconds in (gap, lag) if np.isfinite(seconds)]


LEAST = 10
"""Vehicles that must show a parameter before it is estimated."""

_LEAST_MOMENTS = 30  # following decisions for a fit of the IDM
_ERROR = 1.0  # m/s²; errors beyond count less than squared (soft L1)
_HEADWAYS, _GAPS = (0.4, 3.0), (0.5, 6.0)  # s, m; bounds of a driver's values
_STRENGTHS = (0.5, 4.0), (0.5, 5.0)  # m/s²; of acceleration and deceleration
_DEFAULT_SPREAD = 0.2  # relative, of what is not estimated
_SPREAD = 0.15  # relative, of both accelerations, which single drivers hardly show


class Drivers(NamedTuple):
    """Distributions that a driver's parameters are drawn from.

    Attributes:
        desired_speed: m/s.
        time_headway: s.
        jam_distance: m, bumper to bumper.
        max_acceleration: m/s².
        comfort_deceleration: m/s², positive.
        margin: s that a driver leaves between itself and a vehicle that has the right of way.
    """

    desired_speed: Normal
    time_headway: Normal
    jam_distance: Normal
    max_acceleration: Normal
    comfort_deceleration: Normal
    margin: Normal

    def array(self) -> Float64[np.ndarray, "parameter 4"]:
        """Return mean, deviation and bounds by parameter."""
        return np.array(self, np.float64)

    @staticmethod
    def of_array(rows: Float64[np.ndarray, "parameter 4"]) -> Drivers:
        """Return the distributions of `array`."""
        return Drivers(*(Normal(*row) for row in rows.tolist()))


@dataclass(frozen=True)
class Calibration:
    """Drivers of a recording, and on what they rest.

    Attributes:
        drivers: The population.
        lateral: Largest lateral acceleration in curves, m/s².
        evidence: For each parameter its mean and deviation, the number of vehicles or moments that
            it was estimated from, and whether it was estimated.
        rms: Error of the IDM with the means on the moments of following, m/s²; NaN without a fit.
        rms_constant: Error of constant speed on the same moments, m/s².
    """

    drivers: Drivers
    lateral: float
    evidence: tuple[Row, ...]
    rms: float
    rms_constant: float

    def as_header(self) -> dict[str, Any]:
        """Return the calibration as JSON, without the drivers."""
        header = dataclasses.asdict(self)
        header.pop("drivers")
        numbers = {name: float(header[name]) for name in ("rms", "rms_constant")}
        return header | {name: None if np.isnan(v) else v for name, v in numbers.items()}


def calibrate(observed: Observed) -> Calibration:
    """Estimate a population of drivers.

    Desired speeds are the fastest of each vehicle without a leader or a curve, time headways those
    of steady following, jam distances those of standing vehicles: medians, and spreads between
    quartiles. Both accelerations minimise the error of the next acceleration in following; a fit
    that is worse than constant speed says nothing and is dropped. The margin is the lower quartile
    of post-encroachment times.

    Args:
        observed: What the recordings show.
    """
    defaults = Idm()
    speed, speeds = _normal(observed.free_speeds, defaults.desired_speed, (3.0, 45.0))
    jam, jams = _normal(observed.standing_gaps, defaults.jam_distance, _GAPS)
    # The IDM keeps the jam distance besides the time headway.
    moving = observed.followed.speed[observed.followed.speed > _MOVING]
    beyond = jam.mean / float(np.median(moving)) if len(moving) else 0.0
    headway, headways = _normal(observed.headways - beyond, defaults.time_headway, _HEADWAYS)
    spacing = headway.mean, jam.mean
    strengths, rms, constant = _fit(observed.followed, spacing, speed.mean, defaults)
    moments = len(observed.followed.gap)
    fitted = bool(rms < constant)
    strong, comfort = (
        Normal(mean, _SPREAD * mean, *bounds)
        for mean, bounds in zip(strengths, _STRENGTHS, strict=True)
    )
    margin, margins = _margin(observed.pets)
    drivers = Drivers(speed, headway, jam, strong, comfort, margin)
    counts = [speeds, headways, jams, moments, moments, margins]
    estimated = [count >= LEAST for count in counts]
    estimated[3] = estimated[4] = fitted
    evidence = tuple(
        {"parameter": name, "mean": normal.mean, "deviation": normal.deviation}
        | {"seen": count, "estimated": bool(yes)}
        for name, normal, count, yes in zip(
            Drivers._fields, drivers, counts, estimated, strict=True
        )
    )
    return Calibration(drivers, _lateral(observed.lateral), evidence, rms, constant)


def _normal(
    values: Float64[np.ndarray, " vehicle"], default: float, bounds: tuple[float, float]
) -> tuple[Normal, int]:
    """Return a robust normal distribution within bounds, and the number of values.

    The median, and the interquartile range as a deviation; with few values the default.
    """
    middle, deviation = default, _DEFAULT_SPREAD * default
    if len(values) >= LEAST:
        low, middle, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
        deviation = (high - low) / 1.349
    middle = float(np.clip(middle, *bounds))
    deviation = min(deviation, 0.5 * middle)
    low = max(middle - 2 * deviation, bounds[0])
    high = min(middle + 2 * deviation, bounds[1])
    return Normal(middle, deviation, low, high), len(values)


def _margin(pets: Float64[np.ndarray, " conflict"]) -> tuple[Normal, int]:
    positive = pets[(pets > 0) & (pets < 5)]
    mean = float(np.clip(np.quantile(positive, 0.25), 0.5, 4.0)) if len(positive) >= LEAST else 1.5
    return Normal(mean, 0.3 * mean, 0.4 * mean, 1.6 * mean), len(positive)


def _lateral(values: Float64[np.ndarray, " moment"]) -> float:
    if len(values) < LEAST:
        return 2.5
    return float(np.clip(np.quantile(values, 0.85), 1.0, 4.0))


def _fit(
    followed: Followed, spacing: tuple[float, float], desired: float, defaults: Idm
) -> tuple[tuple[float, float], float, float]:
    """Return a and b with the least error of the next acceleration, and both errors.

    Args:
        followed: Moments of following.
        spacing: T and s0, which steady following and standing vehicles show directly: a fit of all
            four trades them for each other where signals, which it doesn't know, brake a leader.
        desired: v0, m/s.
        defaults: Where it begins, and what stays if there are too few moments.
    """
    start = defaults.max_acceleration, defaults.comfort_deceleration
    if len(followed.gap) < _LEAST_MOMENTS:
        return start, float("nan"), float("nan")
    target = np.maximum(desired, followed.speed + 0.5)

    def error(values: np.ndarray) -> np.ndarray:
        drivers = (target, *spacing, *values)
        modelled = acceleration(followed.speed, followed.gap, followed.leader_speed, *drivers)
        return modelled - followed.acceleration

    low, high = zip(*_STRENGTHS, strict=True)
    fit = least_squares(error, start, bounds=(low, high), loss="soft_l1", f_scale=_ERROR)
    rms = float(np.sqrt(np.mean(error(fit.x) ** 2)))
    constant = float(np.sqrt(np.mean(followed.acceleration**2)))
    if rms >= constant:
        return start, rms, constant
    return (float(fit.x[0]), float(fit.x[1])), rms, constant
