"""Geometry of the ways of a recorded junction, compiled."""

import math

import numpy as np

from socialiq.worlds.highway.core.compile import kernel


@kernel
def four(table, row):
    """Return the numbers of a row of a table that has four columns.

    Args:
        table: The table.
        row: Number of the row.
    """
    return table[row, 0], table[row, 1], table[row, 2], table[row, 3]


@kernel
def place_of(road, way, along):
    """Return x, y in m and the direction in rad at a coordinate of a way.

    A coordinate before the way or behind it lies on the straight line through its end.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        way: Number of the way, that of its vehicle over all recordings.
        along: Coordinate on the way, m.
    """
    line = road.line
    first = road.line_first[way]
    end = road.line_first[way + 1]
    piece = first + min(max(np.int64(math.floor(along)), 0), end - first - 2)
    beyond = along - (piece - first)
    x = line[piece, 0] + beyond * (line[piece + 1, 0] - line[piece, 0])
    y = line[piece, 1] + beyond * (line[piece + 1, 1] - line[piece, 1])
    return x, y, line[piece, 2]


@kernel
def put(road, car, along):
    """Put a vehicle at a coordinate of its way.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        car: Record of the vehicle, which is written.
        along: The coordinate, m.
    """
    x, y, heading = place_of(road, car.way, along)
    car.along = along
    car.x = x
    car.y = y
    car.heading = heading
    car.along_x = math.cos(heading)
    car.along_y = math.sin(heading)


@kernel
def projected(road, way, x, y):
    """Return coordinate, distance to the left and direction of a way nearest to a point.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        way: Number of the way, that of its vehicle over all recordings.
        x: Place of the point to the east, m.
        y: Place of the point to the north, m.

    Returns:
        Coordinate and distance in m, direction in rad. They are relative to the piece of the way
        that begins nearest to the point.
    """
    line = road.line
    first = road.line_first[way]
    end = road.line_first[way + 1]
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
