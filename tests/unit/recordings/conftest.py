"""Small recordings made by hand: numbers that can be checked on paper."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.types import RewardPair
from socialiq_recordings.recording import Recording, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork, Sign


def straight(
    speeds: list[float], frames: int = 10, heading: float = 0.0, apart: float = 10.0, **fields: Any
) -> Tracks:
    """Road users side by side, each at its speed, in the direction of the heading, at 10 Hz."""
    n = len(speeds)
    track = np.repeat(np.arange(n, dtype=np.int32), frames)
    frame = np.tile(np.arange(frames, dtype=np.int32), n)
    speed = np.array(speeds)[track]
    made = speed * frame * 0.1
    east, north = np.cos(heading), np.sin(heading)
    beside = apart * track
    columns = {
        "track": track,
        "frame": frame,
        "x": made * east - beside * north,
        "y": made * north + beside * east,
        "heading": np.full(n * frames, heading),
        "vx": speed * east,
        "vy": speed * north,
        "identity": np.arange(n) + 100,
        "road_user": np.zeros(n, np.int8),
        "length": np.full(n, 4.5),
        "width": np.full(n, 1.8),
        "dt": 0.1,
        "recording": "ZAM_Straight-1_1_T-1",
        "source": {"made_by": "a test"},
    }
    return Tracks(**(columns | fields))


@pytest.fixture(name="straight")
def straight_fixture():
    return straight


@pytest.fixture
def road():
    """Two lanes side by side, one of them leading on to a third lanelet."""
    return RoadNetwork(
        {
            1: Lanelet(
                1,
                left=np.array([[0.0, 3.5], [50.0, 3.5]]),
                right=np.array([[0.0, 0.0], [50.0, 0.0]]),
                successors=(3,),
                adjacent_left=(2, False),
                speed_limit=13.5,
                sign=Sign.STOP,
                stop_line=np.array([[50.0, 0.0], [50.0, 3.5]]),
            ),
            2: Lanelet(
                2,
                left=np.array([[50.0, 3.5], [0.0, 3.5]]),
                right=np.array([[50.0, 7.0], [0.0, 7.0]]),
                adjacent_left=(1, False),
                sign=Sign.LIGHT,
            ),
            3: Lanelet(
                3,
                left=np.array([[50.0, 3.5], [60.0, 3.25], [70.0, 3.5]]),
                right=np.array([[50.0, 0.0], [60.0, -0.25], [70.0, 0.0]]),
                predecessors=(1,),
                adjacent_right=(7, True),
                speed_limit=8.0,
                sign=Sign.PRIORITY,
            ),
        }
    )


@pytest.fixture
def recording(road):
    """A car that drives, one that slides a little, a bus that stands."""
    tracks = straight([8.0, 9.0, 0.0], heading=0.3)
    kinds = np.array([0, 0, 2], np.int8)
    sliding = tracks.heading.copy()
    sliding[10:20] = np.array(0.35)
    return Recording(
        Tracks(**(tracks.arrays() | {"road_user": kinds, "heading": sliding}), **_rest(tracks)),
        road,
    )


def _rest(tracks: Tracks) -> dict[str, Any]:
    return {"dt": tracks.dt, "recording": tracks.recording, "source": tracks.source}


def same_road(one: RoadNetwork, other: RoadNetwork) -> None:
    """Every field of every lanelet, to the last bit."""
    assert list(one.lanelets) == list(other.lanelets)
    for mine, theirs in zip(one.lanelets.values(), other.lanelets.values(), strict=True):
        for name in ("left", "right", "stop_line"):
            a, b = getattr(mine, name), getattr(theirs, name)
            assert (a is None) == (b is None)
            if a is not None:
                np.testing.assert_array_equal(a, b)
        for name in ("identity", "successors", "predecessors", "adjacent_left", "adjacent_right"):
            assert getattr(mine, name) == getattr(theirs, name)
        assert mine.speed_limit == theirs.speed_limit and mine.sign == theirs.sign
        assert mine.cycle == theirs.cycle


@pytest.fixture(name="same_road")
def same_road_fixture():
    return same_road


@pytest.fixture
def human_table():
    """Two episodes of a recorded driver."""
    observation = np.random.default_rng(0).uniform(-1, 1, (5, 14)).astype(np.float32)
    return Demonstrations.of(
        observation=observation[[0, 1, 3]],
        action=np.array([0, 1, 2], np.int32),
        next_observation=observation[[1, 2, 4]],
        ending=np.array([0, 3, 3], np.int8),
        rewards=RewardPair(np.array([0.1, 0.2, 0.3]), np.zeros(3)),
        episode=np.array([0, 0, 1]),
        mode_names=("human",),
        mode=np.zeros(3, np.int8),
        n_actions=3,
    )
