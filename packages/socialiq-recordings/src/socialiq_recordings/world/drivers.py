"""Traffic that recordings show, and the population of drivers that is calibrated on it.

Each parameter of the IDM and of gap acceptance has a normal distribution, clipped to an interval; a
driver draws its own when it enters. What the recording shows too rarely keeps the value of the
literature, and says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from socialiq.types import Row
from socialiq.worlds.highway.populations import Normal
from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.measures import gaps, pet
from socialiq_recordings.conflicts.ways import Way, leader, on_way
from socialiq_recordings.idm import Idm, acceleration
from socialiq_recordings.idm import calibrate as fitted
from socialiq_recordings.world.lines import curvature, line_of

_MOVING = 2.0  # m/s
_STANDING = 0.5  # m/s
_FREE = 4.0  # s; a leader further ahead does not bind
_STEADY = 1.5  # m/s; largest difference of speeds in steady following
_CURVED = 1 / 80  # 1/m; sharper ways are curves
_AHEAD = 60.0  # m; further leaders are not followed
_SECOND = 1.0  # s between the moments


class Followed(NamedTuple):
    """Moments at which a vehicle follows another."""

    speed: Float64[np.ndarray, " moment"]  # m/s
    gap: Float64[np.ndarray, " moment"]  # between bumpers, m
    leader_speed: Float64[np.ndarray, " moment"]  # m/s
    acceleration: Float64[np.ndarray, " moment"]  # of the next second, m/s²


class Observed(NamedTuple):
    """Quantities of the traffic of some recordings."""

    speeds: Float64[np.ndarray, " moment"]  # of all vehicles at all moments, m/s
    # fastest of each vehicle without leader or curve, m/s
    free_speeds: Float64[np.ndarray, " vehicle"]
    # median gap by speed of each vehicle that follows steadily, s
    headways: Float64[np.ndarray, " vehicle"]
    # median gap of each vehicle that stands behind another, m
    standing_gaps: Float64[np.ndarray, " vehicle"]
    lateral: Float64[np.ndarray, " moment"]  # v² κ in curves, m/s²
    followed: Followed  # moments of following
    pets: Float64[np.ndarray, " conflict"]  # post-encroachment times of conflicts, s
    accepted: Float64[np.ndarray, " conflict"]  # gaps and lags accepted, s
    vehicles: int  # number of vehicles


def observe(every: Sequence[Encounters], counted: Sequence[set[int]]) -> Observed:
    """Return what some recordings show.

    Args:
        every: Encounters of each recording.
        counted: Numbers of the tracks of each recording that count. A conflict counts if one of its
            two vehicles does.

    Returns:
        The quantities of all recordings together, of each vehicle at one moment a second.
    """
    names = {*Observed._fields, *Followed._fields} - {"followed", "vehicles"}
    rows: dict[str, list[float]] = {name: [] for name in names}
    vehicles = 0
    for encounters, tracks in zip(every, counted, strict=True):
        for way in encounters.ways.values():
            if way.track in tracks:
                _vehicle(encounters, way, rows)
                vehicles += 1
        for meeting in encounters.meetings():
            if meeting.ego.track not in tracks and meeting.other.track not in tracks:
                continue
            if meeting.ego.track < meeting.other.track and np.isfinite(pet(meeting)):
                rows["pets"].append(pet(meeting))
            if meeting.ego_first:
                accepted = gaps(encounters, meeting)
                rows["accepted"] += [seconds for seconds in accepted if np.isfinite(seconds)]
    arrays = {name: np.array(values, np.float64) for name, values in rows.items()}
    followed = Followed(*(arrays.pop(name) for name in Followed._fields))
    return Observed(**arrays, followed=followed, vehicles=vehicles)


def _vehicle(encounters: Encounters, way: Way, rows: dict[str, list[float]]) -> None:
    """Add the moments of a vehicle, one a second."""
    second = max(1, round(_SECOND / way.dt))
    bends = curvature(line_of(way))
    free = []
    headways = []
    standing = []
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
    rows["free_speeds"] += [float(np.max(free))] if free else []
    rows["headways"] += [float(np.median(headways))] if headways else []
    rows["standing_gaps"] += [float(np.median(standing))] if standing else []


LEAST = 10  # vehicles that must show a parameter before it is estimated
_LEAST_MOMENTS = 30  # following decisions for a fit of the IDM
_HEADWAYS = 0.4, 3.0  # s, bounds of a driver's value
_GAPS = 0.5, 6.0  # m, bounds of a driver's value
_STRENGTHS = (0.5, 4.0), (0.5, 5.0)  # m/s²; of acceleration and deceleration
_DEFAULT_SPREAD = 0.2  # relative, of what is not estimated
_SPREAD = 0.15  # relative, of both accelerations, which single drivers hardly show


class Drivers(NamedTuple):
    """Distributions that a driver's parameters are drawn from."""

    desired_speed: Normal  # m/s
    time_headway: Normal  # s
    jam_distance: Normal  # m, bumper to bumper
    max_acceleration: Normal  # m/s²
    comfort_deceleration: Normal  # m/s², positive
    margin: Normal  # s that a driver leaves between itself and a vehicle that has the right of way


