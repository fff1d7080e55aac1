"""Recordings of our own simulator, written as other programs write them, read back and annotated.

Observation, reward pair and ending must be the simulator's. This needs the extra `data`.
"""

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `data` is not installed")

from socialiq.cli.main import main
from socialiq.demonstrations import files as demonstration_files
from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.intersection.core.geometry import LEFT, RIGHT, STRAIGHT
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq_recordings import files, simulated
from socialiq_recordings.episodes.annotate import driven
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.ego_swap import demonstrations, episode_of, swap
from socialiq_recordings.episodes.scene import Scene
from socialiq_recordings.export import write_commonroad, write_csv
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.readers.commonroad_road import road_of
from socialiq_recordings.readers.csv_recording import read_csv
from socialiq_recordings.readers.motion import wrapped
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Conflict, RoadNetwork, lanes_of
from socialiq_recordings.tracks import RoadUser

SIMULATORS = EpisodeConfig(contact="predicted", clock=True)
DRIVERS = ("gap_3s", "random", "go", "stop_line", "gap_2s")
DESTINATIONS = ("left", "straight", "right")
TOLERANCE = 1e-5


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


def annotated(recording, ego, config=SIMULATORS):
    scene = Scene(recording)
    way = scene.crossing(ego, scene.junctions(ego)[0])
    assert way is not None
    found = driven(scene, ego, way, config)
    assert found is not None
    return found


def shows_its_way(recording, ego, episode):
    """Whether the ego drives far enough into the junction to be known to turn or to go on."""
    return episode.way in Scene(recording).matched(ego).lanelets


def check_equal(recording, ego, episode):
    """If the tracks don't show the way, progress is that of another turn's start."""
    found = annotated(recording, ego)
    atol = TOLERANCE if shows_its_way(recording, ego, episode) else 100 * TOLERANCE
    assert len(found.action) == len(episode.action)
    assert found.ending[-1] == episode.ending[-1]
    np.testing.assert_allclose(found.pair, episode.pair, rtol=0, atol=atol)
    np.testing.assert_allclose(found.observation, episode.observation, rtol=0, atol=TOLERANCE)


def test_the_tracks_alone_give_the_simulators_numbers(episodes):
    decisions, kinds = 0, set()
    hidden = 0
    for episode in episodes:
        check_equal(episode.recording, episode.ego, episode)
        hidden += not shows_its_way(episode.recording, episode.ego, episode)
        decisions += len(episode.action)
        kinds.add(Ending(int(episode.ending[-1])))
    assert decisions > 150
    assert hidden <= 2  # they stop just behind the line until the end
    assert kinds == {Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT}


def test_commonroad_there_and_back(episodes, tmp_path):
    for number, episode in enumerate(episodes[::3]):
        path = tmp_path / f"{number}.xml"
        write_commonroad(episode.recording, path)
        back = read_commonroad(path).recording
        identity = episode.recording.tracks.identity[episode.ego]
        ego = int(np.flatnonzero(back.tracks.identity == identity)[0])
        check_equal(back, ego, episode)


@pytest.mark.parametrize("layout", ["ind", "interaction"])
def test_csv_layouts_there_and_back(layout, episodes, tmp_path):
    """The tracks by CSV, the road by CommonRoad, as an import does it."""
    road = tmp_path / "road.xml"
    write_commonroad(episodes[0].recording, road)
    for number, episode in enumerate(episodes[::5]):
        (tmp_path / str(number)).mkdir()
        path = write_csv(episode.recording.tracks, layout, tmp_path / str(number))
        (back,) = read_csv(path, read_map(layout))
        recording = Recording(back.recording.tracks, road_of(road))
        identity = episode.recording.tracks.identity[episode.ego]
        ego = int(np.flatnonzero(recording.tracks.identity == identity)[0])
        check_equal(recording, ego, episode)


def test_ngsim_is_as_close_as_its_columns_allow(episodes, tmp_path):
    """It has no heading and the front's centre for a position, so both are estimates."""
    episode = episodes[0]
    path = write_csv(episode.recording.tracks, "ngsim", tmp_path)
    (back,) = read_csv(path, read_map("ngsim"))
    recording = Recording(back.recording.tracks, episode.recording.road)
    identity = episode.recording.tracks.identity[episode.ego]
    ego = int(np.flatnonzero(recording.tracks.identity == identity)[0])
    found = annotated(recording, ego)
    assert len(found.action) == len(episode.action)
    off = abs(found.pair - episode.pair)
    assert off[:, 0].max() < 0.1 and np.median(off) < 0.01


