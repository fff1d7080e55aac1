"""Census of recorded drivers in the plane of the two rewards, with confidence regions.

A driver's point is the mean reward pair of a decision, over its episode; its angle is the
point's direction. This angle describes the events around a vehicle. It is neither the driver's
intention nor an angle for training a policy: see `LIMITS`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.errors import UserError
from socialiq.social.angle import DirectionInterval, angle_of, direction_interval
from socialiq.statistics.bootstrap import resample_rows
from socialiq.types import Ending, Row
from socialiq.worlds.highway.settings import SIGNALS
from socialiq_recordings.census_spread import Deconvolved, deconvolve
from socialiq_recordings.directions import Sector, sectors
from socialiq_recordings.episodes.ego_swap import Swapped, check_distinct

LIMITS = (
    "A neighbour's loss of speed was observed, not caused: it may have braked for "
    "somebody else, "  # codespell:ignore
    "for a signal, or for its own turn.",
    "Where the recording holds no signal states, waiting at a red light counts as yielding.",
    "A driver has few decisions. Who stands all the time has a narrow interval that says little: "
    "nothing changed.",
    "The intervals of single drivers take decisions as independent, which neighbouring seconds "
    "are not: true intervals are wider.",
    "Drivers of one recording meet each other; intervals over chains of recordings that share no "
    "vehicle allow for it, those over drivers do not.",
    "The spread of the angles behind the points takes them as one bell on the circle, with one "
    "covariance for all drivers; those who stand and those who move are rather two groups.",
    "An episode that leaves the field of view says nothing of what came after.",
)
"""Limits of the interpretation of a census."""

STANDING = 0.5
"""m/s; drivers with a lower mean speed stand, at a signal or in a queue."""

LEAST_DECISIONS = 3
"""Fewest decisions for an interval: a covariance in the plane needs three points."""


@dataclass(frozen=True)
class Driver:
    """Recorded driver.

    Attributes:
        recording: Name of the recording.
        identity: The vehicle's number in the file.
        decisions: Number of decisions of the episode.
        seconds: Duration of the episode.
        ending: "arrival", "collision", or "truncated" if it left the view.
        r_env: Mean of a decision.
        r_social: Mean of a decision.
        angle: Direction of the two, degrees; None if both are 0.
        low: Smallest direction of the confidence region, degrees; None if the region holds the
            origin, so that every direction is possible, or there are fewer than three decisions.
        high: Largest direction of the confidence region, degrees.
        speed: Mean at the ends of its decisions, m/s.
        yielding: Mean of the signal `yielding`, unweighted.
        disruption: Mean of the signal `disruption`, unweighted.
        residual: Root mean square of the residual of the inferred actions, m/s.
    """

    recording: str
    identity: int
    decisions: int
    seconds: float
    ending: str
    r_env: float
    r_social: float
    angle: float | None
    low: float | None
    high: float | None
    speed: float
    yielding: float
    disruption: float
    residual: float


@dataclass(frozen=True)
class Interval:
    """Estimate with a percentile interval, degrees; unwrapped around the estimate."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True)
class Population:
    """Statistics of all drivers, each counted once.

    Attributes:
        drivers: Number of drivers.
        vehicles: Number of different vehicles, where they are identified; else of drivers.
        recordings: Number of recordings with a driver.
        chains: Number of chains of recordings that share no vehicle.
        sites: Number of places, where they are identified; else 0.
        r_env: Mean of the drivers' points.
        r_social: Mean of the drivers' points.
        sd_env: Standard deviation of r_env of the drivers' points, including their noise.
        sd_social: Standard deviation of r_social of the drivers' points.
        over_drivers: Angle of the mean point, with resampled drivers.
        over_chains: The same, with resampled chains; None with fewer than two.
        standing: Drivers whose mean speed is below `STANDING`.
        of_the_moving: Angle of the mean point of the others, with resampled drivers, or None.
        circular_sd: Circular standard deviation of the drivers' angles, degrees.
        with_direction: Number of drivers whose angle has an interval.
        confidence: Of all intervals.
    """

    drivers: int
    vehicles: int
    recordings: int
    chains: int
    sites: int
    r_env: float
    r_social: float
    sd_env: float
    sd_social: float
    over_drivers: Interval
    over_chains: Interval | None
    standing: int
    of_the_moving: Interval | None
    circular_sd: float
    with_direction: int
    confidence: float


