"""Simulated traffic beside the recorded: the same starts, the same duration, the same measures."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64

from socialiq.types import Row
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.routes import Scene
from socialiq_recordings.tracks import Tracks
from socialiq_recordings.world.build import Made
from socialiq_recordings.world.config import SUB_STEPS
from socialiq_recordings.world.observed import Observed, observe
from socialiq_recordings.world.recorded_world import RecordedWorld
from socialiq_recordings.world.state import Traffic

QUANTITIES = {
    "speeds": "speed, m/s",
    "headways": "time gap in steady following, s",
    "standing_gaps": "gap of standing vehicles, m",
    "pets": "post-encroachment time, s",
    "accepted": "gap or lag accepted, s",
}
"""Quantities that are compared, with their labels."""


def simulate(made: Made, seed: int, repeats: int = 1) -> Observed:
    """Return what simulated traffic shows from the recorded starts, as long as was recorded.

    Every vehicle is a driver of the population. Vehicles that count once in the recordings count
    once here.

    Args:
        made: World and recordings.
        seed: Of the first repeat's drivers.
        repeats: Times that each recording is simulated, with new drivers.
    """
    every, kept = [], []
    for repeat in range(repeats):
        for place, encounters in enumerate(made.every):
            states = run(made.world, place, _steps(encounters), seed + repeat)
            moved = _moved(encounters, states)
            if moved is None:
                continue
            found, number = moved
            every.append(found)
            kept.append({number[track] for track in made.kept[place] if track in number})
    return observe(every, kept)


def run(
    world: RecordedWorld, recording: int, steps: int, seed: int
) -> Float64[np.ndarray, "step vehicle 2"]:
    """Return coordinates and speeds of a recording's vehicles, all simulated; NaN: not there.

    Args:
        world: The world.
        recording: Number of the recording.
        steps: Sub-steps from its first frame.
        seed: Of the drivers.
    """
    from socialiq.worlds.highway.core.compile import run_in_parts
    from socialiq_recordings.world import core

    traffic = Traffic.of(world, 1)
    traffic.seed[0] = seed
    states = np.full((1, steps, world.capacity, 2), np.nan)
    arguments = world.road, traffic, np.array([recording]), states, steps
    run_in_parts(core.without_ego, 1, 1, *arguments)
    first = world.road.recording_first
    return states[0, :, : int(first[recording + 1] - first[recording])]


def _steps(encounters: Encounters) -> int:
    tracks = encounters.scene.tracks
    seconds = (int(tracks.frame.max()) - int(tracks.frame.min())) * tracks.dt
    return int(seconds * SUB_STEPS + 1e-6) + 1


def _moved(
    encounters: Encounters, states: Float64[np.ndarray, "step vehicle 2"]
) -> tuple[Encounters, dict[int, int]] | None:
    """Return the encounters of simulated states, and the new number of each track."""
    number: dict[int, int] = {}
    ways: dict[int, Way] = {}
    columns: list[dict[str, Any]] = []
    for place, way in enumerate(encounters.ways.values()):
        there = np.flatnonzero(np.isfinite(states[:, place, 0]))
        if len(there) < 2:
            continue
        along, speed = states[there, place].T.copy()
        number[way.track] = len(number)
        ways[way.track] = dataclasses.replace(
            way,
            track=number[way.track],
            first=int(there[0]),
            along=along,
            speed=speed,
            dt=1 / SUB_STEPS,
        )
        points, heading = way.line.points_at(along)
        columns.append(
            {"track": np.full(len(there), number[way.track], np.int32)}
            | {"frame": there.astype(np.int32), "x": points[:, 0], "y": points[:, 1]}
            | {"heading": np.pi - (np.pi - heading) % (2 * np.pi)}
            | {"vx": speed * np.cos(heading), "vy": speed * np.sin(heading)}
        )
    if not number:
        return None
    old, chosen = encounters.scene.tracks, list(number)
    states_of_all = {name: np.concatenate([one[name] for one in columns]) for name in columns[0]}
    tracks = Tracks(
        **states_of_all,
        identity=old.identity[chosen],
        road_user=old.road_user[chosen],
        length=old.length[chosen],
        width=old.width[chosen],
        dt=1 / SUB_STEPS,
        recording=old.recording,
        source={"made_by": "socialiq data world"},
    )
    scene = Scene(Recording(tracks, encounters.scene.lanes.road))
    return encounters.moved(scene, ways), number


def table(recorded: Observed, simulated: Observed) -> list[Row]:
    """Return quartiles of each quantity, recorded and simulated, and their distance.

    The distance is that of Kolmogorov and Smirnov, the largest difference of the distribution
    functions; moments of one vehicle are not independent, so that it has no p-value here.
    """
    rows: list[Row] = []
    for name in QUANTITIES:
        one, other = getattr(recorded, name), getattr(simulated, name)
        row: Row = {"quantity": name}
        for source, values in (("recorded", one), ("simulated", other)):
            row[f"{source}_n"] = len(values)
            quartiles = np.quantile(values, (0.25, 0.5, 0.75)) if len(values) else [np.nan] * 3
            for label, value in zip(("low", "median", "high"), quartiles, strict=True):
                row[f"{source}_{label}"] = float(value) if np.isfinite(value) else None
        row["distance"] = distance(one, other)
        rows.append(row)
    return rows


def distance(
    one: Sequence[float] | np.ndarray, other: Sequence[float] | np.ndarray
) -> float | None:
    """Return the largest difference of two distribution functions; None if one has no value."""
    if not len(one) or not len(other):
        return None
    every = np.sort(np.concatenate([one, other]))
    shares = [np.searchsorted(np.sort(v), every, side="right") / len(v) for v in (one, other)]
    return float(np.abs(shares[0] - shares[1]).max())
