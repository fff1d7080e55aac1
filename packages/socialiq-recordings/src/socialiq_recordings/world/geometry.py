"""Geometry of the ways of a recorded junction, compiled."""

import math

import numpy as np

from socialiq.worlds.highway.core.compile import kernel


@kernel
def place_of(line_first, line, vehicle, along):
    """Return x, y in m and the direction in rad at a coordinate of a vehicle's way.

    A coordinate before the way or behind it lies on the straight line through its end.

    Args:
        line_first: First point of each way, `Road.line_first`.
        line: Points of all ways, one every metre: x and y in m, direction in rad.
        vehicle: Vehicle, numbered over all recordings.
        along: Coordinate on its way, m.
    """
    first = line_first[vehicle]
    end = line_first[vehicle + 1]
    piece = first + min(max(np.int64(math.floor(along)), 0), end - first - 2)
    beyond = along - (piece - first)
    x = line[piece, 0] + beyond * (line[piece + 1, 0] - line[piece, 0])
    y = line[piece, 1] + beyond * (line[piece + 1, 1] - line[piece, 1])
    return x, y, line[piece, 2]


@kernel
def projected(line_first, line, vehicle, x, y):
    """Return coordinate, distance to the left and direction of a way nearest to a point.

    Args:
        line_first: First point of each way, `Road.line_first`.
        line: Points of all ways, one every metre: x and y in m, direction in rad.
        vehicle: Vehicle whose way it is, numbered over all recordings.
        x: Place of the point to the east, m.
        y: Place of the point to the north, m.

    Returns:
        Coordinate and distance in m, direction in rad. They are relative to the piece of the way
        that begins nearest to the point.
    """
    first = line_first[vehicle]
    end = line_first[vehicle + 1]
    nearest = first
    least = math.inf
    for point in range(first, end - 1):
        dx = x - line[point, 0]
        dy = y - line[point, 1]
        apart = dx * dx + dy * dy
        if apart < least:
            nearest = point
            least = apart
    angle = line[nearest, 2]
    cos = math.cos(angle)
    sin = math.sin(angle)
    dx = x - line[nearest, 0]
    dy = y - line[nearest, 1]
    return nearest - first + dx * cos + dy * sin, dy * cos - dx * sin, angle
