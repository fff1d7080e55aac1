"""Ego's observation: the nearest vehicles along its lane, rows of seven numbers (5.1.3)."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, distance
from socialiq.worlds.highway.core.vehicle import clip

PERCEPTION = 200.0  # m


@kernel
def observe(vehicles, count, ego, along, tie, sight, observation):
    """Write the ego's row, then those of the others by distance along the ego's lane.

    Vehicles more than 10 m behind are not observed. Vehicles on a crossing lane share a coordinate
    on the ego's lane, so rounding often decides their order; `tie` makes the list's order
    decide.

    Args:
        vehicles: Records of vehicles, and of obstacles.
        count: Number of these.
        ego: The ego's slot.
        along: By slot, the coordinate along the ego's lane, m.
        tie: Distances closer than this are equal, m.
        sight: SIGHT record.
        observation: Rows of seven, float32, overwritten.
    """
    observation[:] = 0.0
    me = vehicles[ego]
    _write(me, 0.0, 0.0, 0.0, 0.0, sight, observation[0])
    slots, distances, visible = np.empty(count, np.int64), np.empty(count), 0
    for slot in range(count):
        if slot == ego:
            continue
        vehicle = vehicles[slot]
        if not distance(vehicle.x, vehicle.y, me.x, me.y) < PERCEPTION:
            continue
        ahead = along[slot] - along[ego]
        if not ahead > -2 * VEHICLE_LENGTH:
            continue
        rank = visible
        while rank > 0 and distances[rank - 1] > abs(ahead) + tie:
            slots[rank], distances[rank] = slots[rank - 1], distances[rank - 1]
            rank -= 1
        slots[rank], distances[rank] = slot, abs(ahead)
        visible += 1
    x, y, vx, vy = 0.0, 0.0, 0.0, 0.0
    if sight.relative:
        x, y, vx, vy = me.x, me.y, me.speed * me.along_x, me.speed * me.along_y
    for row in range(min(visible, len(observation) - 1)):
        _write(vehicles[slots[row]], x, y, vx, vy, sight, observation[row + 1])


@kernel
def _write(vehicle, x, y, vx, vy, sight, row):
    row[0] = 1.0
    row[1] = _scaled(vehicle.x - x, sight.x)
    row[2] = _scaled(vehicle.y - y, sight.y)
    row[3] = _scaled(vehicle.speed * vehicle.along_x - vx, sight.vx)
    row[4] = _scaled(vehicle.speed * vehicle.along_y - vy, sight.vy)
    row[5] = vehicle.along_x
    row[6] = vehicle.along_y


@kernel
def _scaled(value, bound):
    """Map [-bound, bound] to [-1, 1], and clip."""
    return clip(-1.0 + (value + bound) * 2.0 / (2.0 * bound), -1.0, 1.0)