@dataclass(frozen=True)
class Calibration:
    """Drivers of a recording, and on what they rest."""

    drivers: Drivers  # the population
    lateral: float  # largest lateral acceleration in curves, m/s²
    # for each parameter its mean and deviation, the number of vehicles or moments that show it, and
    # whether it was estimated
    evidence: tuple[Row, ...]
    rms: float  # error of the IDM with the means in following, m/s²; NaN without a fit
    rms_constant: float  # error of constant speed on the same moments, m/s²


def calibrate(observed: Observed) -> Calibration:
    """Estimate a population of drivers from what recordings show.

    Desired speeds are the fastest of each vehicle without a leader or a curve, time headways those
    of steady following, jam distances those of standing vehicles: medians, and spreads between
    quartiles. Both accelerations minimise the error of the next acceleration in following; a fit
    that is worse than constant speed is no evidence and is dropped. The margin is the lower
    quartile of post-encroachment times.
    """
    defaults = Idm()
    followed = observed.followed
    bends = observed.lateral
    speed, speeds = _normal(observed.free_speeds, defaults.desired_speed, (3.0, 45.0))
    jam, jams = _normal(observed.standing_gaps, defaults.jam_distance, _GAPS)
    # The IDM keeps the jam distance besides the time headway.
    moving = followed.speed[followed.speed > _MOVING]
    beyond = jam.mean / float(np.median(moving)) if len(moving) else 0.0
    headway, headways = _normal(observed.headways - beyond, defaults.time_headway, _HEADWAYS)
    strengths, rms, constant = _fit(followed, (headway.mean, jam.mean), speed.mean, defaults)
    strong, comfort = (
        Normal(mean, _SPREAD * mean, *bounds)
        for mean, bounds in zip(strengths, _STRENGTHS, strict=True)
    )
    pets = observed.pets[(observed.pets > 0) & (observed.pets < 5)]
    mean = 1.5
    if len(pets) >= LEAST:
        mean = float(np.clip(np.quantile(pets, 0.25), 0.5, 4.0))
    margin = Normal(mean, 0.3 * mean, 0.4 * mean, 1.6 * mean)
    lateral = 2.5
    if len(bends) >= LEAST:
        lateral = float(np.clip(np.quantile(bends, 0.85), 1.0, 4.0))
    drivers = Drivers(speed, headway, jam, strong, comfort, margin)
    moments = len(followed.gap)
    counts = [speeds, headways, jams, moments, moments, len(pets)]
    estimated = [count >= LEAST for count in counts]
    estimated[3] = estimated[4] = bool(rms < constant)
    evidence = tuple(
        {"parameter": name, "mean": normal.mean, "deviation": normal.deviation}
        | {"seen": count, "estimated": is_estimated}
        for name, normal, count, is_estimated in zip(
            Drivers._fields, drivers, counts, estimated, strict=True
        )
    )
    return Calibration(drivers, lateral, evidence, rms, constant)


def _normal(
    values: Float64[np.ndarray, " vehicle"], default: float, bounds: tuple[float, float]
) -> tuple[Normal, int]:
    """Return a normal distribution of median and interquartile range, and the number of values."""
    middle = default
    deviation = _DEFAULT_SPREAD * default
    if len(values) >= LEAST:
        low, middle, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist()
        deviation = (high - low) / 1.349
    middle = float(np.clip(middle, *bounds))
    deviation = min(deviation, 0.5 * middle)
    low = max(middle - 2 * deviation, bounds[0])
    high = min(middle + 2 * deviation, bounds[1])
    return Normal(middle, deviation, low, high), len(values)


def _fit(
    followed: Followed, spacing: tuple[float, float], desired: float, defaults: Idm
) -> tuple[tuple[float, float], float, float]:
    """Return a and b with the least error of the next acceleration, and both errors.

    `spacing` is T and s0, which steady following and standing vehicles show directly: a fit of all
    four trades them for each other where signals, which it doesn't know, brake a leader. With too
    few moments the defaults stay.
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
    strongest, comfort = fitted(error, start, (low, high)).tolist()
    rms = float(np.sqrt(np.mean(error(np.array([strongest, comfort])) ** 2)))
    constant = float(np.sqrt(np.mean(followed.acceleration**2)))
    if rms >= constant:
        return start, rms, constant
    return (strongest, comfort), rms, constant
