"""Traffic whose moments, vehicles and place are known, cut into windows and written again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from socialiq_recordings.identity.alignment import Placement
from socialiq_recordings.recording import ROAD_USERS, STATES, Recording, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork


def traffic(seed: int = 0, moving: int = 6, standing: int = 2, frames: int = 100) -> Tracks:
    """Vehicles in lanes of their own that speed up and slow down, and some that stand."""
    rng = np.random.default_rng(seed)
    n = moving + standing
    speed = np.zeros((n, frames))
    for one in range(moving):
        changes = np.cumsum(rng.normal(0.0, 0.25, frames))
        speed[one] = np.clip(8.0 + np.convolve(changes, np.ones(10) / 10, "same"), 0.5, 20.0)
    along = np.cumsum(speed, axis=1) * 0.1 + rng.uniform(0, 20, (n, 1))
    rows = n * frames
    return Tracks(
        track=np.repeat(np.arange(n, dtype=np.int32), frames),
        frame=np.tile(np.arange(frames, dtype=np.int32), n),
        x=along.ravel(),
        y=np.repeat(np.arange(n) * 6.0, frames),
        heading=np.zeros(rows),
        vx=speed.ravel(),
        vy=np.zeros(rows),
        identity=np.arange(n) + 10,
        road_user=np.zeros(n, np.int8),
        length=rng.uniform(4.0, 5.0, n),
        width=rng.uniform(1.7, 2.0, n),
        dt=0.1,
        recording=f"day-{seed}",
        source={},
    )


def window(tracks: Tracks, first: int, end: int, name: str) -> Tracks:
    """The frames of a window, counted from its start."""
    rows = (tracks.frame >= first) & (tracks.frame < end)
    users = np.unique(tracks.track[rows])
    number = np.searchsorted(users, tracks.track[rows]).astype(np.int32)
    states = {name: getattr(tracks, name)[rows] for name in STATES}
    states |= {"track": number, "frame": (states["frame"] - first).astype(np.int32)}
    of_users = {name: getattr(tracks, name)[users] for name in ROAD_USERS}
    return replace(tracks, **states, **of_users, recording=name)


def written(tracks: Tracks, placement: Placement, digits: int = 9, noise: float = 0.0) -> Tracks:
    """The same moments in another frame, under other numbers, rounded."""
    rng = np.random.default_rng(1)
    points = placement.of(np.column_stack([tracks.x, tracks.y, tracks.heading]))
    turned = Placement(placement.turn, np.zeros(2))
    velocity = turned.of(np.column_stack([tracks.vx, tracks.vy, tracks.heading]))
    x, y, vx, vy = (
        np.round(one + rng.normal(0.0, size, len(one)), digits)
        for one, size in zip(
            (*points.T[:2], *velocity.T[:2]), (noise, noise, noise / 5, noise / 5), strict=True
        )
    )
    heading = np.mod(points[:, 2] + np.pi, 2 * np.pi) - np.pi
    numbers = rng.permutation(tracks.n_tracks) + 900
    return replace(tracks, x=x, y=y, vx=vx, vy=vy, heading=heading, identity=numbers)


def junction(arms: tuple[float, ...], turn: float = 0.0, x: float = 0.0) -> RoadNetwork:
    """Straight arms of 40 m to a middle, and a curve from the first to each other arm."""
    made = {}
    for number, angle in enumerate(arms):
        ends = np.array([[40.0, 0.0], [8.0, 0.0]])
        made[number] = _lanelet(number, ends, angle + turn, x)
    for number, angle in enumerate(arms[1:], len(arms)):
        share = np.linspace(0, 1, 12)[:, None]
        first = 8.0 * np.array([np.cos(arms[0]), np.sin(arms[0])])
        last = 8.0 * np.array([np.cos(angle), np.sin(angle)])
        curve = (1 - share) ** 2 * first + share**2 * last
        made[number] = _lanelet(number, curve, turn, x)
    return RoadNetwork(made)


def _lanelet(number: int, line: np.ndarray, turn: float, x: float) -> Lanelet:
    cos, sin = np.cos(turn), np.sin(turn)
    line = line @ np.array([[cos, sin], [-sin, cos]]) + np.array([x, 0.0])
    steps = np.gradient(line, axis=0)
    across = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.hypot(*steps.T)[:, None]
    return Lanelet(number, line + 1.5 * across, line - 1.5 * across)


T_JUNCTION, Y_JUNCTION = (0.0, 1.6, 3.1), (0.3, 2.6, 4.6)


@pytest.fixture
def make():
    class Make:
        traffic = staticmethod(traffic)
        window = staticmethod(window)
        written = staticmethod(written)
        junction = staticmethod(junction)
        t, y = T_JUNCTION, Y_JUNCTION

        @staticmethod
        def recording(tracks, road=None):
            return Recording(tracks, road or RoadNetwork())

    return Make
