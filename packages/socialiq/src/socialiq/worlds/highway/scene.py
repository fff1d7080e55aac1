"""A scene: a road, who enters it, the ego's task, and what is observed and rewarded."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

ACTIONS = ("lane_left", "idle", "lane_right", "faster", "slower")
"""Actions: to the next lane, keep, or one target speed up or down from the present speed."""

LANE_LEFT, IDLE, LANE_RIGHT, FASTER, SLOWER = range(len(ACTIONS))

CAR = np.dtype(
    [
        ("x", np.float64),  # centre, m; x to the east, y to the south
        ("y", np.float64),
        ("heading", np.float64),  # rad, clockwise as drawn, from east
        ("along_x", np.float64),  # cosine and sine of the heading
        ("along_y", np.float64),
        ("speed", np.float64),  # m/s
        ("steering", np.float64),  # held command: front wheel angle, rad
        ("acceleration", np.float64),  # held command, m/s²
        ("target_speed", np.float64),
        ("time_headway", np.float64),  # s
        ("jam_distance", np.float64),  # m
        ("max_acceleration", np.float64),  # m/s²
        ("comfort_deceleration", np.float64),  # m/s², positive
        ("exponent", np.float64),  # of the free-road term
        ("timer", np.float64),  # s since the driver last thought of changing lanes
        ("push_x", np.float64),  # m; displacement by a collision in the next sub-step
        ("push_y", np.float64),
        ("identity", np.int32),  # its entry; obstacles follow
        ("lane", np.int16),  # closest lane
        ("target_lane", np.int16),  # lane it steers along
        ("route", np.int16),  # road at which its way began, -1 without a way
        ("destination", np.int16),
        ("leg", np.int16),  # completed roads of its way
        ("obstacle", np.bool_),
        ("crashed", np.bool_),
        ("pushed", np.bool_),  # push_x and push_y are pending
    ],
    align=True,
)
"""Record of a vehicle or of an obstacle, which stands and drives nowhere."""

ENTRY = np.dtype(
    [
        ("lane", np.int64),  # first of those to draw from
        ("lanes", np.int64),  # 1: not drawn
        ("along", np.float64),  # m
        ("along_spread", np.float64),
        ("speed", np.float64),  # m/s
        ("speed_spread", np.float64),
        ("spread", np.int64),  # NONE, UNIFORM or NORMAL
        ("target_speed", np.float64),  # m/s; 0: its speed
        ("destination", np.int64),  # -1: none, no route is planned
        ("destinations", np.int64),  # so many from there are drawn from; 1: not drawn
        ("exponent", np.bool_),  # whether the driver's is drawn
        ("changes", np.bool_),  # whether the driver changes lanes
    ],
    align=True,
)
"""One vehicle that enters at the start, in order; the first is the ego."""

NONE, UNIFORM, NORMAL = range(3)

SIGHT = np.dtype(
    [
        ("relative", np.bool_),  # rows of others relative to the ego
        ("x", np.float64),  # m, seen as 1
        ("y", np.float64),
        ("vx", np.float64),  # m/s, seen as 1
        ("vy", np.float64),
        ("arrival", np.float64),  # m along an exit at which the ego has arrived
    ],
    align=True,
)
"""Scales of the observation, and the place of arrival."""


class Road(NamedTuple):
    """Tables of a scene as the compiled core reads them.

    Attributes:
        lanes: LANE records.
        successors: Roads that follow each road, (roads, most).
        routes: Roads of a way by road and destination, (roads, destinations, most).
        entries: ENTRY records, the ego's first.
        obstacles: Centres of the standing obstacles, (obstacles, 2), m.
        sight: SIGHT record in an array of one.
    """

    lanes: np.ndarray
    successors: np.ndarray
    routes: np.ndarray
    entries: np.ndarray
    obstacles: np.ndarray
    sight: np.ndarray


class Scene(NamedTuple):
    """One scene.

    Attributes:
        name: Its name.
        road: Its tables.
        defaults: Values of the options in the place of the intersection's.
        real: Class of highway-env, `module:name`; empty if it has none.
        config: highway-env's configuration, beyond clock, actions and observation.
    """

    name: str
    road: Road
    defaults: Mapping[str, Any]
    real: str = ""
    config: Mapping[str, Any] = MappingProxyType({})


def entry(lane: int, along: float, speed: float, **more: Any) -> np.ndarray:
    """Return an ENTRY record with the given fields."""
    record = np.zeros((), ENTRY)
    for name, value in {
        "lane": lane, "lanes": 1, "along": along, "speed": speed, "destination": -1,
        "destinations": 1, "changes": True, **more,
    }.items():  # fmt: skip
        record[name] = value
    return record


def sight(
    x: float, y: float, vx: float, vy: float, arrival: float = np.inf, *, relative: bool
) -> np.ndarray:
    """Return a SIGHT record in an array of one."""
    return np.array([(relative, x, y, vx, vy, arrival)], SIGHT)
