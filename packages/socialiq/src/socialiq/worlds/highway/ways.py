"""Ways of egos over a road: their lanes from the entry to the arrival, and their points."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway import scenes as tables
from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.crossings import HALF_WIDTH
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.observation import FAR, POINT, STRIPS, TASK, Line
from socialiq.worlds.road_users import ON_FOOT

_CYCLE_PATH = 1.0  # m, half the width of a bicycle lane that a route crosses
_SAME = 1e-6  # m, up to which points of a route coincide


def arrival_lane(numbers: list[int], road: tables.Road) -> int | None:
    """Return the place in a way of the lane on which an ego arrives; None: it never does.

    It is the first exit that is long enough, as `core.drivers.arrived` counts.

    Args:
        numbers: Lanes of the way, by number.
        road: Tables of the scene.
    """
    lanes = road.lanes[numbers]
    arrives = (lanes["kind"] == EXIT) & (lanes["length"] > road.sight[0]["arrival"])
    return int(arrives.argmax()) if arrives.any() else None


def way_of(ego: np.void, road: tables.Road) -> list[int]:
    """Return the lanes of the ego's way from its entry on, by number.

    The roads are those of its route. Without a route each is followed by the first of its
    successors, until one would come back. On the road of the ego's target lane the way takes this
    lane; on another road it takes the lane of the same number, or the lane that begins next to the
    end of the one before.

    Args:
        ego: Record of the ego.
        road: Tables of the scene.
    """
    lanes = road.lanes
    target = int(ego["target_lane"])
    planned = ego["route"] >= 0
    first = road.routes[ego["route"], ego["destination"], 0] if planned else road.entries[0]["lane"]
    way = [int(first)]
    firsts = [int(lanes[way[0]]["first"])]
    if planned:
        route = road.routes[ego["route"], ego["destination"]].tolist()
        firsts += [first for first in route[1:] if first >= 0]
        for first in _followed(firsts[-1], road)[1:]:  # behind the destination
            if lanes[first]["kind"] != EXIT:
                break
            firsts.append(first)
    else:
        firsts = _followed(firsts[0], road)
        if lanes[target]["first"] not in firsts:  # it entered elsewhere
            firsts = _followed(int(lanes[target]["first"]), road)
            way = [target]
    if firsts[0] == lanes[target]["first"]:
        way = [target]
    for first in firsts[1:]:
        before = lanes[way[-1]]
        beside = np.arange(first, first + lanes[first]["lanes"])
        if lanes[target]["first"] == first:
            way.append(target)
        elif before["lanes"] == len(beside):
            way.append(int(beside[before["number"]]))
        else:
            end = shapes.way(before)[-1]
            apart = [float(np.hypot(*(shapes.way(lanes[n])[0] - end))) for n in beside]
            way.append(int(beside[int(np.argmin(apart))]))
    return way


def _followed(first: int, road: tables.Road) -> list[int]:
    """Return the first lanes of a road and of each first successor, until one would come back."""
    lanes = road.lanes
    firsts = [first]
    while (first := int(road.successors[lanes[first]["road"], 0])) not in (-1, *firsts):
        if lanes[first]["end"] == lanes[firsts[-1]]["start"]:  # the way back
            break
        firsts.append(first)
    return firsts


def line_of(points: np.ndarray, conflict: float, behind: float, arrival: float) -> Line:
    """Return a route along points, without priority and strips.

    Args:
        points: Points (x, y), m, (point, 2); some may coincide.
        conflict: Coordinate at which the place begins where ways meet, m.
        behind: Coordinate at which it ends, m.
        arrival: Coordinate of arrival, m.
    """
    apart = np.hypot(*np.diff(points, axis=0).T)
    distinct = points[np.append(True, apart > _SAME)]
    along = np.append(0.0, np.hypot(*np.diff(distinct, axis=0).T).cumsum())
    at = np.arange(0.0, along[-1] + POINT / 2, POINT)
    line = np.stack([np.interp(at, along, axis) for axis in distinct.T], axis=-1)
    tangent = np.gradient(line, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    task = np.zeros((), TASK)
    task["conflict"] = conflict
    task["behind"] = behind
    task["arrival"] = arrival
    task["strips"] = FAR
    return Line(np.concatenate([line, tangent], axis=1), task)


def route_of(ego: np.void, road: tables.Road, walks: bool) -> Line:
    """Return the route of an agent of a road.

    Args:
        ego: Record of its vehicle.
        road: Tables of the road.
        walks: Whether people cross, so that their strips are observed.
    """
    numbers = way_of(ego, road)
    lanes = road.lanes[numbers]
    lines = [shapes.way(lane) for lane in lanes]
    points = np.concatenate(lines)
    metres = np.append(0.0, np.hypot(*np.diff(points, axis=0).T).cumsum())
    begins = metres[np.append(0, np.cumsum([len(line) for line in lines])[:-1])]
    met = np.flatnonzero((lanes["kind"] > APPROACH) & (lanes["kind"] < EXIT))
    exits = np.flatnonzero(lanes["kind"] == EXIT)
    conflict = float(begins[met[0]]) if len(met) else 0.0
    behind = arrival = float(metres[-1])
    if len(exits):
        behind = float(begins[exits[0]])
    last = arrival_lane(numbers, road)
    if last is not None:
        end = shapes.way(lanes[last], end=float(road.sight[0]["arrival"]))
        arrival = float(begins[last] + np.hypot(*np.diff(end, axis=0).T).sum())
    route = line_of(points, conflict, behind, arrival)
    route.task["priority"] = lanes["priority"][met[0]] if len(met) else 0.0
    if walks:
        strips = _strips(route.points, road)[:STRIPS]
        route.task["strips"][: len(strips)] = strips
    return route


def _strips(points: np.ndarray, road: tables.Road) -> np.ndarray:
    """Return where ways of people cross a route, its coordinates of begin and end, m, rising."""
    strips = list[tuple[float, float]]()
    for way in road.crossings.ways:
        dx = points[:, 0] - way["x"]
        dy = points[:, 1] - way["y"]
        along = dx * way["along_x"] + dy * way["along_y"]
        aside = dy * way["along_x"] - dx * way["along_y"]
        half = HALF_WIDTH if way["motion"] == ON_FOOT else _CYCLE_PATH
        crosses = np.flatnonzero((np.diff(np.sign(aside)) != 0) & (np.abs(along[1:]) < way["half"]))
        strips += [(number * POINT - half, number * POINT + half) for number in crosses.tolist()]
    return np.array(sorted(set(strips))).reshape(-1, 2)
