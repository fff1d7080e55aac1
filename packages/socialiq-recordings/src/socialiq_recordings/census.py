"""Census of recorded drivers in the plane of the two rewards, with confidence regions.

A driver's point is the mean reward pair of its replayed decisions (`world.replay`), and its angle
the point's direction. This angle describes the events around a vehicle. It is neither the driver's
intention nor an angle for training a policy: see `LIMITS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, finish
from socialiq.social.angle import angle_of, direction_interval, estimate_angle
from socialiq.types import Ending, Row
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

STANDING = 0.5  # m/s; drivers with a lower mean speed stand, at a signal or in a queue
LEAST_DECISIONS = 3
"""Fewest decisions for an interval: a covariance in the plane needs three points."""


def drivers_of(world: RecordedWorld, replayed: Replayed, confidence: float = 0.95) -> list[Row]:
    """Return a row for each driver of a world's replayed episodes, one for each vehicle.

    Args:
        world: World of the recordings.
        replayed: Its recorded vehicles' episodes.
        confidence: Probability of the confidence region, as 0.95.

    Returns:
        `recording` and the vehicle's number in it, `identity`; `decisions` and `seconds` of the
        episode; `ending`: "arrival", or "truncated" if it left the view; means of a decision:
        `r_env`, `r_social`, `speed` in m/s at its end, and the unweighted signals `yielding` and
        `disruption`; the direction of the two rewards, `angle`, degrees, None if both are 0; its
        smallest and largest in the confidence region, `low` and `high`, None if the region holds
        the origin, so that every direction is possible, or of fewer than three decisions; root mean
        square of what the levels of acceleration leave, `residual`, m/s.
    """
    table = replayed.table
    road = world.road
    names = [source["recording"] for source in world.provenance["recordings"]]
    drivers = []
    for vehicle, first, count in zip(
        replayed.vehicle.tolist(),
        table.episode_starts.tolist(),
        table.episode_lengths.tolist(),
        strict=True,
    ):
        rows = slice(first, first + count)
        pairs = np.stack([table.rewards.env[rows], table.rewards.social[rows]], axis=1)
        env, social = pairs.mean(axis=0).tolist()
        ends = direction_interval(pairs, confidence) if count >= LEAST_DECISIONS else None
        low, high = ends or (None, None)
        arrived = table.ending[first + count - 1] == Ending.ARRIVAL
        signals = dict(zip(SIGNALS, replayed.signals[rows].mean(axis=0).tolist(), strict=True))
        driver: Row = {
            "recording": names[np.searchsorted(road.recording_first, vehicle, side="right") - 1],
            "identity": int(road.identity[vehicle]),
            "decisions": count,
            "seconds": count / world.config.policy_rate,
            "ending": "arrival" if arrived else "truncated",
            "r_env": env,
            "r_social": social,
            "angle": angle_of(env, social) if env or social else None,
            "low": low,
            "high": high,
            "speed": float(replayed.speed[rows].mean()),
            "yielding": signals["yielding"],
            "disruption": signals["disruption"],
            "residual": float(np.sqrt((replayed.residual[rows] ** 2).mean())),
        }
        drivers.append(driver)
    return drivers


def population_of(
    drivers: Sequence[Row],
    identified: Identified,
    seed: int = 0,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Row:
    """Return the statistics of all drivers, each counted once.

    Args:
        drivers: Rows of `drivers_of`, one for each driver.
        identified: Chains and sites of the recordings.
        seed: Seed of the resampling.
        confidence: Probability of the intervals.
        resamples: Number of samples that are drawn for an interval.

    Returns:
        Numbers of `drivers`, of `recordings` with a driver, of `chains` of recordings that share no
        vehicle, and of `sites`; mean `r_env` and `r_social` of the drivers' points, and their
        standard deviations `sd_env` and `sd_social`, including noise; the angle of the mean point,
        degrees, with resampled drivers, `over_drivers`, and with resampled chains, `over_chains`,
        None with fewer than two; the number of those slower than `STANDING`, `standing`, and the
        angle of the drivers that are not, `of_the_moving`; circular standard deviation of the
        drivers' angles, `circular_sd`, degrees; number of drivers whose angle has an interval,
        `with_direction`; the `confidence`.
    """
    points = np.array([[driver["r_env"], driver["r_social"]] for driver in drivers])
    moving = np.array([driver["speed"] >= STANDING for driver in drivers])
    chain_of = dict(zip(identified.names, identified.chain, strict=True))
    site_of = dict(zip(identified.names, identified.site, strict=True))
    names = {driver["recording"] for driver in drivers}
    chains, chain = np.unique([chain_of[d["recording"]] for d in drivers], return_inverse=True)
    sums = np.stack([np.bincount(chain, points[:, axis]) for axis in range(2)], axis=1)

    def interval(vectors: Float64[np.ndarray, "unit 2"]) -> Row:
        """Return the angle of the mean vector with resampled units; a sum has the same angle."""
        result = estimate_angle(vectors[:, 0], vectors[:, 1], seed, confidence, resamples)
        return {"estimate": result.angle, "low": result.low, "high": result.high}

    deviation = points.std(axis=0, ddof=1) if len(points) > 1 else np.full(2, np.nan)
    angles = np.array([d["angle"] for d in drivers if d["angle"] is not None], np.float64)
    row: Row = {
        "drivers": len(drivers),
        "recordings": len(names),
        "chains": len(chains),
        "sites": len({site_of[name] for name in names}),
        "r_env": float(points[:, 0].mean()),
        "r_social": float(points[:, 1].mean()),
        "sd_env": float(deviation[0]),
        "sd_social": float(deviation[1]),
        "over_drivers": interval(points),
        "over_chains": interval(sums) if len(chains) > 1 else None,
        "standing": int((~moving).sum()),
        "of_the_moving": interval(points[moving]) if moving.any() else None,
        "circular_sd": circular_sd(np.radians(angles)),
        "with_direction": sum(driver["low"] is not None for driver in drivers),
    }
    return row | {"confidence": confidence}


def circular_sd(angles: Float64[np.ndarray, " driver"]) -> float:
    """Return the circular sd of angles in rad: sqrt(-2 ln R) in degrees (Mardia & Jupp 2000)."""
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
        drivers: Rows of `drivers_of`.
        population: The statistics of these drivers, as `population_of` returns them.

    Returns:
        Points of r_env and r_social on the left, angles with intervals, degrees, on the right.
    """
    drawing = figure(10.5, 4.8)
    left, right = drawing.subplots(1, 2, width_ratios=(1.25, 1.0))
    for ending, (mark, color, label) in _ENDINGS.items():
        for standing in (False, True):
            group = [
                driver
                for driver in drivers
                if driver["ending"] == ending and (driver["speed"] < STANDING) == standing
            ]
            if group:
                left.scatter(
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
    arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.6}
    tip = population["r_env"], population["r_social"]
    left.annotate("", xy=tip, xytext=(0.0, 0.0), arrowprops=arrow)
    unit = "chains" if population["over_chains"] else "drivers"
    interval = population[f"over_{unit}"]
    ends = f"{interval['low']:.0f}° to {interval['high']:.0f}°"
    share = f"{100 * population['confidence']:g} % over {unit}"
    text = f"mean: {interval['estimate']:.0f}° ({share}: {ends})"
    left.plot([], [], color="black", label=text)
    moving = population["of_the_moving"]
    if moving is not None and population["standing"]:
        left.plot([], [], " ", label=f"without those who stood: {moving['estimate']:.0f}°")
    counts = f"{population['drivers']} drivers of {population['chains']} chains"
    title = f"The mean point of {counts} lies at {interval['estimate']:.0f}°"
    names = {"xlabel": "mean r_env of a decision", "ylabel": "mean r_social of a decision"}
    finish(left, f"{title} (larger: more decisions)", 8, **names)
    directed = [driver for driver in drivers if driver["angle"] is not None]
    directed.sort(key=lambda driver: driver["angle"])
    for with_interval, color, size, label in (
        (False, "#b5b5b5", 4, "no interval"),
        (True, COLORS["prosocial"], 5, "with interval"),
    ):
        group = [(y, d) for y, d in enumerate(directed) if (d["low"] is not None) == with_interval]
        for y, driver in group if with_interval else []:
            right.plot([driver["low"], driver["high"]], [y, y], color="#9db8d9", linewidth=1.0)
        angles = [driver["angle"] for _, driver in group]
        heights = [y for y, _ in group]
        text = f"{label} ({len(group)})"
        right.plot(angles, heights, ".", color=color, markersize=size, label=text)
    names = {"xlabel": "direction of the driver's point, degrees", "ylabel": "drivers, by angle"}
    title = f"An interval exists for {len(group)} of {len(directed)} angles of single drivers"
    finish(right, title, 8, **names)
    return drawing
