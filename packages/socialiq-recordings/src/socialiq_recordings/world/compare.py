"""Simulated traffic beside the recorded: the same starts, durations and measures; pictures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from socialiq.plotting.style import COLORS, figure, finish
from socialiq.types import Row
from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.recording import Recording, Tracks
from socialiq_recordings.road.routes import Scene
from socialiq_recordings.world.batch import JunctionBatch, Traffic
from socialiq_recordings.world.build import Made
from socialiq_recordings.world.config import SUB_STEPS
from socialiq_recordings.world.drivers import Observed, observe
from socialiq_recordings.world.recorded_world import RecordedWorld

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
    every, counted = [], []
    for repeat in range(repeats):
        for number_of_recording, encounters in enumerate(made.every):
            states = run(made.world, number_of_recording, _steps(encounters), seed + repeat)
            moved = _moved(encounters, states)
            if moved is None:
                continue
            encounters_of, number = moved
            every.append(encounters_of)
            counted.append(
                {number[track] for track in made.kept[number_of_recording] if track in number}
            )
    return observe(every, counted)


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
    for index, way in enumerate(encounters.ways.values()):
        there = np.flatnonzero(np.isfinite(states[:, index, 0]))
        if len(there) < 2:
            continue
        along, speed = states[there, index].T.copy()
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
    states_of_all = {
        name: np.concatenate([column[name] for column in columns]) for name in columns[0]
    }
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
        recorded_values, simulated_values = getattr(recorded, name), getattr(simulated, name)
        row: Row = {"quantity": name}
        for source, values in (("recorded", recorded_values), ("simulated", simulated_values)):
            row[f"{source}_n"] = len(values)
            quartiles = np.quantile(values, (0.25, 0.5, 0.75)) if len(values) else [np.nan] * 3
            for label, value in zip(("low", "median", "high"), quartiles, strict=True):
                row[f"{source}_{label}"] = float(value) if np.isfinite(value) else None
        row["distance"] = distance(recorded_values, simulated_values)
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


_REACH = 50.0  # m around the ego
_INKS = {"recorded": COLORS["baseline"], "simulated": COLORS["prosocial"]}


def scene(batch: JunctionBatch, row: int = 0) -> Figure:
    """Draw a moment: all ways, the ego's way, vehicles, closed lines.

    Args:
        batch: The episodes.
        row: Number of the episode.
    """
    road, traffic = batch.world.road, batch.traffic
    recording = int(traffic.recording[row])
    base, end = (int(road.recording_first[recording + offset]) for offset in range(2))
    drawing = figure(5.0, 5.0)
    axes = drawing.subplots()
    lines = [road.line[road.line_first[v] : road.line_first[v + 1], :2] for v in range(base, end)]
    axes.add_collection(LineCollection(lines, colors="#d5d5d5", linewidths=1.0))
    ego = int(traffic.ego[row])
    axes.plot(*lines[ego].T, color=COLORS["egoistic"], linewidth=1.2)
    now = float(traffic.step[row]) / 10
    for slot in range(int(traffic.n_present[row])):
        vehicle = int(traffic.present[row, slot])
        ink = COLORS["egoistic"] if vehicle == ego else COLORS["prosocial"]
        x, y, heading = _place(lines[vehicle], float(traffic.along[row, vehicle]))
        size = float(road.length[base + vehicle]), float(road.width[base + vehicle])
        axes.add_patch(Polygon(_corners(x, y, heading, *size), color=ink, zorder=3))
        for at, begin, until in road.closed[
            road.closed_first[base + vehicle] : road.closed_first[base + vehicle + 1]
        ]:
            if begin <= now < until:
                _bar(axes, lines[vehicle], float(at))
    x, y, _ = _place(lines[ego], float(traffic.along[row, ego]))
    axes.set_aspect("equal")
    axes.set(xlim=(x - _REACH, x + _REACH), ylim=(y - _REACH, y + _REACH))
    finish(axes, f"{now:.1f} s", xlabel="m to the east", ylabel="m to the north")
    return drawing


def _place(line: np.ndarray, along: float) -> tuple[float, float, float]:
    piece = min(max(int(along), 0), len(line) - 2)
    step = line[piece + 1] - line[piece]
    x, y = (line[piece] + (along - piece) * step).tolist()
    return x, y, math.atan2(step[1], step[0])


def _corners(x: float, y: float, heading: float, length: float, width: float) -> np.ndarray:
    along = np.array([math.cos(heading), math.sin(heading)]) * length / 2
    left = np.array([-math.sin(heading), math.cos(heading)]) * width / 2
    return np.array([x, y]) + np.array([along + left, along - left, -along - left, left - along])


def _bar(axes: Any, line: np.ndarray, at: float) -> None:
    x, y, heading = _place(line, at)
    dx, dy = -1.6 * math.sin(heading), 1.6 * math.cos(heading)
    axes.plot([x - dx, x + dx], [y - dy, y + dy], color="black", linewidth=2.0, zorder=4)


def beside(recorded: Observed, simulated: Observed) -> Figure:
    """Draw the distribution function of each quantity, recorded and simulated.

    Args:
        recorded: What the recordings show.
        simulated: What simulated traffic shows from the same starts.
    """
    drawing = figure(9.5, 5.6)
    panels = drawing.subplots(2, 3).ravel()
    for axes, (name, label) in zip(panels, QUANTITIES.items(), strict=False):
        for source, observed in (("recorded", recorded), ("simulated", simulated)):
            values = np.sort(getattr(observed, name))
            if len(values):
                share = np.arange(1, len(values) + 1) / len(values)
                text = f"{source} (n = {len(values):,})"
                axes.step(values, share, where="post", color=_INKS[source], label=text)
        size = 8 if axes.lines else None  # nothing of this kind may have been seen
        finish(axes, "", size, xlabel=label, ylabel="share", ylim=(0, 1.02))
    _followed(panels[-1], recorded, simulated)
    return drawing


def _followed(axes: Any, recorded: Observed, simulated: Observed) -> None:
    """Draw gap by speed at the moments of following."""
    for source, observed in (("recorded", recorded), ("simulated", simulated)):
        moments = observed.followed
        axes.plot(
            moments.speed,
            moments.gap,
            ".",
            markersize=3,
            color=_INKS[source],
            alpha=0.5,
            label=source,
        )
    finish(axes, "", 8, xlabel="speed, m/s", ylabel="gap to the leader, m", ylim=(0, 60))