@dataclass(frozen=True)
class Census:
    """Result of a census.

    Attributes:
        drivers: Each driver.
        population: All drivers.
        posterior: Posterior of the drivers' angles, each driver counted once; empty if no driver
            has three decisions.
        spread: Population of the angles behind the drivers' points.
        spread_moving: The same of the drivers who move; None if none does.
    """

    drivers: tuple[Driver, ...]
    population: Population
    posterior: tuple[Sector, ...]
    spread: Deconvolved
    spread_moving: Deconvolved | None


def take(
    swapped: Sequence[Swapped], seed: int = 0, confidence: float = 0.95, resamples: int = 2000
) -> Census:
    """Take the census of some recordings.

    Args:
        swapped: Of the ego swap.
        seed: Of the resampling.
        confidence: Of all intervals.
        resamples: How many.

    Raises:
        UserError: If no vehicle meets a conflict, or a recording was given twice.
    """
    check_distinct(swapped)
    drivers = [
        _driver(each, place, confidence) for each in swapped for place in range(len(each.episodes))
    ]
    if not drivers:
        raise UserError(
            "no vehicle of these recordings meets a conflict, so there is no driver to count: "
            "`socialiq data demonstrations` lists the reasons"
        )
    population = _population(drivers, swapped, seed, confidence, resamples)
    pairs = [one.pair for each in swapped for one in each.episodes]
    moving = [
        (pair, driver.speed >= STANDING)
        for pair, driver in zip(pairs, drivers, strict=True)
        if len(pair) >= LEAST_DECISIONS and driver.angle is not None
    ]
    group = _chains(drivers, swapped)
    move = np.array([one.speed >= STANDING for one in drivers])
    return Census(
        tuple(drivers),
        population,
        sectors(moving, seed, resamples),
        _spread(pairs, group, np.ones(len(pairs), bool), seed, confidence),
        _spread(pairs, group, move, seed, confidence) if move.any() else None,
    )


def _spread(
    pairs: Sequence[Float64[np.ndarray, "_ 2"]],
    chain: Int64[np.ndarray, " driver"],
    chosen: Bool[np.ndarray, " driver"],
    seed: int,
    confidence: float,
) -> Deconvolved:
    """Return the population of the angles behind the points of some drivers."""
    some = [pair for pair, kept in zip(pairs, chosen.tolist(), strict=True) if kept]
    number = np.unique(chain[chosen], return_inverse=True)[1].astype(np.int64)
    return deconvolve(some, number, seed, confidence)


def _driver(swapped: Swapped, place: int, confidence: float) -> Driver:
    one = swapped.episodes[place]
    env, social = one.pair.mean(axis=0).tolist()
    found: DirectionInterval | None = None
    if len(one.pair) >= LEAST_DECISIONS:
        found = direction_interval(one.pair, confidence)
    ending = Ending(int(one.ending[-1]))
    return Driver(
        recording=swapped.recording,
        identity=swapped.identity[place],
        decisions=len(one.pair),
        seconds=len(one.pair) / swapped.config.policy_rate,
        ending="truncated" if ending == Ending.TIMEOUT else ending.name.lower(),
        r_env=env,
        r_social=social,
        angle=angle_of(env, social) if env or social else None,
        low=found.low if found else None,
        high=found.high if found else None,
        speed=float(one.speed[1:].mean()),
        yielding=float(one.signals[:, SIGNALS.index("yielding")].mean()),
        disruption=float(one.signals[:, SIGNALS.index("disruption")].mean()),
        residual=float(np.sqrt((one.residual**2).mean())),
    )


