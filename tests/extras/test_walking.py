"""Pedestrians who cross two lanes of 3.5 m from the south, with known waits and lights."""

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

from socialiq_recordings.conflicts.walking import pedestrians
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork


def north(metres):
    return np.array([[-20.0, metres], [20.0, metres]])


ROAD = RoadNetwork({n: Lanelet(n, north(3.5 * n), north(3.5 * n - 3.5)) for n in (1, 2)})


def walker(speed, stands):
    """From 2 m before the edge: 1 m, a stand of some frames, and 13 m on; y and speeds."""
    speeds = np.repeat([speed, 0.0, speed], [round(10 / speed), stands, round(130 / speed)])
    return -2.0 + np.cumsum(speeds) / 10, speeds


def recording(name, walkers, lights=()):
    lengths = [len(y) for y, _ in walkers]
    y, vy = (np.concatenate(column) for column in zip(*walkers, strict=True))
    tracks = Tracks(
        track=np.repeat(np.arange(len(walkers)), lengths).astype(np.int32),
        frame=np.concatenate([np.arange(length) for length in lengths]).astype(np.int32),
        x=np.zeros(len(y)),
        y=y,
        heading=np.full(len(y), np.pi / 2),
        vx=np.zeros(len(y)),
        vy=vy,
        identity=np.arange(len(walkers)),
        road_user=np.full(len(walkers), RoadUser.PEDESTRIAN, np.int8),
        length=np.full(len(walkers), 0.5),
        width=np.full(len(walkers), 0.6),
        dt=0.1,
        recording=name,
        source={"lights": dict(lights)} if lights else {},
    )
    return Recording(tracks, ROAD)


GREEN_FROM_100 = [[0, "red"], [100, "green"]]
BOTH = {"Pedestrian light 1": GREEN_FROM_100, "Pedestrian light 2": GREEN_FROM_100}


def shown(recordings, conflicts=(), which=-1):
    table = pedestrians(recordings, conflicts)
    name = table[which]["recording"]
    return {row["quantity"]: row for row in table if row["recording"] == name}


def test_speeds_waits_and_the_light():
    # The third runs. The second is 3 m inside after 8 + 90 + 32 frames, the others before 100.
    walkers = [walker(1.0, 0), walker(1.25, 90), walker(2.5, 20)]
    table = shown([recording("a", walkers, BOTH.items())])
    speed = table["walking speed, m/s"]
    assert (speed["number"], speed["mean"]) == (2, pytest.approx(1.125))
    assert table["runs, share"]["mean"] == pytest.approx(1 / 3)
    kerb = table["stood at the kerb, s"]
    assert (kerb["number"], kerb["mean"]) == (3, pytest.approx(11 / 3))
    assert table["of these 1 s or more, s"]["number"] == 2
    assert table["stood on the road, s"]["mean"] == 0.0
    assert table["steps onto the road on green, share"]["mean"] == pytest.approx(1 / 3)
    assert table["green, share of time"]["mean"] == pytest.approx(1 - 100 / (8 + 90 + 104))


def test_lights_that_differ_are_not_used_and_all_recordings_are_summed():
    differ = BOTH | {"Pedestrian light 2": [[0, "green"]]}
    every = [recording("a", [walker(1.0, 0)], differ.items()), recording("b", [walker(1.5, 0)])]
    row = {"recording": "b", "ego_class": "pedestrian", "gap_accepted": None, "lag_accepted": 4.0}
    table = shown(every, [row])
    assert table["steps onto the road on green, share"]["number"] == 0
    speed, gap = table["walking speed, m/s"], table["gap or lag accepted, s"]
    assert (speed["recording"], speed["mean"]) == ("all", pytest.approx(1.25))
    assert (gap["number"], gap["mean"]) == (1, 4.0)


def test_without_pedestrians_there_is_no_row():
    empty = recording("a", [walker(1.0, 0)])
    empty.tracks.road_user[:] = RoadUser.BICYCLE
    assert pedestrians([empty], []) == []
