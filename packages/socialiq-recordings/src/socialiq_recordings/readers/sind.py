"""SinD: pedestrians, vehicles and traffic lights of one signalised junction, from its files.

Layout: Xu et al., "SIND: A drone dataset at signalized intersection in China" (ITSC 2022), and
`Format.md` of the publishers. `PREFIXPed_smoothed_tracks.csv`, `PREFIXVeh_smoothed_tracks.csv` and
a file of the lights with `light` in its name are in one folder.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import sha256_of_file
from socialiq.storage import open_csv
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.readers.csv_recording import read_csv
from socialiq_recordings.readers.csv_table import Table
from socialiq_recordings.readers.tracks import MOST_STATES
from socialiq_recordings.recording import ROAD_USERS, STATES, Imported, Recording, Tracks
from socialiq_recordings.road.network import Colour, RoadNetwork

PEDESTRIANS = "Ped_smoothed_tracks.csv"
VEHICLES = "Veh_smoothed_tracks.csv"
COLOURS = {0: Colour.RED, 1: Colour.GREEN, 3: Colour.YELLOW}
"""Colour of a light by the file's number."""

_RAW = 3  # frames of the video in a frame of the tracks
_FRAME = 1000 * _RAW / 29.97  # ms
_MOST_LIGHTS = 50
_MOST_CHANGES = 100_000


def read_sind(
    path: Path,
    most_states: int = MOST_STATES,
    road: RoadNetwork | None = None,
    stated: Mapping[str, Any] | None = None,
) -> Imported:
    """Read one recording: a file of pedestrians or of vehicles, and the files that belong to it.

    Lights stay as the files have them, by frame, in the provenance: `lights`, a list of frames and
    colours by the light's name. The files do not say which lanelets a light is for, so that no
    lanelet gets one, and they are counted as left out.

    Args:
        path: The file of pedestrians or of vehicles.
        most_states: Most rows that are read of each file.
        road: Road whose lanes give standing vehicles their heading; None for no road.
        stated: Entries that are added to the provenance.

    Raises:
        UserError: If the name is another, a file can't be read, or no track can be used.
    """
    ending = next((end for end in (PEDESTRIANS, VEHICLES) if path.name.endswith(end)), None)
    if ending is None:
        raise UserError(f"{path}: name the file of SinD that ends in {PEDESTRIANS} or {VEHICLES}")
    prefix = path.name.removesuffix(ending)
    beside = [path.with_name(prefix + end) for end in (PEDESTRIANS, VEHICLES)]
    files = [file for file in beside if file.exists()]
    columns = read_map("sind")
    read = [read_csv(file, columns, most_states, road, stated)[0] for file in files or [path]]
    imported = _together(*read) if len(read) > 1 else read[0]
    lights = sorted(
        file
        for file in path.parent.iterdir()
        if file.name.startswith(prefix) and "light" in file.name.lower() and file.suffix == ".csv"
    )
    name = one_line(prefix.strip("_- ") or path.absolute().parent.name, 60) or path.stem
    tracks = imported.recording.tracks
    source = dict(imported.recording.tracks.source)
    skipped = dict(imported.skipped)
    if len(lights) > 1:
        raise UserError(f"{path}: {len(lights)} files of lights are beside it: leave one there")
    for file in lights:
        source["lights"] = read_lights(file)
        source |= {"lights_file": file.name, "lights_sha256": sha256_of_file(file)}
        skipped["light without lanelets"] = len(source["lights"])
    tracks = replace(tracks, recording=name, source=source)
    return replace(imported, recording=Recording(tracks, imported.recording.road), skipped=skipped)


def read_lights(path: Path) -> dict[str, list[list[Any]]]:
    """Return the frames at which each light changes, and its colours from then on, by its name.

    Frames are those of the tracks; changes before the first are negative. Where a change has no
    time, the number of its video frame tells it.

    Raises:
        UserError: If it can't be read, has no light, or no change with a time.
    """
    with open_csv(path) as file:
        header = [name.strip() for name in file.readline(1 << 16).split(",")]
    names = [name for name in header if "light" in name.lower()]
    if not 0 < len(names) <= _MOST_LIGHTS:
        raise UserError(f"{path} has {len(names)} columns of lights, not 1 to {_MOST_LIGHTS}")
    table = Table(path, ",", _MOST_CHANGES)
    lights = {f"light {number}": name for number, name in enumerate(names)}
    table.read({"raw": "RawFrameID", "time": "timestamp(ms)", **lights}, frozenset(), frozenset())
    frames = table["time"] / _FRAME
    of_raw = table["raw"] / _RAW
    timed = np.isfinite(frames) & np.isfinite(of_raw)
    if not timed.any():
        raise UserError(f"{path}: no row has a frame and a time")
    shift = float(np.median((frames - of_raw)[timed]))
    frames = np.where(np.isfinite(frames), frames, of_raw + shift)
    changes: dict[str, list[list[Any]]] = {}
    for number, name in lights.items():
        rows = np.flatnonzero(np.isfinite(frames) & (np.abs(frames) < 2**31))
        every = zip(np.rint(frames[rows]).astype(int).tolist(), table[number][rows], strict=True)
        states = [(frame, COLOURS.get(value)) for frame, value in every]
        named = [[f, "unknown" if c is None else c.name.lower()] for f, c in states]
        changes[one_line(name, 60)] = [
            now
            for before, now in zip([[0, ""], *named], named, strict=False)
            if now[1] != before[1]
        ]
    return changes


def _together(first: Imported, second: Imported) -> Imported:
    """Return two recordings of one time and place as one; numbers that both have are replaced."""
    of = first.recording.tracks, second.recording.tracks
    every = (*STATES, *ROAD_USERS)
    columns = {name: np.concatenate([getattr(part, name) for part in of]) for name in every}
    columns["track"][of[0].n_states :] += of[0].n_tracks
    names = [
        {
            str(n): part.source.get("track_ids", {}).get(str(n), str(n))
            for n in part.identity.tolist()
        }
        for part in of
    ]
    numbers = of[1].identity
    if {*names[0]} & {*names[1]}:
        numbers = np.arange(len(numbers)) + int(of[0].identity.max()) + 1
        columns["identity"] = np.concatenate([of[0].identity, numbers])
    words = zip(numbers.tolist(), names[1].values(), strict=True)
    source = of[0].source | {"track_ids": names[0] | {str(n): word for n, word in words}}
    source["beside"] = {name: of[1].source[name] for name in ("file", "sha256")}
    tracks = Tracks(**columns, dt=of[0].dt, recording=of[0].recording, source=source)
    kinds = {*first.skipped} | {*second.skipped}
    counts = {kind: first.skipped.get(kind, 0) + second.skipped.get(kind, 0) for kind in kinds}
    return Imported(
        Recording(tracks, first.recording.road),
        first.refused + second.refused,
        counts,
        first.n_states + second.n_states,
        first.faults + second.faults,
    )
