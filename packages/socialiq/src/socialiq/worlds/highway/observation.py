"""Schemas of observations: highway-env's rows, and one vector along the ego's route for every road.

A schema has a name and a version, which saved policies carry. `rows-1` is the observation of
highway-env: a row of seven numbers for each road user (`options.FEATURES`). `route-1` is computed
from such rows, from what the ego knows of itself, and from the map. It has `EGO` columns, then
`USER` columns for each of the nearest `USERS` road users. It is the same for every road, so a
policy of it can drive on all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from socialiq.worlds.road_users import MOST_CLASSES, ON_FOOT, ROAD_USERS

ROUTE = "route-1"
"""Name and version of the schema along the route."""

USERS = 12
"""Road users of an observation, by distance."""

POINT = 1.0
"""m between two points of a route."""

AHEAD = (5, 10, 20, 35)
"""m ahead, at which the direction of the route is observed."""

SECONDS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
"""s ahead, of predictions."""

MOTIONS = ("slower", "keep", "faster")
"""Motions of the ego that predictions compare."""

STRIPS = 6
"""Crosswalks and bicycle lanes of a route."""

_VEHICLE_SIZE = 5.0, 2.0  # m, length and width that rows of vehicles stand for
FAR = 1e4
"""m, of what lies nowhere on a route."""


class Column(NamedTuple):
    """Number of an observation: a quantity over its scale, clipped."""

    name: str
    unit: str
    meaning: str
    # a number of the observation for each: the quantity at which it is 1, least and largest value
    scales: tuple[tuple[float, float, float], ...]


def _column(name: str, unit: str, meaning: str, *scales: float, limit: float = 8.0) -> Column:
    return Column(name, unit, meaning, tuple((scale, -limit, limit) for scale in scales))


EGO: tuple[Column, ...] = (
    _column("speed", "m/s", "speed", 10.0),
    _column("speed_share", "1", "speed over the fastest target speed", 1.0),
    _column("slower", "m/s", "target speed after the action slower, less the speed", 5.0),
    _column("keep", "m/s", "target speed after the action idle, less the speed", 5.0),
    _column("faster", "m/s", "target speed after the action faster, less the speed", 5.0),
    _column("fastest", "m/s", "fastest target speed", 30.0),
    _column("seconds_left", "s", "time until the episode times out", 2.0, 6.0, limit=1.0),
    _column("slack", "s", "time left after arrival at the fastest speed", 3.0, 10.0, limit=1.0),
    _column("to_conflict", "m", "way to the place where ways meet", 15.0, 60.0, limit=1.0),
    _column("behind_conflict", "m", "way to the end of this place", 15.0, 60.0, limit=1.0),
    _column("to_arrival", "m", "way to the place of arrival", 15.0, 60.0, limit=1.0),
    _column("brakes_before", "m", "way left to the conflict after a full brake", 8.0, limit=1.0),
    _column("beside", "m", "distance to the right of the route", 4.0, limit=2.0),
    _column("turned", "1", "sine of the heading against the route", 1.0),
    _column("users", "1", "road users within 100 m", 6.0),
    _column("lane_left", "1", "whether the road has a lane to the left", 1.0),
    _column("lane_right", "1", "whether the road has a lane to the right", 1.0),
    *(
        _column(f"{part}_{ahead}", "1", f"{word} of the route {ahead} m ahead", 1.0)
        for ahead in AHEAD
        for part, word in (("bend", "cosine less 1"), ("side", "sine, positive to the right,"))
    ),
    *(
        column
        for number in ("next", "second")
        for column in (
            _column(f"{number}_strip", "1", f"whether people cross the route, {number}", 1.0),
            _column(f"to_{number}_strip", "m", "way to this strip", 10.0, 40.0, limit=1.0),
            _column(f"behind_{number}_strip", "m", "way to its end", 10.0, limit=1.0),
        )
    ),
)
"""Columns of the ego, in the order of the kernel's quantities."""

