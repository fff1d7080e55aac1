"""Census of recorded drivers in the plane of the two rewards, with confidence regions.

A driver's point is the mean reward pair of its replayed decisions (`world.replay`), and its angle
the point's direction. This angle describes the events around a vehicle. It is neither the driver's
intention nor an angle for training a policy: see `LIMITS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, plain
from socialiq.social.angle import angle_of, direction_interval, estimate_angle
from socialiq.types import Ending
from socialiq.worlds.highway.options import SIGNALS
from socialiq_recordings.identity.identify import Identified
from socialiq_recordings.world.recorded_world import RecordedWorld
from socialiq_recordings.world.replay import Replayed

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
        ending: "arrival", or "truncated" if it left the view.
        r_env: Mean of a decision.
        r_social: Mean of a decision.
        angle: Direction of the two, degrees; None if both are 0.
        low: Smallest direction of the confidence region, degrees; None if the region holds the
            origin, so that every direction is possible, or there are fewer than three decisions.
        high: Largest direction of the confidence region, degrees.
        speed: Mean at the ends of its decisions, m/s.
        yielding: Mean of the signal `yielding`, unweighted.
        disruption: Mean of the signal `disruption`, unweighted.
        residual: Root mean square of what the levels of acceleration leave, m/s.
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
    """Angle with a percentile interval, degrees; unwrapped around the estimate."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True)
