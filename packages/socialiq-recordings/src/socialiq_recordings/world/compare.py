"""Simulated traffic next to the recorded: the same starts, durations and measures; pictures."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from matplotlib.figure import Figure

from socialiq.physics import wrapped
from socialiq.plotting.style import COLORS, figure, finish
from socialiq.types import Row
from socialiq.worlds.highway.options import settings_of
from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.plausible import overlaps
from socialiq_recordings.recording import Recording, Tracks
from socialiq_recordings.road.routes import Scene
from socialiq_recordings.world.batch import records_of
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


def simulate(built: Made, seed: int, repeats: int = 1) -> Observed:
    """Return what simulated traffic shows from the recorded starts, as long as was recorded.

    Every vehicle is a driver of the population, a new one in each repeat. Vehicles that count once
    in the recordings count once here.

    Args:
        built: World, and what it was made from.
        seed: Seed of the drivers of the first repeat; each further repeat has the next number.
        repeats: Number of simulations of each recording.

    Returns:
        The quantities of all simulations together.
    """
    every = []
    counted = []
    for recording, tracks, ways, _ in _simulated(built, seed, repeats):
        scene = Scene(Recording(tracks, built.every[recording].scene.lanes.road))
        every.append(built.every[recording].moved(scene, ways))
        counted.append({ways[track].track for track in built.kept[recording] if track in ways})
    return observe(every, counted)


def contacts(built: Made, seed: int, repeats: int = 1) -> Row:
    """Return the number of simulated `vehicles`, and of `pairs_in_contact` that overlap.

    No vehicle of these simulations is an ego, whose contacts alone end episodes. Vehicles are
    smaller by the world's `slack` than recorded, as for an ego.

    Args:
        built: World, and what it was made from.
        seed: Seed of the drivers of the first repeat; each further repeat has the next number.
        repeats: Number of simulations of each recording.

    Returns:
        These counts, and the depth of the deepest overlap of two vehicles' rectangles,
        `deepest_contact`, m. Where people were recorded, also their number, `people`, and that of
        vehicles that touch one, `hit_a_person`.
    """
    vehicles = 0
    pairs = 0
    hits = 0
    deepest = 0.0
    for _, tracks, _, hit in _simulated(built, seed, repeats):
        slack = built.world.config.slack
        length, width = (np.maximum(side - slack, 0.1) for side in (tracks.length, tracks.width))
        met = overlaps(dataclasses.replace(tracks, length=length, width=width))
        vehicles = vehicles + tracks.n_tracks
        hits = hits + hit
        pairs += len({*zip(tracks.track[met.first], tracks.track[met.second], strict=True)})
        deepest = max(deepest, float(met.depth.max(initial=0.0)))
    counts: Row = {"vehicles": vehicles, "pairs_in_contact": pairs, "deepest_contact": deepest}
    people = len(built.world.road.person_class)
    return counts | ({"people": people * repeats, "hit_a_person": hits} if people else {})


def _simulated(
    built: Made, seed: int, repeats: int
) -> Iterator[tuple[int, Tracks, dict[int, Way], int]]:
    """Yield each recording's number, what `_moved` returns of a simulation as long as it, and hits.

    Hits are vehicles that touch a person.
    """
    for repeat in range(repeats):
        for recording, encounters in enumerate(built.every):
            frame = encounters.scene.tracks.frame
            dt = encounters.scene.tracks.dt
            seconds = (int(frame.max()) - int(frame.min())) * dt
            steps = int(seconds * SUB_STEPS + 1e-6) + 1
            states, hits = run(built.world, recording, steps, seed + repeat)
            moved = _moved(encounters, states)
            if moved is not None:
                yield recording, *moved, hits


def run(
    world: RecordedWorld, recording: int, steps: int, seed: int
) -> tuple[Float64[np.ndarray, "step vehicle 2"], int]:
    """Return coordinates and speeds of a recording's vehicles, all simulated.

    Args:
        world: World of the recordings.
        recording: Number of the recording in it.
        steps: Number of sub-steps, from the recording's first frame.
        seed: Seed of the drivers.

    Returns:
        Coordinates on the ways, m, and speeds, m/s, NaN while a vehicle is not on the road; and the
        number of vehicles that touch a person.
    """
    from socialiq.worlds.highway.core.compile import run_in_parts
    from socialiq_recordings.world import core

    records = records_of(world, 1)
    records[0]["state_low"] = seed
    states = np.full((1, steps, world.capacity, 2), np.nan)
    road = world.road, records, np.array([recording])
    settings = settings_of(world.options), world.config.slack
    run_in_parts(core.without_ego, 1, 1, *road, states, steps, *settings)
    first = world.road.recording_first
    vehicles = int(first[recording + 1] - first[recording])
    return states[0, :, :vehicles], int(records[0]["others_hit"][0])


def _moved(
    encounters: Encounters, states: Float64[np.ndarray, "step vehicle 2"]
) -> tuple[Tracks, dict[int, Way]] | None:
    """Return the tracks of simulated states, and the way of each recorded track that has states."""
    ways: dict[int, Way] = {}
    columns: list[dict[str, Any]] = []
    for index, way in enumerate(encounters.ways.values()):
        there = np.flatnonzero(np.isfinite(states[:, index, 0]))
        if len(there) < 2:
            continue
        along, speed = states[there, index].T.copy()
        track = len(ways)
        moved = {"track": track, "first": int(there[0]), "along": along, "speed": speed}
        ways[way.track] = dataclasses.replace(way, **moved, dt=1 / SUB_STEPS)
        points, heading = way.line.points_at(along)
        columns.append(
            {"track": np.full(len(there), track, np.int32)}
            | {"frame": there.astype(np.int32), "x": points[:, 0], "y": points[:, 1]}
            | {"heading": -wrapped(-heading)}
            | {"vx": speed * np.cos(heading), "vy": speed * np.sin(heading)}
        )
    if not ways:
        return None
    recorded = encounters.scene.tracks
    chosen = list(ways)
    tracks = Tracks(
        **{name: np.concatenate([column[name] for column in columns]) for name in columns[0]},
        identity=recorded.identity[chosen],
        road_user=recorded.road_user[chosen],
        length=recorded.length[chosen],
        width=recorded.width[chosen],
        dt=1 / SUB_STEPS,
        recording=recorded.recording,
        source={"made_by": "socialiq data world"},
    )
    return tracks, ways


def table(recorded: Observed, simulated: Observed) -> list[Row]:
    """Return quartiles of each quantity, recorded and simulated, and their distance.

    The distance is that of Kolmogorov and Smirnov, the largest difference of the distribution
    functions; moments of one vehicle are not independent, so that it has no p-value here.

    Args:
        recorded: Quantities of the recorded traffic.
        simulated: Quantities of the simulated traffic.

    Returns:
        A row for each of `QUANTITIES`: the number of values, quartiles and the distance; None
        without values.
    """
    rows: list[Row] = []
    for name in QUANTITIES:
        samples = {"recorded": getattr(recorded, name), "simulated": getattr(simulated, name)}
        row: Row = {"quantity": name}
        for source, values in samples.items():
            row[f"{source}_n"] = len(values)
            quartiles = np.quantile(values, (0.25, 0.5, 0.75)) if len(values) else [np.nan] * 3
            for label, value in zip(("low", "median", "high"), quartiles, strict=True):
                row[f"{source}_{label}"] = float(value) if np.isfinite(value) else None
        rows.append(row | {"distance": distance(*samples.values())})
    return rows


def distance(
    first: Sequence[float] | np.ndarray, second: Sequence[float] | np.ndarray
) -> float | None:
    """Return the largest difference of two distribution functions; None if one has no value.

    Args:
        first: Values of one sample, in any order.
        second: Values of the second sample.

    Returns:
        The distance of Kolmogorov and Smirnov, in [0, 1].
    """
    if not len(first) or not len(second):
        return None
    every = np.sort(np.concatenate([first, second]))
    shares = [np.searchsorted(np.sort(v), every, side="right") / len(v) for v in (first, second)]
    return float(np.abs(shares[0] - shares[1]).max())


_INKS = {"recorded": COLORS["baseline"], "simulated": COLORS["prosocial"]}


def beside(recorded: Observed, simulated: Observed) -> Figure:
    """Draw distribution functions of each quantity, and gap by speed at moments of following.

    Args:
        recorded: Quantities of the recorded traffic.
        simulated: Quantities of the simulated traffic.
    """
    drawing = figure(9.5, 5.6)
    panels = drawing.subplots(2, 3).ravel()
    samples = {"recorded": recorded, "simulated": simulated}
    for axes, (name, label) in zip(panels, QUANTITIES.items(), strict=False):
        for source, observed in samples.items():
            values = np.sort(getattr(observed, name))
            if len(values):
                share = np.arange(1, len(values) + 1) / len(values)
                text = f"{source} (n = {len(values):,})"
                axes.step(values, share, where="post", color=_INKS[source], label=text)
        size = 8 if axes.lines else None  # nothing of this kind may have been seen
        finish(axes, "", size, xlabel=label, ylabel="share", ylim=(0, 1.02))
    for source, observed in samples.items():
        points = observed.followed.speed, observed.followed.gap
        style = {"markersize": 3, "color": _INKS[source], "alpha": 0.5, "label": source}
        panels[-1].plot(*points, ".", **style)
    labels = {"xlabel": "speed, m/s", "ylabel": "gap to the leader, m"}
    finish(panels[-1], "", 8, **labels, ylim=(0, 60))
    return drawing
