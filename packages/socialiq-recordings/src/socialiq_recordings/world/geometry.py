"""Geometry of the ways of a recorded junction, compiled."""

import math

import numpy as np

from socialiq.worlds.highway.core.compile import kernel


@kernel
def place_of(line_first, line, vehicle, along):
    """Return x, y in m and the direction in rad at a coordinate of a vehicle's way."""
    first, end = line_first[vehicle], line_first[vehicle + 1]
    piece = first + min(max(np.int64(math.floor(along)), 0), end - first - 2)
    beyond = along - (piece - first)
    x = line[piece, 0] + beyond * (line[piece + 1, 0] - line[piece, 0])
    y = line[piece, 1] + beyond * (line[piece + 1, 1] - line[piece, 1])
    return x, y, line[piece, 2]


@kernel
def projected(line_first, line, vehicle, x, y):
    """Return coordinate, distance to the left and direction of a way nearest to a point."""
    first, end = line_first[vehicle], line_first[vehicle + 1]
    nearest, least = first, math.inf
    for point in range(first, end - 1):
        dx, dy = x - line[point, 0], y - line[point, 1]
        apart = dx * dx + dy * dy
        if apart < least:
            nearest, least = point, apart
    angle = line[nearest, 2]
    cos, sin = math.cos(angle), math.sin(angle)
    dx, dy = x - line[nearest, 0], y - line[nearest, 1]
    return nearest - first + dx * cos + dy * sin, dy * cos - dx * sin, angle