def test_our_file_there_and_back(episodes, tmp_path):
    files.save(tmp_path / "r.safetensors", episodes[0].recording)
    check_equal(files.load(tmp_path / "r.safetensors"), episodes[0].ego, episodes[0])


def test_the_simulators_road_has_its_conflicts():
    lanes = lanes_of(simulated.road())
    assert len(lanes.junctions) == 1
    junction = lanes.junctions[0]
    assert len(junction.lanelets) == 12  # every way over it, no arm
    assert (junction.x, junction.y) == pytest.approx((0.0, 0.0), abs=1e-9)
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
    mine = [found for pair, found in lanes.conflicts.items() if first + STRAIGHT in pair]
    assert (mine.count(Conflict.CROSSING), mine.count(Conflict.MERGING)) == (4, 2)


def test_all_vehicles_become_egos_and_everybody_else_has_a_reason(busy):
    found = swap(busy[0].recording)
    assert len(found.episodes) >= 3
    assert len(found.episodes) + sum(found.left_out.values()) == found.n_tracks
    assert len({one.track for one in found.episodes}) == len(found.episodes)
    assert found.identity == tuple(
        busy[0].recording.tracks.identity[one.track] for one in found.episodes
    )
    table = demonstrations([found])
    assert table.n_features == 70 and table.n_actions == 3
    own = table.observation.reshape(-1, 10, 7)[:, 0]
    starts = table.episode_starts
    # every ego comes from the south, heading north: y is positive, the sine -1
    assert (own[starts, 2] > 0).all()
    np.testing.assert_allclose(own[starts, 6], -1.0, atol=0.02)


def test_a_turned_and_moved_road_changes_nothing(episodes):
    episode = episodes[0]
    turned = _turned(episode.recording, 0.7, 1234.5, -987.6)
    check_equal(turned, episode.ego, episode)


def _turned(recording, angle, dx, dy):
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.array([[cos, -sin], [sin, cos]])
    tracks = recording.tracks
    x, y = matrix @ np.stack([tracks.x, tracks.y])
    vx, vy = matrix @ np.stack([tracks.vx, tracks.vy])
    heading = np.pi - (np.pi - tracks.heading - angle) % (2 * np.pi)
    moved = dataclasses.replace(tracks, x=x + dx, y=y + dy, vx=vx, vy=vy, heading=heading)
    lanelets = {
        number: dataclasses.replace(
            one, left=one.left @ matrix.T + (dx, dy), right=one.right @ matrix.T + (dx, dy)
        )
        for number, one in recording.road.lanelets.items()
    }
    return Recording(moved, RoadNetwork(lanelets))


def test_speed_may_be_lost_within_a_decision(episodes):
    """Summed falls are at least the loss from decision to decision."""
    for episode in episodes[:6]:
        summed = dataclasses.replace(SIMULATORS, loss="summed")
        found = annotated(episode.recording, episode.ego, summed)
        assert (
            found.signals[:, 7] >= annotated(episode.recording, episode.ego).signals[:, 7]
        ).all()


def test_a_higher_rate_gives_more_decisions(busy):
    slow, fast = (swap(busy[0].recording, EpisodeConfig(policy_rate=rate)) for rate in (1, 5))
    assert fast.n_transitions > 4 * slow.n_transitions


def test_pedestrians_and_unknown_vehicles_make_no_episode(busy):
    tracks = busy[0].recording.tracks
    users = tracks.road_user.copy()
    users[busy[0].ego] = RoadUser.PEDESTRIAN
    found = swap(Recording(dataclasses.replace(tracks, road_user=users), busy[0].recording.road))
    assert found.left_out["not a vehicle"] == 1
    far = dataclasses.replace(tracks, x=tracks.x + 500.0)
    found = swap(Recording(far, busy[0].recording.road))
    assert found.left_out == {"off the lanelets": tracks.n_tracks}
    with pytest.raises(UserError, match="makes no episode: off the lanelets"):
        episode_of(Recording(far, busy[0].recording.road), 1, EpisodeConfig())
    with pytest.raises(UserError, match="no road network"):
        swap(Recording(tracks, RoadNetwork()))


