"""Speed of importing recorded traffic, ours beside commonroad-io, and of finding its conflicts.

Two recordings are made up, so that no data set is needed, each state with the digits that real
files have: cars side by side, and cars that cross at each of some junctions. Reading, checking and
making the table are timed, in one process; conflicts from the imported recording to their rows.
commonroad-io needs an environment of its own; SOCIALIQ_COMMONROAD_PYTHON names its Python.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import os
import statistics
import subprocess
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.storage import write_atomically
from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.measures import rows_of
from socialiq_recordings.export import write_commonroad
from socialiq_recordings.readers import import_file
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork
from socialiq_recordings.road.routes import Scene

N_TRACKS, N_FRAMES = 60, 500
N_JUNCTIONS, N_CARS = 32, 20  # cars at each junction
LAYOUTS = ("ind", "interaction", "ngsim")

_PEER = """
import json, logging, sys, time
from commonroad.common.file_reader import CommonRoadFileReader
logging.disable(logging.CRITICAL)
begin = time.process_time()
scenario, _ = CommonRoadFileReader(sys.argv[1]).open()
seconds = time.process_time() - begin
states = sum(1 + len(one.prediction.trajectory.state_list) for one in scenario.dynamic_obstacles)
print(json.dumps({"seconds": seconds, "states": states}))
"""


def run(repeats: int) -> dict[str, Any]:
    """Import each format, `repeats` times.

    Returns:
        Median states per second of processor time by name, the peer's where there is one; seconds
        of the conflicts of the junctions for each second of their import, and their number; bytes
        of memory at the peak for each state, at one and at two times as many states.
    """
    python = os.environ.get("SOCIALIQ_COMMONROAD_PYTHON", "")
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        tracks = made_up(N_TRACKS)
        files = {"commonroad": _commonroad(tracks, Path(folder))}
        files |= {layout: write_csv(tracks, layout, Path(folder)) for layout in LAYOUTS}
        rates: dict[str, list[float]] = {name: [] for name in files}
        peer = []
        for _ in range(repeats):
            for name, path in files.items():
                rates[name].append(tracks.n_states / _seconds(name, path))
            if python:
                peer.append(_peer(python, files["commonroad"]))
        found |= {f"{name}_states_per_s": statistics.median(one) for name, one in rates.items()}
        if python:
            found["commonroad_io_states_per_s"] = statistics.median(peer)
            found["ratio"] = statistics.median(
                ours / theirs for ours, theirs in zip(rates["commonroad"], peer, strict=True)
            )
        measured = [_junctions(Path(folder)) for _ in range(repeats)]
        found["conflicts_per_import"] = statistics.median(ratio for ratio, _ in measured)
        found["conflicts"] = measured[0][1]
        for factor in (1, 2):
            larger = made_up(factor * N_TRACKS)
            path = _commonroad(larger, Path(folder))
            states = write_csv(larger, "ind", Path(folder))
            n = larger.n_states
            found[f"bytes_per_state_{n}"] = _peak("commonroad", path) / n
            found[f"csv_bytes_per_state_{n}"] = _peak("ind", states) / n
        found["file_bytes_per_state"] = path.stat().st_size / n
    return found | {"states": tracks.n_states, "repeats": repeats}


def made_up(n_tracks: int) -> Tracks:
    """Cars in lanes of their own whose speeds swing."""
    random = np.random.default_rng(0)
    track = np.repeat(np.arange(n_tracks, dtype=np.int32), N_FRAMES)
    frame = np.tile(np.arange(N_FRAMES, dtype=np.int32), n_tracks)
    phase = random.uniform(0, 6, n_tracks)[track] + frame / 40
    speed = 10 + np.sin(phase)
    made = frame - 4 * (np.cos(phase) - np.cos(phase - frame / 40))
    heading = np.full(len(track), 0.3)
    return Tracks(
        track=track,
        frame=frame,
        x=made * np.cos(0.3) - 5 * track * np.sin(0.3),
        y=made * np.sin(0.3) + 5 * track * np.cos(0.3),
        heading=heading,
        vx=speed * np.cos(heading),
        vy=speed * np.sin(heading),
        identity=np.arange(1, n_tracks + 1),
        road_user=np.zeros(n_tracks, np.int8),
        length=np.full(n_tracks, 4.5),
        width=np.full(n_tracks, 1.8),
        dt=0.1,
        recording="ZAM_Bench-1_1_T-1",
        source={"made_by": "benchmarks/recordings.py"},
    )


def junctions(n_junctions: int, n_cars: int) -> Recording:
    """Two streets that cross at each junction, and cars on them, the one 1.5 s after the other."""
    speed, half, apart = 12.0, 100.0, 400.0  # m/s; m of street before a junction; m between them
    frames = int(2 * half / speed / 0.1)
    car = np.repeat(np.arange(n_junctions * n_cars, dtype=np.int32), frames)
    since, junction, turn = np.tile(np.arange(frames), n_junctions * n_cars), car // n_cars, car % 2
    along = since * 0.1 * speed - half
    columns = made_up(1).arrays() | {
        "track": car,
        "frame": (since + 15 * (car % n_cars)).astype(np.int32),
        "x": along * (turn == 0) + junction * apart,
        "y": along * (turn == 1),
        "heading": turn * np.pi / 2,
        "vx": speed * (turn == 0),
        "vy": speed * (turn == 1),
        "identity": np.arange(1, n_junctions * n_cars + 1),
    }
    for name in ("road_user", "length", "width"):
        columns[name] = np.repeat(columns[name], n_junctions * n_cars)
    lanelets: dict[int, Lanelet] = {}
    for place in range(n_junctions):
        for street in range(2):
            ends = np.array([-half, -10.0, 10.0, half])
            for first, second in itertools.pairwise(ends.tolist()):
                number = 1_000_000 + len(lanelets)
                middle = np.zeros((20, 2))
                middle[:, street] = np.linspace(first, second, 20)
                middle[:, 0] += place * apart
                beside = 1.75 * np.array([-street, 1 - street])
                onwards = () if second == half else (number + 1,)
                before = () if first == -half else (number - 1,)
                lanelets[number] = Lanelet(
                    number, middle + beside, middle - beside, onwards, before
                )
    source = {"made_by": "benchmarks/recordings.py"}
    tracks = Tracks(**columns, dt=0.1, recording="ZAM_Junctions-1_1_T-1", source=source)
    return Recording(tracks, RoadNetwork(lanelets))


def _junctions(folder: Path) -> tuple[float, int]:
    """Return the time of conflicts for each second of the import, and the number of conflicts."""
    path = folder / "junctions.xml"
    write_commonroad(junctions(N_JUNCTIONS, N_CARS), path)
    begin = time.process_time()
    (imported,) = import_file(path)
    read = time.process_time()
    encounters = Encounters(Scene(imported.recording))
    rows = rows_of(encounters, encounters.meetings())
    return (time.process_time() - read) / (read - begin), len(rows) // 2


def _commonroad(tracks: Tracks, folder: Path) -> Path:
    path = folder / f"{tracks.n_tracks}.xml"
    write_commonroad(Recording(tracks, RoadNetwork()), path)
    return path


def _import(name: str, path: Path) -> None:
    if name == "commonroad":
        import_file(path)
    else:
        import_file(path, "csv", read_map(name))


def _seconds(name: str, path: Path) -> float:
    begin = time.process_time()
    _import(name, path)
    return time.process_time() - begin


def _peer(python: str, path: Path) -> float:
    clean = {name: one for name, one in os.environ.items() if not name.startswith("PYTHON")}
    command = [python, "-c", _PEER, str(path)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, env=clean)
    told = json.loads(done.stdout)
    return told["states"] / told["seconds"]


def _peak(name: str, path: Path) -> int:
    tracemalloc.start()
    _import(name, path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


FOOT = 0.3048  # length of a foot in m, exact by definition
_NGSIM_CLASSES = {RoadUser.MOTORCYCLE: 1, RoadUser.CAR: 2, RoadUser.TRUCK: 3, RoadUser.BUS: 3}
_INTERACTION_CLASSES = {RoadUser.PEDESTRIAN: "pedestrian/bicycle", RoadUser.BICYCLE: "bicycle"}

_Columns = Mapping[str, Iterable[object]]


def write_csv(tracks: Tracks, layout: str, folder: Path) -> Path:
    """Write tracks as the files of a data set; the column map of the same name reads them.

    Layouts: `ind` (three files), `interaction` and `ngsim` (10 Hz only; ngsim has no heading, no
    pedestrians and no bicycles, and calls a bus a truck). The folder must exist.

    Returns:
        The file with the states, the argument of an import.

    Raises:
        UserError: If the layout can't hold the tracks, or a file can't be written.
    """
    one_of("layout", layout, tuple(_LAYOUTS))
    name = "".join(
        character if character.isalnum() or character in "-._" else "-"
        for character in tracks.recording
    )
    if layout != "ind" and abs(tracks.dt - 0.1) > 1e-9:
        raise UserError(f"the {layout} layout has 10 frames a second, not {1 / tracks.dt:g}")
    files = _LAYOUTS[layout](tracks, [RoadUser(int(kind)) for kind in tracks.road_user])
    paths = [folder / pattern.format(name) for pattern in files]
    for path, columns in zip(paths, files.values(), strict=True):
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        lists = (c.tolist() if isinstance(c, np.ndarray) else c for c in columns.values())
        writer.writerows(zip(*lists, strict=True))
        write_atomically(path, text.getvalue())
    return paths[0]


def _ind(tracks: Tracks, kinds: list[RoadUser]) -> dict[str, _Columns]:
    starts, track = tracks.starts, tracks.track
    first, last = tracks.frame[starts[:-1]], tracks.frame[starts[1:] - 1]
    words = ["trailer" if kind == RoadUser.OTHER else kind.name.lower() for kind in kinds]
    states = {
        "recordingId": [0] * tracks.n_states,
        "trackId": tracks.identity[track],
        "frame": tracks.frame,
        "trackLifetime": np.arange(tracks.n_states) - starts[track],
        "xCenter": tracks.x,
        "yCenter": tracks.y,
        "heading": np.degrees(tracks.heading) % 360,
        "width": tracks.width[track],
        "length": tracks.length[track],
        "xVelocity": tracks.vx,
        "yVelocity": tracks.vy,
    }
    users = {
        "recordingId": [0] * tracks.n_tracks,
        "trackId": tracks.identity,
        "initialFrame": first,
        "finalFrame": last,
        "numFrames": last - first + 1,
        "width": tracks.width,
        "length": tracks.length,
        "class": words,
    }
    rate = {"recordingId": [0], "frameRate": [1 / tracks.dt]}
    names = "{}_tracks.csv", "{}_tracksMeta.csv", "{}_recordingMeta.csv"
    return dict(zip(names, (states, users, rate), strict=True))


def _interaction(tracks: Tracks, kinds: list[RoadUser]) -> dict[str, _Columns]:
    words = [_INTERACTION_CLASSES.get(kind, kind.name.lower()) for kind in kinds]
    states = {
        "track_id": tracks.identity[tracks.track],
        "frame_id": tracks.frame,
        "timestamp_ms": tracks.frame.astype(np.int64) * 100,
        "agent_type": [words[number] for number in tracks.track],
        "x": tracks.x,
        "y": tracks.y,
        "vx": tracks.vx,
        "vy": tracks.vy,
        "psi_rad": tracks.heading,
        "length": tracks.length[tracks.track],
        "width": tracks.width[tracks.track],
    }
    return {"vehicle_tracks_{}.csv": states}


def _ngsim(tracks: Tracks, kinds: list[RoadUser]) -> dict[str, _Columns]:
    absent = next((kind for kind in kinds if kind not in _NGSIM_CLASSES), None)
    if absent is not None:
        raise UserError(f"the ngsim layout has no class for {absent.name}: leave such tracks out")
    track, half = tracks.track, tracks.length[tracks.track] / 2
    states = {
        "Vehicle_ID": tracks.identity[track],
        "Frame_ID": tracks.frame,
        "Total_Frames": np.diff(tracks.starts)[track],
        "Global_Time": tracks.frame.astype(np.int64) * 100,
        "Local_X": (tracks.x + half * np.cos(tracks.heading)) / FOOT,
        "Local_Y": (tracks.y + half * np.sin(tracks.heading)) / FOOT,
        "v_Length": tracks.length[track] / FOOT,
        "v_Width": tracks.width[track] / FOOT,
        "v_Vel": np.hypot(tracks.vx, tracks.vy) / FOOT,
        "v_Class": [_NGSIM_CLASSES[kinds[number]] for number in track],
        "Location": [tracks.recording] * tracks.n_states,
    }
    return {"{}.csv": states}


_LAYOUTS: dict[str, Callable[[Tracks, list[RoadUser]], dict[str, _Columns]]] = {
    "ind": _ind,
    "interaction": _interaction,
    "ngsim": _ngsim,
}
