"""Crosswalks and bicycle lanes as tables of a road: where people move, and where vehicles cross it.

A person moves along a straight way, with coordinates from its middle. `crosswalk` and
`bicycle_lane` make ways; `meetings` and `ridden` compute where the lanes of a road cross them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from socialiq.worlds.highway import network
from socialiq.worlds.road_users import ON_FOOT, RIDES

WAY = np.dtype(
    [
        ("motion", np.int64),  # ON_FOOT or RIDES
        ("x", np.float64),  # middle, m
        ("y", np.float64),
        ("heading", np.float64),  # rad, clockwise as drawn, from east
        ("along_x", np.float64),  # cosine and sine of the heading
        ("along_y", np.float64),
        ("half", np.float64),  # m before and behind the middle, where it begins and ends
        ("line", np.float64),  # m before the middle, where people wait for a gap
    ],
    align=True,
)
"""Record of a way of people. Those of a crosswalk follow each other, back and forth; ways of
bicycles come behind all crosswalks."""

MEETING = np.dtype(
    [
        ("base", np.float64),  # m along the lane, or its length; -inf: the ways don't cross
        ("place", np.float64),  # m along the lane on which they cross, if that is a further one
        ("between", np.float64),  # m of the lanes between these
        ("across", np.float64),  # coordinate along the second way of the crosswalk
    ],
    align=True,
)
"""Place where a vehicle on a lane will cross a way. A vehicle at the coordinate `along` has
`base - along + place + between` metres to drive."""

HALF_WIDTH = 1.5  # m, of a crosswalk
PAVEMENT = 1.0  # m beside the road, on which people arrive

NOWHERE = np.array((-np.inf, 0.0, 0.0, 0.0), MEETING)

_ON = 1e-9  # m from a way, within which a point lies on it
_POINTS = 2001  # of a lane


class Crossings(NamedTuple):
    """Tables of the ways of people over a road."""

    ways: np.ndarray  # WAY records
    crosswalks: int  # the first ways are twice as many
    meetings: np.ndarray  # MEETING records, (crosswalks, lanes, destinations)
    # place on a vehicle's route and on a bicycle's way, -inf where they don't cross,
    # (roads, destinations, ways of bicycles, 2), m
    ridden: np.ndarray


def crosswalk(x: float, y: float, heading: float, half: float) -> list[np.ndarray]:
    """Return the two ways of a crosswalk, back and forth.

    Args:
        x: Middle of the crosswalk, m.
        y: The same, to the south, m.
        heading: Heading of the second way, rad, clockwise as drawn, from east.
        half: Half the length of the crosswalk, with 1 m of pavement, m.
    """
    there = way(ON_FOOT, x, y, heading, half, half)
    back = there.copy()
    back["heading"] = heading + math.pi
    back["along_x"] = there["along_x"] * -1
    back["along_y"] = there["along_y"] * -1
    return [back, there]


def way(motion: int, x: float, y: float, heading: float, half: float, line: float) -> np.ndarray:
    """Return a WAY record.

    Args:
        motion: ON_FOOT or RIDES.
        x: Middle of the way, m.
        y: The same, to the south, m.
        heading: Heading, rad, clockwise as drawn, from east.
        half: Metres before and behind the middle, where the way begins and ends.
        line: Metres before the middle, where people wait.
    """
    along = round(math.cos(heading), 12), round(math.sin(heading), 12)
    return np.array((motion, x, y, heading, *along, half, line), WAY)


def mirrored_ways(ways: np.ndarray, sides: tuple[float, float]) -> np.ndarray:
    """Return the mirror image of ways in a line through the origin, WAY.

    Args:
        ways: WAY records.
        sides: Factors of x and y, as in `network.mirrored`.
    """
    image = ways.copy()
    for axis, side in zip("xy", sides, strict=True):
        image[axis] *= side
        image[f"along_{axis}"] *= side
    image["heading"] = np.arctan2(image["along_y"], image["along_x"])
    return image


def crossings_of(
    lanes: np.ndarray, routes: np.ndarray, ways: Sequence[np.ndarray], has_routes: bool
) -> Crossings:
    """Return the tables of the ways of people over a road.

    Args:
        lanes: LANE records of the road.
        routes: First lanes of the roads of a way, (roads, destinations, most), as in
            `scenes.Road`.
        ways: WAY records, those on foot first.
        has_routes: Whether vehicles of the road drive to destinations.
    """
    table = np.array(list(ways), WAY)
    on_foot = table[table["motion"] == ON_FOOT]
    rides = table[table["motion"] == RIDES]
    meetings = np.full((len(on_foot) // 2, len(lanes), routes.shape[1]), NOWHERE)
    for number, destination in np.ndindex(meetings.shape[1:]):
        path = _path(lanes, routes, number, destination if has_routes else -1)
        meetings[:, number, destination] = [_meeting(lanes[path], walk) for walk in on_foot[1::2]]
    ridden = np.full((*routes.shape[:2], len(rides), 2), -np.inf)
    for road, destination in np.ndindex(routes.shape[:2] if has_routes else (0, 0)):
        legs = routes[road, destination]
        for number, ride in enumerate(rides):
            ridden[road, destination, number] = _on_route(lanes[legs[legs >= 0]], ride)
    return Crossings(table, len(on_foot) // 2, meetings, ridden)


def _path(lanes: np.ndarray, routes: np.ndarray, number: int, destination: int) -> list[int]:
    """Return the lanes from one on to a destination, or straight on where there is none (-1).

    A lane from which the way would lead back over an approach is followed by the last lane of the
    ways to the destination: a vehicle in a junction may be closest to a lane of another way.
    """
    if destination >= 0:
        ways = routes[:, destination]
        legs = ways[lanes["road"][number]]
        further = legs[legs >= 0][1:]
        turns_back = not len(further) or np.any(lanes["kind"][further] == network.APPROACH)
        if not turns_back:
            return [number, *further.tolist()]
        return [number] if lanes["kind"][number] == network.EXIT else [number, _goal(ways)]
    path = [number]
    while True:
        lane = lanes[path[-1]]
        after = np.flatnonzero(lanes["start"] == lane["end"])
        same = after[lanes["number"][after] == lane["number"]]
        following = [*same, *after][:1]
        if not following or following[0] in path:
            return path
        path.append(int(following[0]))


def _goal(ways: np.ndarray) -> int:
    """Return the last lane of the longest of some ways, (roads, most)."""
    longest = ways[(ways >= 0).sum(axis=1).argmax()]
    return int(longest[longest >= 0][-1])


def _meeting(path: np.ndarray, walk: np.void) -> np.ndarray:
    """Return the MEETING record of a vehicle at the first of some lanes with a way on foot."""
    for number, lane in enumerate(path):
        crossing = _place(lane, walk, float(walk["half"]))
        if crossing is None:
            continue
        place, across = crossing
        if number == 0:
            return np.array((place, 0.0, 0.0, across), MEETING)
        between = float(path["length"][1:number].sum())
        return np.array((path["length"][0], place, between, across), MEETING)
    return NOWHERE


def _on_route(legs: np.ndarray, ride: np.void) -> tuple[float, float]:
    """Return the place on a route and on a bicycle's way where they cross, m."""
    passed = 0.0
    for lane in legs:
        crossing = _place(lane, ride, np.inf)
        if crossing is not None:
            return passed + crossing[0], crossing[1]
        passed += float(lane["length"])
    return -np.inf, -np.inf


def _place(lane: np.void, way_of_person: np.void, within: float) -> tuple[float, float] | None:
    """Return where a lane crosses a person's way: m along the lane, and along the way.

    The place is the last of `_POINTS` points of the lane that is not behind the way.

    Args:
        lane: LANE record.
        way_of_person: WAY record.
        within: Metres of the way before and behind its middle that count.
    """
    along, x, y = network.points(lane, _POINTS)
    x = x - way_of_person["x"]
    y = y - way_of_person["y"]
    aside = way_of_person["along_x"] * y - way_of_person["along_y"] * x
    aside[np.abs(aside) < _ON] = 0.0
    across = way_of_person["along_x"] * x + way_of_person["along_y"] * y
    for number in np.flatnonzero(np.diff(np.sign(aside))):
        number += int(aside[number + 1] == 0.0)
        if abs(across[number]) > within:
            continue
        if aside[number] == 0.0:  # without the rounding of sines and cosines
            return round(float(along[number]), 9), round(float(across[number]), 9)
        return float(along[number]), float(across[number])
    return None