def _chains(drivers: Sequence[Driver], swapped: Sequence[Swapped]) -> Int64[np.ndarray, " driver"]:
    """Return the number of each driver's chain; a recording without one is its own."""
    chain = {one.recording: one.chain or one.recording for one in swapped}
    names = [chain[one.recording] for one in drivers]
    return np.unique(names, return_inverse=True)[1].astype(np.int64)


def _population(
    drivers: Sequence[Driver],
    swapped: Sequence[Swapped],
    seed: int,
    confidence: float,
    resamples: int,
) -> Population:
    points = np.array([[one.r_env, one.r_social] for one in drivers])
    group, used = _chains(drivers, swapped), [one for one in swapped if one.episodes]
    vehicles = {number for one in used for number in one.vehicle}
    known = np.radians([one.angle for one in drivers if one.angle is not None])
    count = int(group.max()) + 1
    sums = np.stack([np.bincount(group, points[:, axis]) for axis in range(2)], axis=1)
    sizes = np.bincount(group).astype(np.float64)
    spread = points.std(axis=0, ddof=1) if len(points) > 1 else np.full(2, np.nan)
    one_each = np.ones(len(points))
    mean = points.mean(axis=0)
    moving = np.array([one.speed >= STANDING for one in drivers])
    return Population(
        drivers=len(drivers),
        vehicles=len(vehicles) or len(drivers),
        recordings=len(used),
        chains=count,
        sites=len({one.site for one in used if one.site}),
        r_env=float(mean[0]),
        r_social=float(mean[1]),
        sd_env=float(spread[0]),
        sd_social=float(spread[1]),
        over_drivers=_interval(points, one_each, seed, confidence, resamples),
        over_chains=(_interval(sums, sizes, seed, confidence, resamples) if count > 1 else None),
        standing=int((~moving).sum()),
        of_the_moving=(
            _interval(points[moving], one_each[moving], seed, confidence, resamples)
            if moving.any()
            else None
        ),
        circular_sd=circular_sd(known),
        with_direction=sum(one.low is not None for one in drivers),
        confidence=confidence,
    )


def _interval(
    sums: Float64[np.ndarray, "unit 2"],
    sizes: Float64[np.ndarray, " unit"],
    seed: int,
    confidence: float,
    resamples: int,
) -> Interval:
    """Return the angle of the mean point with resampled units; deviations are wrapped."""
    angle = angle_of(*(sums.sum(axis=0) / sizes.sum()).tolist())
    means = [
        sums[rows].sum(axis=1) / sizes[rows].sum(axis=1, keepdims=True)
        for rows in resample_rows(len(sizes), resamples, seed)
    ]
    drawn = np.concatenate(means)
    deviations = np.degrees(np.arctan2(drawn[:, 1], drawn[:, 0])) - angle
    wrapped = (deviations + 180.0) % 360.0 - 180.0
    low, high = angle + np.quantile(wrapped, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Interval(angle, float(low), float(high))


def circular_sd(angles: Float64[np.ndarray, " driver"]) -> float:
    """Return the circular sd sqrt(-2 ln R) in degrees (Mardia & Jupp 2000, 2.3.11).

    Args:
        angles: rad.
    """
    if len(angles) == 0:
        return float("nan")
    length = float(np.hypot(np.cos(angles).mean(), np.sin(angles).mean()))
    return float(np.degrees(np.sqrt(-2 * np.log(min(length, 1.0))))) if length > 0 else float("inf")


def shrunken_rows(found: Census) -> list[Row]:
    """Return each driver's angle given the population, beside the angle of its mean point."""
    return [
        {
            "recording": one.recording,
            "identity": one.identity,
            "decisions": one.decisions,
            "shown": one.angle,
            **given._asdict(),
        }
        for one, given in zip(found.drivers, found.spread.drivers, strict=True)
    ]
