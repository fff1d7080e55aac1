"""Rules of priority: drivers foresee where their ways meet, and the one of lower priority stops."""

import math

import numpy as np

from socialiq.worlds.highway.core import geometry
from socialiq.worlds.highway.core import vehicle as motion
from socialiq.worlds.highway.core.compile import allocating_kernel, inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, longitudinal
from socialiq.worlds.highway.options import VEHICLE

N_PREDICTIONS = 11  # every quarter of a second up to 2.75 s
PREDICTION_STEP = 0.25  # s
LONG = 1.5 * VEHICLE_LENGTH  # of the rectangle around a predicted vehicle, m
WIDE = 0.9 * geometry.VEHICLE_WIDTH
_SURELY_APART = VEHICLE_LENGTH * VEHICLE_LENGTH * (1 + 1e-9)


@allocating_kernel
def enforce(vehicles, count, road, settings):
    """Release all vehicles, then stop the yielding vehicle of every pair whose predictions meet.

    An agent never yields: where it would have to, neither vehicle does.

    Args:
        vehicles: Records of the episode; `yielding` and target speeds are written.
        count: Number of vehicles.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    lanes = road.lanes
    for slot in range(count):
        vehicle = vehicles[slot]
        if vehicle.yielding:
            vehicle.yielding = False
            vehicle.target_speed = min(lanes[vehicle.lane].speed_limit, vehicle.desired_speed)
    predictions = np.empty((count, N_PREDICTIONS, 3))
    for slot in range(count):
        if settings.continuous and vehicles[slot].agent >= 0:
            _predict_held(vehicles[slot], predictions[slot])
        else:
            _predict(vehicles[slot], lanes, road.routes, predictions[slot])
    for first in range(count - 1):
        for second in range(first + 1, count):
            lane = lanes[vehicles[first].lane]
            other_lane = lanes[vehicles[second].lane]
            first_yields = yields(vehicles[first], vehicles[second], lane, other_lane, settings.tie)
            slot = first if first_yields else second
            if vehicles[slot].agent >= 0 or vehicles[slot].yielding:
                continue
            if _meet(predictions[first], predictions[second]):
                vehicles[slot].yielding = True
                vehicles[slot].target_speed = 0.0


@kernel
def yields(vehicle, partner, lane, partner_lane, tie):
    """Whether the first of two vehicles must yield: lower priority, else further away.

    Args:
        vehicle: Record of the first vehicle.
        partner: Record of the second vehicle.
        lane: Record of the first one's lane.
        partner_lane: Record of the second one's lane.
        tie: Difference within which distances are equal, m; the second vehicle then yields.
    """
    if lane.priority != partner_lane.priority:
        return lane.priority < partner_lane.priority
    return _ahead(vehicle, partner) > _ahead(partner, vehicle) + tie


@kernel
def _ahead(vehicle, partner):
    """Return the distance of another vehicle ahead, m."""
    dx = partner.x - vehicle.x
    dy = partner.y - vehicle.y
    return vehicle.along_x * dx + vehicle.along_y * dy


@inlined_kernel
def _predict(vehicle, lanes, routes, predictions):
    """Write positions and headings along the rest of the route at the present speed.

    The coordinate is that of the closest lane, but the walk begins at the route's first lane that
    is not behind. Where these differ, in the last 2.5 m of a lane, the prediction is far ahead of
    the vehicle; highway-env does the same. Without a route the prediction is along the lane.
    """
    start = longitudinal(lanes[vehicle.lane], vehicle.x, vehicle.y)
    way = routes[max(vehicle.route, 0), vehicle.destination]
    legs = len(way) if vehicle.route >= 0 else 0
    for number in range(N_PREDICTIONS):
        along = start + vehicle.speed * (PREDICTION_STEP * (number + 1))
        leg = vehicle.leg
        lane = lanes[vehicle.lane]
        if leg < legs and way[leg] >= 0:
            lane = lanes[way[leg]]
            while leg < legs - 1 and way[leg + 1] >= 0 and along > lane.length:
                along -= lane.length
                leg += 1
                lane = lanes[way[leg]]
        predictions[number, 0], predictions[number, 1] = geometry.position(lane, along)
        predictions[number, 2] = geometry.heading_at(lane, along)


@allocating_kernel
def _predict_held(vehicle, predictions):
    """Write positions and headings at the present speed and angle of the wheels."""
    ahead = np.empty(1, VEHICLE)
    ahead[0] = vehicle
    ahead[0].acceleration = 0.0
    for number in range(N_PREDICTIONS):
        motion.advance(ahead[0], PREDICTION_STEP)
        predictions[number, 0] = ahead[0].x
        predictions[number, 1] = ahead[0].y
        predictions[number, 2] = ahead[0].heading


@kernel
def _meet(path, other_path):
    """Whether two vehicles' rectangles touch at any of the predicted times."""
    for number in range(N_PREDICTIONS):
        dx = other_path[number, 0] - path[number, 0]
        dy = other_path[number, 1] - path[number, 1]
        squared = dx * dx + dy * dy
        if squared > _SURELY_APART or math.sqrt(squared) > VEHICLE_LENGTH:
            continue
        first = path[number]
        second = other_path[number]
        if _has_point_inside(first, second) or _has_point_inside(second, first):
            return True
    return False


@kernel
def _has_point_inside(points_of, rectangle):
    """Whether a corner, middle of a side or centre of one rectangle lies in another.

    The test turns the points by the rectangle's heading instead of against it, which is wrong in
    turns; highway-env does the same.
    """
    cos = math.cos(points_of[2])
    sin = math.sin(points_of[2])
    other_cos = math.cos(rectangle[2])
    other_sin = math.sin(rectangle[2])
    for row in range(-1, 2):
        for column in range(-1, 2):
            along = row * LONG / 2
            across = column * WIDE / 2
            dx = cos * along - sin * across + points_of[0] - rectangle[0]
            dy = sin * along + cos * across + points_of[1] - rectangle[1]
            along_other = abs(other_cos * dx - other_sin * dy)
            across_other = abs(other_sin * dx + other_cos * dy)
            if along_other <= LONG / 2 and across_other <= WIDE / 2:
                return True
    return False
