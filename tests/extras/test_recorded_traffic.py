"""Recordings of our own simulator, written as other programs write them, read back, and used.

The tracks must be the simulator's, and the commands on recordings take them. This needs the extra
`maps`.
"""

import itertools
import json

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

from benchmarks.recordings import write_csv

from socialiq.cli.main import main
from socialiq.demonstrations import files as demonstration_files
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH
from socialiq.worlds.intersection.core.geometry import LEFT, RIGHT, STRAIGHT
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq_recordings import files, simulated
from socialiq_recordings.export import write_commonroad
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.readers.commonroad_road import road_of
from socialiq_recordings.readers.csv_recording import read_csv
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Conflict, lanes_of
from socialiq_recordings.world.build import build
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.replay import replay

DRIVERS = ("gap_3s", "random", "go", "stop_line", "gap_2s")
DESTINATIONS = ("left", "straight", "right")


@pytest.fixture(scope="module")
def episodes():
    """Fifteen episodes: five drivers, three destinations."""
    cases = itertools.product(DRIVERS, DESTINATIONS)
    return [
        simulated.record(
            Options(canonical=True, destination=destination), policy(driver), 100 + number
        )
        for number, (driver, destination) in enumerate(cases)
    ]


@pytest.fixture(scope="module")
def busy():
    """Two episodes with more traffic, in which the ego stops at the line."""
    options = Options(canonical=True)
    return [simulated.record(options, policy("stop_line"), seed) for seed in (3, 7)]


def check_equal(back, recording, atol=1e-9):
    for name in ("track", "frame", "identity"):
        np.testing.assert_array_equal(getattr(back.tracks, name), getattr(recording.tracks, name))
    for name in ("x", "y", "vx", "vy", "length", "width"):
        columns = getattr(back.tracks, name), getattr(recording.tracks, name)
        np.testing.assert_allclose(*columns, rtol=0, atol=atol)
    assert list(back.road.lanelets) == list(recording.road.lanelets)


def test_commonroad_there_and_back(episodes, tmp_path):
    for number, episode in enumerate(episodes[::3]):
        path = tmp_path / f"{number}.xml"
        write_commonroad(episode, path)
        check_equal(read_commonroad(path).recording, episode)


@pytest.mark.parametrize("layout", ["ind", "interaction"])
def test_csv_layouts_there_and_back(layout, episodes, tmp_path):
    """The tracks by CSV, the road by CommonRoad, as an import does it."""
    road = tmp_path / "road.xml"
    write_commonroad(episodes[0], road)
    for number, episode in enumerate(episodes[::5]):
        (tmp_path / str(number)).mkdir()
        path = write_csv(episode.tracks, layout, tmp_path / str(number))
        (back,) = read_csv(path, read_map(layout))
        check_equal(Recording(back.recording.tracks, road_of(road)), episode)


def test_ngsim_is_as_close_as_its_columns_allow(episodes, tmp_path):
    """It has no heading and the front's centre for a position, so both are estimates."""
    recording = episodes[0]
    path = write_csv(recording.tracks, "ngsim", tmp_path)
    (back,) = read_csv(path, read_map("ngsim"))
    off = np.hypot(
        back.recording.tracks.x - recording.tracks.x, back.recording.tracks.y - recording.tracks.y
    )
    assert np.median(off) < 0.01 and off.max() < VEHICLE_LENGTH / 2


def test_the_simulators_road_has_its_conflicts():
    lanes = lanes_of(simulated.road())
    assert len(set(lanes.junction_of.values())) == 1
    assert len(lanes.junction_of) == 12  # every way over it, no arm
    first = simulated.FIRST_LANELET

    def kind(one, other):
        pair = first + one, first + other
        return lanes.conflicts.get((min(pair), max(pair)))

    south, west = 0, 5
    assert kind(south + STRAIGHT, west + STRAIGHT) == Conflict.CROSSING
    assert kind(south + RIGHT, west + STRAIGHT) == Conflict.MERGING  # both leave to the east
    assert kind(south + LEFT, south + STRAIGHT) is None  # from one approach
    assert kind(south + STRAIGHT, 10 + STRAIGHT) is None  # oncoming
    assert kind(south + RIGHT, west + LEFT) is None
    # a way straight on crosses both of the cross road, a left turn from there and the oncoming one,
    # and leaves by the arm of a left and a right turn
    kinds = [found for pair, found in lanes.conflicts.items() if first + STRAIGHT in pair]
    assert (kinds.count(Conflict.CROSSING), kinds.count(Conflict.MERGING)) == (4, 2)


@pytest.fixture(scope="module")
def recorded(busy, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    paths = []
    for number, episode in enumerate(busy):
        paths.append(str(folder / f"{number}.safetensors"))
        files.save(folder / f"{number}.safetensors", episode)
    return paths


def test_the_mode_says_whether_drivers_are_simulated(busy):
    world = build([busy[0]], WorldConfig()).world
    table, as_human = replay(world).table, replay(world, as_human=True).table
    assert set(table.counts()) == {"human", "simulated"}
    assert table.counts()["human"] == as_human.counts()["simulated"] == (0, 0)


def test_from_recordings_to_a_policy(recorded, tmp_path, capsys):
    table = tmp_path / "human.safetensors"
    assert main(["data", "demonstrations", *recorded, "--out", str(table), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    made = demonstration_files.load(table)
    assert sum(row["decisions"] for row in told["recordings"]) == made.n_transitions
    assert told["episodes"] == made.n_episodes and told["residual_rms"] > 0
    world, same = tmp_path / "world.safetensors", tmp_path / "same.safetensors"
    call = ["data", "world", *recorded, "--out", str(world), "--demonstrations", str(same)]
    assert main(call) == 0
    assert same.read_bytes() == table.read_bytes()
    learn = ["--angle", "45", "--updates", "20", "--hidden", "8", "--set", "batch_size=8"]
    learn += ["--value-term", "value_expert", "--set", "timeout=bootstrap"]
    learn += ["--set", "target_kind=instantaneous"]
    assert main(["train", "iq-learn", str(table), *learn, "--out", str(tmp_path / "run")]) == 0
    assert (tmp_path / "run" / "policy_angle45.safetensors").exists()
    assert main(["data", "demonstrations", *recorded, "--out", str(table)]) == 2


def test_the_census_writes_its_folder(recorded, tmp_path, capsys):
    out = tmp_path / "census"
    assert main(["data", "census", *recorded, "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["population"]["drivers"] == len(told["drivers"]) > 5
    tables = {"drivers.csv", "recordings.csv", "road_users.csv"}
    names = {"census.png", "config.json", "summary.json"} | tables
    assert {path.name for path in out.iterdir()} == names
    assert main(["data", "census", *recorded, "--out", str(out)]) == 2
    capsys.readouterr()
    assert main(["data", "census", *recorded]) == 0
    assert "observed, not caused" in capsys.readouterr().out