class Population:
    """Statistics of all drivers, each counted once.

    Attributes:
        drivers: Number of drivers.
        recordings: Number of recordings with a driver.
        chains: Number of chains of recordings that share no vehicle.
        sites: Number of places.
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


def drivers_of(
    world: RecordedWorld, replayed: Replayed, confidence: float = 0.95
) -> tuple[Driver, ...]:
    """Return the drivers of a world's replayed episodes.

    Args:
        world: The world.
        replayed: Its replay, one episode for each vehicle.
        confidence: Of all intervals.
    """
    table, road = replayed.table, world.road
    names = [source["recording"] for source in world.provenance["recordings"]]
    starts = table.episode_starts
    drivers = []
    for vehicle, first, count in zip(
        replayed.vehicle.tolist(), starts.tolist(), table.episode_lengths.tolist(), strict=True
    ):
        rows = slice(first, first + count)
        pairs = np.stack([table.rewards.env[rows], table.rewards.social[rows]], axis=1)
        env, social = pairs.mean(axis=0).tolist()
        region = direction_interval(pairs, confidence) if count >= LEAST_DECISIONS else None
        arrived = table.ending[first + count - 1] == Ending.ARRIVAL
        signals = replayed.signals[rows].mean(axis=0)
        drivers.append(
            Driver(
                recording=names[np.searchsorted(road.recording_first, vehicle, side="right") - 1],
                identity=int(road.identity[vehicle]),
                decisions=count,
                seconds=count / world.config.policy_rate,
                ending="arrival" if arrived else "truncated",
                r_env=env,
                r_social=social,
                angle=angle_of(env, social) if env or social else None,
                low=region.low if region else None,
                high=region.high if region else None,
                speed=float(replayed.speed[rows].mean()),
                yielding=float(signals[SIGNALS.index("yielding")]),
                disruption=float(signals[SIGNALS.index("disruption")]),
                residual=float(np.sqrt((replayed.residual[rows] ** 2).mean())),
            )
        )
    return tuple(drivers)


def population_of(
    drivers: Sequence[Driver],
    identified: Identified,
    seed: int = 0,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Population:
    """Return the statistics of all drivers.

    Args:
        drivers: At least one, of the same recordings.
        identified: Sites and chains of the recordings.
        seed: Of the resampling.
        confidence: Of all intervals.
        resamples: Number of resamples.
    """
    points = np.array([[driver.r_env, driver.r_social] for driver in drivers])
    moving = np.array([driver.speed >= STANDING for driver in drivers])
    chain_of = dict(zip(identified.names, identified.chain, strict=True))
    site_of = dict(zip(identified.names, identified.site, strict=True))
    names = {driver.recording for driver in drivers}
    chains, chain = np.unique([chain_of[d.recording] for d in drivers], return_inverse=True)
    sums = np.stack([np.bincount(chain, points[:, axis]) for axis in range(2)], axis=1)

    def interval(vectors: Float64[np.ndarray, "unit 2"]) -> Interval:
        """Return the angle of the mean vector with resampled units; a sum has the same angle."""
        result = estimate_angle(vectors[:, 0], vectors[:, 1], seed, confidence, resamples)
        return Interval(result.angle, result.low, result.high)

    deviation = points.std(axis=0, ddof=1) if len(points) > 1 else np.full(2, np.nan)
    return Population(
        drivers=len(drivers),
        recordings=len(names),
        chains=len(chains),
        sites=len({site_of[name] for name in names}),
        r_env=float(points[:, 0].mean()),
        r_social=float(points[:, 1].mean()),
        sd_env=float(deviation[0]),
        sd_social=float(deviation[1]),
        over_drivers=interval(points),
        over_chains=interval(sums) if len(chains) > 1 else None,
        standing=int((~moving).sum()),
        of_the_moving=interval(points[moving]) if moving.any() else None,
        circular_sd=circular_sd(np.radians([d.angle for d in drivers if d.angle is not None])),
        with_direction=sum(driver.low is not None for driver in drivers),
        confidence=confidence,
    )


def circular_sd(angles: Float64[np.ndarray, " driver"]) -> float:
    """Return the circular sd sqrt(-2 ln R) in degrees (Mardia & Jupp 2000, 2.3.11).

    Args:
        angles: rad.
    """
    if len(angles) == 0:
        return float("nan")
    length = float(np.hypot(np.cos(angles).mean(), np.sin(angles).mean()))
    return float(np.degrees(np.sqrt(-2 * np.log(min(length, 1.0))))) if length > 0 else float("inf")


_ENDINGS = {
    "truncated": ("o", COLORS["prosocial"], "left the view"),
    "arrival": ("^", COLORS["altruistic"], "arrived"),
}


def picture(drivers: Sequence[Mapping[str, Any]], population: Mapping[str, Any]) -> Figure:
    """Draw the drivers' points, and their angles with intervals.

    Args:
        drivers: Rows of `drivers.csv`.
        population: `population` of `summary.json`.
    """
    drawing = figure(10.5, 4.8)
    left, right = drawing.subplots(1, 2, width_ratios=(1.25, 1.0))
    _points(left, drivers, population)
    _angles(right, drivers)
    return drawing


def _points(axes: Any, drivers: Sequence[Mapping[str, Any]], population: Mapping[str, Any]) -> None:
    plain(axes)
    axes.axhline(0.0, color="#aaaaaa", linewidth=0.8)
    axes.axvline(0.0, color="#aaaaaa", linewidth=0.8)
    for ending, (mark, color, label) in _ENDINGS.items():
        for standing in (False, True):
            group = [
                driver
                for driver in drivers
                if driver["ending"] == ending and (driver["speed"] < STANDING) == standing
            ]
            if group:
                axes.scatter(
                    [driver["r_env"] for driver in group],
                    [driver["r_social"] for driver in group],
                    s=[8.0 + 6.0 * driver["decisions"] for driver in group],
                    marker=mark,
                    facecolors="none" if standing else color,
                    edgecolors=color,
                    alpha=0.6,
                    linewidths=0.9,
                    label=f"{label}{', stood all the time' if standing else ''} ({len(group)})",
                )
    tip = population["r_env"], population["r_social"]
    arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.6}
    axes.annotate("", xy=tip, xytext=(0.0, 0.0), arrowprops=arrow)
    interval = population["over_chains"] or population["over_drivers"]
    unit = "chains" if population["over_chains"] else "drivers"
    share = f"{100 * population['confidence']:g} %"
    ends = f"{interval['low']:.0f}° to {interval['high']:.0f}°"
    text = f"mean: {interval['estimate']:.0f}° ({share} over {unit}: {ends})"
    axes.plot([], [], color="black", label=text)
    moving = population["of_the_moving"]
    if moving is not None and population["standing"]:
        axes.plot([], [], " ", label=f"without those who stood: {moving['estimate']:.0f}°")
    axes.set_xlabel("mean r_env of a decision")
    axes.set_ylabel("mean r_social of a decision")
    counts = f"{population['drivers']} drivers of {population['chains']} chains of recordings"
    axes.set_title(f"{counts} (larger: more decisions)", fontsize=10)
    axes.legend(loc="best", fontsize=8)


def _angles(axes: Any, drivers: Sequence[Mapping[str, Any]]) -> None:
    plain(axes)
    ordered = sorted(
        (driver for driver in drivers if driver["angle"] is not None),
        key=lambda driver: driver["angle"],
    )
    for height, driver in enumerate(ordered):
        if driver["low"] is not None:
            ends = [driver["low"], driver["high"]]
            axes.plot(ends, [height, height], color="#9db8d9", linewidth=1.0)
    sure = np.array([driver["low"] is not None for driver in ordered], bool)
    angle, height = np.array([driver["angle"] for driver in ordered]), np.arange(len(ordered))
    for mask, color, size, label in (
        (~sure, "#b5b5b5", 4, "no interval"),
        (sure, COLORS["prosocial"], 5, "with interval"),
    ):
        text = f"{label} ({int(mask.sum())})"
        axes.plot(angle[mask], height[mask], ".", color=color, markersize=size, label=text)
    axes.set_xlabel("direction of the driver's point, degrees")
    axes.set_ylabel("drivers, by angle")
    axes.set_title("Angles of single drivers, with the intervals that exist", fontsize=10)
    axes.legend(loc="upper left", fontsize=8)