@pytest.fixture(scope="module")
def recorded(busy, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    paths = []
    for number, episode in enumerate(busy):
        paths.append(str(folder / f"{number}.safetensors"))
        files.save(folder / f"{number}.safetensors", episode.recording)
    return paths


def test_from_recordings_to_a_policy(recorded, tmp_path, capsys):
    table = tmp_path / "human.safetensors"
    assert main(["data", "demonstrations", *recorded, "--out", str(table), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    made = demonstration_files.load(table)
    assert sum(one["transitions"] for one in told["recordings"]) == made.n_transitions
    learn = ["--angle", "45", "--updates", "20", "--hidden", "8", "--batch-size", "8"]
    learn += ["--value-term", "value_expert", "--timeout", "bootstrap"]
    learn += ["--target-kind", "instantaneous"]
    assert main(["train", str(table), *learn, "--out", str(tmp_path / "run")]) == 0
    assert (tmp_path / "run" / "policy_0.safetensors").exists()
    assert main(["data", "demonstrations", *recorded, "--out", str(table)]) == 2


def test_the_census_writes_its_folder(recorded, tmp_path, capsys):
    out = tmp_path / "census"
    assert main(["data", "census", *recorded, "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["population"]["drivers"] == len(told["drivers"]) > 5
    names = {"census.png", "config.json", "drivers.csv", "posterior.csv", "recordings.csv"}
    names |= {"shrunken.csv", "summary.json"}
    assert {path.name for path in out.iterdir()} == names
    assert main(["data", "census", *recorded, "--out", str(out)]) == 2
    capsys.readouterr()
    assert main(["data", "census", *recorded]) == 0
    assert "observed, not caused" in capsys.readouterr().out


def mirrored(recording, name):
    """The recording of a place where people drive on the left: another site."""
    tracks, flip = recording.tracks, np.array([1.0, -1.0])
    lanelets = {
        number: dataclasses.replace(one, left=one.right * flip, right=one.left * flip)
        for number, one in recording.road.lanelets.items()
    }
    signs = {column: -getattr(tracks, column) for column in ("y", "heading", "vy")}
    signs["heading"] = wrapped(signs["heading"])
    return Recording(dataclasses.replace(tracks, **signs, recording=name), RoadNetwork(lanelets))


def test_agreement_holds_out_each_site(busy, recorded, tmp_path, capsys):
    out = tmp_path / "agreement"
    tiny = ["--updates", "20", "--hidden", "8", "--angle", "45"]
    assert main(["data", "agreement", *recorded, *tiny, "--out", str(out)]) == 2
    assert "all 2 recordings with one show" in capsys.readouterr().err
    files.save(tmp_path / "left.safetensors", mirrored(busy[1].recording, "left"))
    recorded = [*recorded, str(tmp_path / "left.safetensors")]
    assert main(["data", "agreement", *recorded, *tiny, "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [one["method"] for one in told["methods"]] == [
        "majority",
        "behaviour cloning",
        "IQ-Learn, 45°",
    ]
    assert told["finite"] and all(one["sites"] == 2 for one in told["methods"])


def test_a_log_audit_of_one_vehicle_decides_nothing(recorded, tmp_path, capsys):
    profile = tmp_path / "profile.toml"
    declare = ["profile", "new", "--world", "intersection", "--angle", "45"]
    assert main([*declare, "--degrees", "60", "--out", str(profile)]) == 0
    told = swap(files.load(Path(recorded[0]))).identity
    capsys.readouterr()
    ask = ["data", "audit", recorded[0], "--track", str(told[0]), "--profile", str(profile)]
    assert main([*ask, "--json"]) in (1, 3)
    assert json.loads(capsys.readouterr().out)["episodes"] == 1
    assert main(ask) in (1, 3)
    assert "Not tested: regret" in capsys.readouterr().out
    assert main([*ask[:4], "99", *ask[5:]]) == 2
    assert "no vehicle 99" in capsys.readouterr().err
