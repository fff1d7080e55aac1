"""Pedestrians' walking speeds, waits, compliance with lights and accepted gaps, for a model."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float64

from socialiq.types import Row
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import area_of, shapely

STANDS = 0.3  # m/s; who is slower stands
RUNS = 2.1  # m/s; where people change from walking (Hreljac 1993, Med. Sci. Sports Exerc. 25, 1158)
KERB = 3.0  # m from the edge of the lanelets to either side, since maps and people err
SPEED = "walking speed, m/s"
RUNNING = "runs, share"
GAP = "gap or lag accepted, s"
AT_KERB = "stood at the kerb, s"
WAITED = "of these 1 s or more, s"
ON_ROAD = "stood on the road, s"
ON_GREEN = "steps onto the road on green, share"
GREEN = "green, share of time"
_LEAST = 1.0  # s that a pedestrian must walk for a speed, and stand for a wait


def pedestrians(recordings: Sequence[Recording], conflicts: Sequence[Row]) -> list[Row]:
    """Return a row for each quantity of each recording with pedestrians, and of all of them.

    Args:
        recordings: Recordings; those without pedestrians have no rows.
        conflicts: Rows of `measures.rows_of`, for the gaps and lags that pedestrians accepted.

    Returns:
        Rows by recording, and last of all together (`recording` is "all") if there are two or more.
        `number` counts pedestrians, or conflicts for accepted gaps, or recordings for the share of
        green time; it is 0 for a quantity that no recording shows. `low` and `high` are the
        quantiles of 15 and 85 %.
    """
    values: dict[str, defaultdict[str, list[float]]] = {}
    for recording in recordings:
        of_recording = defaultdict[str, list[float]](list)
        for name, value in _measured(recording):
            of_recording[name].append(value)
        if of_recording:
            values[recording.tracks.recording] = of_recording
    for row in conflicts:
        gap = row["lag_accepted"] if row["gap_accepted"] is None else row["gap_accepted"]
        if gap is not None and row["ego_class"] == "pedestrian":
            values.setdefault(row["recording"], defaultdict(list))[GAP].append(gap)
    quantities = (SPEED, RUNNING, AT_KERB, WAITED, ON_ROAD, ON_GREEN, GREEN, GAP)
    if len(values) > 1:
        each = tuple(values.values())
        sums = {name: [value for of in each for value in of[name]] for name in quantities}
        values["all"] = defaultdict(list, sums)
    rows: list[Row] = []
    for recording, of_recording in values.items():
        for name in quantities:
            every = of_recording[name]
            row: Row = {"recording": recording, "quantity": name, "number": len(every)}
            row |= {"mean": statistics.fmean(every) if every else None}
            row |= {"deviation": statistics.stdev(every) if len(every) > 1 else None}
            ends = np.quantile(every, [0.15, 0.5, 0.85]).tolist() if every else [None] * 3
            rows.append(row | dict(zip(("low", "median", "high"), ends, strict=True)))
    return rows


def _measured(recording: Recording) -> Iterator[tuple[str, float]]:
    """Yield each quantity that a pedestrian of a recording shows, and its value."""
    tracks = recording.tracks
    starts = recording.tracks.starts
    walkers = np.flatnonzero(tracks.road_user == RoadUser.PEDESTRIAN).tolist()
    if not walkers:
        return
    inside = _inside(recording)
    green = _green(tracks)
    if green is not None:
        yield GREEN, float(green[int(tracks.frame.min()) :].mean())
    speeds = np.hypot(tracks.vx, tracks.vy)
    for rows in (slice(*starts[track : track + 2]) for track in walkers):
        depth = inside[rows]
        speed = speeds[rows]
        moves = speed >= STANDS
        walked = speed[moves & ~(depth <= 0.0)]  # anywhere in the view if there are no lanelets
        if len(walked) * tracks.dt >= _LEAST:
            yield RUNNING, float(walked.mean() > RUNS)
            if walked.mean() <= RUNS:
                yield SPEED, float(walked.mean())
        on_road = np.flatnonzero(depth > KERB)
        if not len(on_road):
            continue
        stands = ~moves & (np.arange(len(moves)) < on_road[-1])
        at_kerb = float((stands & (abs(depth) <= KERB)).sum() * tracks.dt)
        yield AT_KERB, at_kerb
        if at_kerb >= _LEAST:
            yield WAITED, at_kerb
        yield ON_ROAD, float((stands & (depth > KERB)).sum() * tracks.dt)
        if green is not None and on_road[0]:
            yield ON_GREEN, float(green[tracks.frame[rows][on_road[0]]])


def _inside(recording: Recording) -> Float64[np.ndarray, " state"]:
    """Return how far each state is inside the lanelets' edge, m; NaN if there are none."""
    tracks = recording.tracks
    library = shapely()
    if not recording.road.lanelets:
        return np.full(tracks.n_states, np.nan)
    road = library.union_all([area_of(lanelet) for lanelet in recording.road.lanelets.values()])
    places = library.points(tracks.x, tracks.y)
    distance = library.distance(road.boundary, places)
    return np.where(library.contains(road, places), distance, -distance)


def _green(tracks: Tracks) -> Bool[np.ndarray, " frame"] | None:
    """Return whether the pedestrians' lights are green, by frame; None if it is not known.

    The files don't say which light is for which crossing, so that all must show the same.
    """
    lights = tracks.source.get("lights", {})
    of_walkers = [changes for name, changes in lights.items() if "pedestrian" in name.lower()]
    if not any(of_walkers) or any(changes != of_walkers[0] for changes in of_walkers):
        return None
    frames, colours = zip(*of_walkers[0], strict=True)
    last = np.searchsorted(frames, np.arange(int(tracks.frame.max()) + 1), side="right") - 1
    return (np.array(colours) == "green")[last] & (last >= 0)
