"""SinD's pedestrians and the Stanford Drone videos, where the environment names their folders.

What the files hold is counted from their rows by the standard library.
"""

import csv
import gzip
import math
import os
import statistics
from collections import Counter, defaultdict
from pathlib import Path

import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.measures import rows_of
from socialiq_recordings.conflicts.walking import pedestrians
from socialiq_recordings.conflicts.yielding import group_of, who_yields
from socialiq_recordings.readers import import_file
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.recording import Recording, RoadUser
from socialiq_recordings.road.network import RoadNetwork
from socialiq_recordings.road.routes import Scene

SIND = os.environ.get("SOCIALIQ_SIND_DATA", "")
DRONE = os.environ.get("SOCIALIQ_STANFORD_DRONE_DATA", "")
MAPS = {"Changchun": "Changchun_Pudong", "Chongqing": "NR_ll2", "Xian": "Xian_Shanglin"}
WALKERS = sorted(Path(SIND).glob("*__Ped_smoothed_tracks.csv")) if SIND else []
VIDEOS = sorted(Path(DRONE).glob("*_video*.csv*")) if DRONE else []
pytestmark = [
    pytest.mark.recorded,
    pytest.mark.skipif(not (SIND and DRONE), reason="SOCIALIQ_SIND_DATA or _STANFORD_DRONE_DATA"),
]


def rows_in(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def check_counts(imported, rows, name, kind):
    """Everybody in the file is in the tracks or named as refused, with every state."""
    users = Counter(who for _, who in {(row[name], row[kind]) for row in rows})
    tracks = imported.recording.tracks
    used = Counter(RoadUser(value).name.lower() for value in tracks.road_user.tolist())
    assert used + Counter(refused.road_user for refused in imported.refused) == users
    assert imported.n_states == len(rows) and not imported.faults
    names = tracks.source.get("track_ids", {})
    there = {names.get(str(number), str(number)) for number in tracks.identity.tolist()}
    assert there | {refused.identity for refused in imported.refused} == {row[name] for row in rows}


def test_all_files_are_there():
    assert (len(WALKERS), len(VIDEOS)) == (3, 20)


@pytest.mark.parametrize("path", WALKERS, ids=lambda path: path.name.split("__")[0])
def test_sind_is_read_and_its_pedestrians_are_measured(path):
    pytest.importorskip("lanelet2", reason="extra `lanelet2` is not installed")
    city = path.name.split("__")[0]
    road = path.with_name(f"{city}__{MAPS[city]}.osm")
    (imported,) = import_file(path, "sind", road=road)
    rows = rows_in(path)
    check_counts(imported, rows, "track_id", "agent_type")
    (lights,) = path.parent.glob(path.name.replace("Ped_smoothed_tracks", "*Light*"))
    columns = [name for name in rows_in(lights)[0] if "light" in name.lower()]
    assert imported.skipped == {"light without lanelets": len(columns)}
    shown = {row["quantity"]: row for row in pedestrians([imported.recording], [])}
    green = shown["green, share of time"]["number"]
    assert green == any("pedestrian" in name.lower() for name in columns)
    assert bool(shown["steps onto the road on green, share"]["number"]) == bool(green)
    assert shown["stood at the kerb, s"]["number"] > 0 == shown["gap or lag accepted, s"]["number"]
    # Without a map speeds are of the whole view.
    without = Recording(imported.recording.tracks, RoadNetwork())
    speed = {row["quantity"]: row for row in pedestrians([without], [])}["walking speed, m/s"]
    moving = defaultdict(list)
    for row in rows:
        moving[row["track_id"]].append(math.hypot(float(row["vx"]), float(row["vy"])))
    moving = [[v for v in every if v >= 0.3] for every in moving.values()]
    means = [statistics.fmean(every) for every in moving if len(every) >= 10]
    means = [mean for mean in means if mean <= 2.1]
    assert (speed["number"], speed["mean"]) == (len(means), pytest.approx(statistics.fmean(means)))


@pytest.mark.parametrize("path", VIDEOS, ids=lambda path: path.name.split(".")[0])
def test_a_drone_video_is_read_and_its_conflicts_are_found(path, tmp_path):
    unpacked = tmp_path / path.name.removesuffix(".gz")
    unpacked.write_bytes(gzip.decompress(path.read_bytes()))
    (imported,) = import_file(unpacked, "csv", read_map(str(path.with_name("sdd.toml"))))
    check_counts(imported, rows_in(unpacked), "id", "class")
    encounters = Encounters(Scene(imported.recording), everybody=True)
    rows = rows_of(encounters, encounters.meetings())
    groups = {frozenset(map(group_of, (row["ego_class"], row["other_class"]))) for row in rows}
    yielding = who_yields(rows)
    assert {frozenset((row["of"], row["to"])) for row in yielding} == groups
    assert 2 * sum(row["conflicts"] for row in yielding) == len(rows)
