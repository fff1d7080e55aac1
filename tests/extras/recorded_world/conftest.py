"""A crossing made by hand: one car comes from the west, one from the south, one follows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from socialiq_recordings.recording import Recording, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork, Sign
from socialiq_recordings.world.build import Made, build
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.recorded_world import RecordedWorld

FRAMES = 60
STARTS = {"west": 40.0, "south": 50.0, "behind": 70.0}
SPEEDS = {"west": 8.0, "south": 6.0, "behind": 6.0}


def lane(number: int, start: tuple[float, float], end: tuple[float, float], **more) -> Lanelet:
    ends = np.array([np.linspace(start, end, 12)])[0]
    along = (ends[-1] - ends[0]) / np.hypot(*(ends[-1] - ends[0]))
    left = np.array([-along[1], along[0]]) * 1.75
    return Lanelet(number, ends + left, ends - left, **more)


def crossing_road() -> RoadNetwork:
    lanes = [
        lane(1, (-100, 0), (-6, 0), successors=(2,), sign=Sign.PRIORITY),
        lane(2, (-6, 0), (6, 0), predecessors=(1,), successors=(3,)),
        lane(3, (6, 0), (120, 0), predecessors=(2,)),
        lane(4, (0, -100), (0, -6), successors=(5,), sign=Sign.YIELD),
        lane(5, (0, -6), (0, 6), predecessors=(4,), successors=(6,)),
        lane(6, (0, 6), (0, 120), predecessors=(5,)),
    ]
    return RoadNetwork({one.identity: one for one in lanes})


def tracks(name: str = "ZAM_Made-1_1_T-1", speeds: dict[str, float] = SPEEDS) -> Tracks:
    """Constant speeds, a state every 0.1 s."""
    time = np.arange(FRAMES) * 0.1
    east = speeds["west"] * time - STARTS["west"]
    south, behind = (speeds[one] * time - STARTS[one] for one in ("south", "behind"))
    zero, up = np.zeros(FRAMES), np.full(FRAMES, np.pi / 2)
    three = np.repeat(np.arange(3, dtype=np.int32), FRAMES)
    speed = np.array(list(speeds.values()))[three]
    heading = np.concatenate([zero, up, up])
    return Tracks(
        track=three,
        frame=np.tile(np.arange(FRAMES, dtype=np.int32), 3),
        x=np.concatenate([east, zero, zero]),
        y=np.concatenate([zero, south, behind]),
        heading=heading,
        vx=speed * np.cos(heading),
        vy=speed * np.sin(heading),
        identity=np.array([11, 12, 13]),
        road_user=np.zeros(3, np.int8),
        length=np.full(3, 4.5),
        width=np.full(3, 1.8),
        dt=0.1,
        recording=name,
        source={"made_by": "a test"},
    )


@pytest.fixture(scope="session")
def crossing() -> Recording:
    return Recording(tracks(), crossing_road())


@pytest.fixture(scope="session")
def made(crossing: Recording) -> Made:
    return build([crossing], WorldConfig())


@pytest.fixture(scope="session")
def world_file(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("world") / "crossing.safetensors"
    made.world.save(path)
    return path


@pytest.fixture(scope="session")
def world(world_file: Path) -> RecordedWorld:
    return RecordedWorld.load(world_file)
