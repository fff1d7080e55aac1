"""Decisions of a recorded junction by second of processor time: random actions, with resets.

The recording is made up, so that no data set is needed: a crossing of two streams, a vehicle of
each every 2 s.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork
from socialiq_recordings.world.batch import JunctionBatch
from socialiq_recordings.world.build import build
from socialiq_recordings.world.config import WorldConfig

EACH, FRAMES, SPEED, HEADWAY = 20, 150, 8.0, 2.0
BATCH, DECISIONS = 64, 300


def run(repeats: int) -> dict[str, Any]:
    """Measure `repeats` times.

    Returns:
        Decisions a second (median), vehicles on the road (mean), seconds to make the world, all in
        processor time, so that other work on the machine does not count.
    """
    begin = time.process_time()
    world = build([recording()], WorldConfig()).world
    seconds = time.process_time() - begin
    batch = JunctionBatch(world, BATCH)
    batch.reset(range(BATCH))  # compiles
    rates, present = [], []
    for repeat in range(repeats):
        rng = np.random.default_rng(repeat)
        begin = time.process_time()
        for _ in range(DECISIONS):
            batch.step(rng.integers(0, world.n_actions, BATCH))
            present.append(float(batch.buffers.episodes["vehicles"].mean()))
        rates.append(BATCH * DECISIONS / (time.process_time() - begin))
    return {
        "decisions_per_s": statistics.median(rates),
        "vehicles": statistics.mean(present),
        "making_s": seconds,
    }


def making(each: int) -> float:
    """Return the processor time in s that a world of two streams of so many vehicles takes."""
    made = recording(each)
    begin = time.process_time()
    build([made], WorldConfig())
    return time.process_time() - begin


def recording(each: int = EACH) -> Recording:
    """Two streams that cross at the origin, each vehicle at one speed.

    Args:
        each: Vehicles of each stream.
    """
    rows: dict[str, list[np.ndarray]] = {name: [] for name in ("x", "y", "heading", "frame")}
    for stream in range(2):
        for number in range(each):
            frame = np.arange(FRAMES, dtype=np.int32) + round(10 * HEADWAY * number)
            along = SPEED * 0.1 * np.arange(FRAMES) - 60.0
            still = np.zeros(FRAMES)
            rows["x"].append(still if stream else along)
            rows["y"].append(along if stream else still)
            rows["heading"].append(np.full(FRAMES, stream * np.pi / 2))
            rows["frame"].append(frame)
    columns = {name: np.concatenate(parts) for name, parts in rows.items()}
    count = 2 * each
    tracks = Tracks(
        **columns,
        track=np.repeat(np.arange(count, dtype=np.int32), FRAMES),
        vx=SPEED * np.cos(columns["heading"]),
        vy=SPEED * np.sin(columns["heading"]),
        identity=np.arange(count),
        road_user=np.full(count, int(RoadUser.CAR), np.int8),
        length=np.full(count, 4.5),
        width=np.full(count, 1.8),
        dt=0.1,
        recording="ZAM_Streams-1_1_T-1",
        source={"made_by": "benchmarks/junction.py"},
    )
    lanes = [one for turn in range(2) for one in _lane(1 + 10 * turn, turn)]
    return Recording(tracks, RoadNetwork({one.identity: one for one in lanes}))


def _lane(first: int, turn: int) -> list[Lanelet]:
    """Approach, crossing and exit of a stream."""
    ends = ((-100.0, -6.0), (-6.0, 6.0), (6.0, 160.0))
    made = []
    for number, (low, high) in enumerate(ends):
        along = np.linspace(low, high, 20)
        left, right = (np.column_stack([along, np.full(20, side)]) for side in (1.75, -1.75))
        if turn:
            left, right = (one[:, ::-1] * np.array([-1.0, 1.0]) for one in (left, right))
        follows = (first + number + 1,) if number < 2 else ()
        leads = (first + number - 1,) if number else ()
        made.append(Lanelet(first + number, left, right, follows, leads))
    return made