USER: tuple[Column, ...] = (
    _column("presence", "1", "1 where a road user is in the row", 1.0),
    _column("vehicle", "1", "whether it is a vehicle", 1.0),
    _column("on_foot", "1", "whether it is a person on foot", 1.0),
    _column("rides", "1", "whether it is a person who rides", 1.0),
    _column("ahead", "m", "position along the ego's heading", 50.0, 10.0, limit=2.0),
    _column("right", "m", "position to the right of the ego", 50.0, 10.0, limit=2.0),
    _column("velocity_ahead", "m/s", "velocity along the ego's heading, less the ego's", 10.0),
    _column("velocity_right", "m/s", "velocity to the right of the ego", 10.0),
    _column("cos", "1", "cosine of its heading against the ego's", 1.0),
    _column("sin", "1", "sine of its heading against the ego's", 1.0),
    _column("speed", "m/s", "speed", 10.0),
    _column("half_length", "m", "half the length of its class", 2.5),
    _column("half_width", "m", "half the width of its class", 1.0),
    _column("along_route", "m", "place along the ego's route, less the ego's", 50.0, limit=2.0),
    _column("beside_route", "m", "distance to the right of the ego's route", 10.0, limit=1.5),
    _column("cos_route", "1", "cosine of its heading against the ego's route", 1.0),
    _column("sin_route", "1", "sine of its heading against the ego's route", 1.0),
    _column("follows", "1", "whether it is on the ego's route in its direction", 1.0),
    _column("right_of_way", "1", "1, 0, -1: priority of its lane over the ego's way", 1.0),
    _column("in_conflict", "1", "whether its lane lies where ways meet", 1.0),
    _column("on_exit", "1", "whether its lane lies behind", 1.0),
    _column(
        "meets_near", "1", "1 less metres / 50 of the ego to where its straight way meets", 1.0
    ),
    _column("meets_soon", "1", "1 less seconds / 6 of the road user to there", 1.0),
    _column("meets_later", "s", "seconds of the road user to there, less the ego's", 3.0),
    *(
        _column(f"close_{motion}_{second:g}", "1", f"closeness in {second:g} s, ego {motion}", 1.0)
        for motion in MOTIONS
        for second in SECONDS
    ),
    *(
        _column(f"ahead_{motion}", "1", f"closeness times 10 m ahead, ego {motion}", 1.0)
        for motion in MOTIONS
    ),
)
"""Columns of a road user, in the order of the kernel's quantities."""

COLUMN = np.dtype(
    [("quantity", np.int64), ("scale", np.float64), ("low", np.float64), ("high", np.float64)],
    align=True,
)
"""Number of an observation as the kernel reads it."""

AGENT = np.dtype(
    [
        ("way", np.int64),  # number of its route
        ("target_speed", np.float64),  # m/s
        ("seconds_left", np.float64),
        ("cos", np.float64),  # of the turn of the frame of its rows
        ("sin", np.float64),
        ("left", np.bool_),  # whether its road has a lane to the left
        ("right", np.bool_),
    ],
    align=True,
)
"""Facts that an agent knows of itself."""

TASK = np.dtype(
    [
        ("conflict", np.float64),  # m along the route at which the place begins where ways meet
        ("behind", np.float64),  # m, its end
        ("arrival", np.float64),  # m
        ("priority", np.float64),  # of the route where ways meet
        ("strips", np.float64, (STRIPS, 2)),  # m along the route, begins and ends, rising
    ],
    align=True,
)
"""Task of a route."""


class Line(NamedTuple):
    """Route of an agent."""

    points: np.ndarray  # each metre: x, y, cosine and sine, (point, 4)
    task: np.ndarray  # TASK record


MODEL = np.dtype(
    [
        *((name, np.float64) for name in ("x", "y", "vx", "vy")),  # scales of rows, m and m/s
        ("accelerates", np.bool_),  # whether actions are accelerations
        ("slowest", np.float64),  # target speeds, m/s
        ("fastest", np.float64),
        ("step", np.float64),
        ("speeds", np.float64),  # how many there are
        ("brake", np.float64),  # m/s², least and largest acceleration of an action
        ("throttle", np.float64),
    ],
    align=True,
)
"""Scales of the rows and speed control of the ego."""


def table_of(columns: Sequence[Column]) -> np.ndarray:
    """Return COLUMN records of columns."""
    return np.array(
        [(number, *scale) for number, column in enumerate(columns) for scale in column.scales],
        COLUMN,
    )


def names_of(columns: Sequence[Column]) -> list[str]:
    """Return the name of each number; one of a second scale ends with the scale."""
    return [
        column.name if number == 0 else f"{column.name}_{scale[0]:g}"
        for column in columns
        for number, scale in enumerate(column.scales)
    ]


EGO_TABLE = table_of(EGO)
USER_TABLE = table_of(USER)

LAYOUT = len(EGO_TABLE), len(USER_TABLE)
"""Numbers of the ego, and of each road user."""

N_FEATURES = len(EGO_TABLE) + USERS * len(USER_TABLE)
"""Length of an observation of the schema `route`."""

HIGHEST = float(max(EGO_TABLE["high"].max(), USER_TABLE["high"].max()))
"""Largest absolute value of a number of the schema `route`."""


def _class_sizes() -> np.ndarray:
    """Return kind, half length and half width of road users by the code of their row less 1."""
    table = np.zeros((1 + MOST_CLASSES, 3))
    table[0] = 0.0, _VEHICLE_SIZE[0] / 2, _VEHICLE_SIZE[1] / 2
    for number, user in enumerate(ROAD_USERS, 1):
        table[number] = 1.0 + (user.motion != ON_FOOT), user.length / 2, user.width / 2
    return table


CLASS_SIZES = _class_sizes()
