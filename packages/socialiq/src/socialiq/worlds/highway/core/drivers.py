"""Drivers on any road: their way and leader, the Intelligent Driver Model, MOBIL, an agent's steps.

Tables of the road are those of `scenes.Road`.
"""

import math

from socialiq.worlds.highway.core import geometry
from socialiq.worlds.highway.core import vehicle as motion
from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, longitudinal
from socialiq.worlds.highway.core.vehicle import MAX_ACCELERATION, clip
from socialiq.worlds.highway.network import EXIT, LANE_WIDTH

CHANGE_EVERY = 1.0  # s
LEAST_GAIN = 0.2  # m/s², of a lane change
MOST_IMPOSED = 2.0  # m/s², braking of the vehicle behind
LEAST_SPEED = 1.0  # m/s, to change lanes at
ROLLING = 2.0  # m/s, of drivers at the line of an all-way stop
_SIDE = LANE_WIDTH / 2 + 1.0  # m from the middle of a lane to who counts as on it


@inlined_kernel
def follow_road(vehicle, road):
    """Select the next lane from 2.5 m before the end of the target lane.

    Args:
        vehicle: Record of the vehicle.
        road: Tables of the road.
    """
    lane = road.lanes[vehicle.target_lane]
    if longitudinal(lane, vehicle.x, vehicle.y) > lane.length - VEHICLE_LENGTH / 2:
        following = geometry.following(vehicle, road.lanes, road.routes, road.successors)
        vehicle.target_lane = following


@kernel
def _neighbours(vehicles, records, me, lane, tie):
    """Return the slots of the nearest vehicles or obstacles ahead and behind on a lane, or -1.

    Of equals ahead the last one is returned.
    """
    here = longitudinal(lane, vehicles[me].x, vehicles[me].y)
    front = -1
    rear = -1
    ahead = math.inf
    behind = -math.inf
    for slot in range(records):
        x = vehicles[slot].x
        y = vehicles[slot].y
        if slot == me or abs(geometry.lateral(lane, x, y)) > _SIDE:
            continue
        along = longitudinal(lane, x, y)
        if not -VEHICLE_LENGTH <= along < lane.length + VEHICLE_LENGTH:
            continue
        if here <= along <= ahead + tie:
            front = slot
            ahead = along
        if behind < along < here:
            rear = slot
            behind = along
    return front, rear


@kernel
def _connected_leader(vehicles, records, me, lanes, connections, tie):
    """Return the slot of the nearest leader on a lane or on those after and before it, or -1."""
    here = longitudinal(lanes[connections[0].lane], vehicles[me].x, vehicles[me].y)
    front = -1
    ahead = math.inf
    for slot in range(records):
        x = vehicles[slot].x
        y = vehicles[slot].y
        for connection in connections:
            if slot == me or connection.lane < 0:
                break
            lane = lanes[connection.lane]
            if geometry.on_lane(lane, x, y, 1.0):
                along = longitudinal(lane, x, y) + connection.offset
                if here <= along <= ahead + tie:
                    front = slot
                    ahead = along
                break
    return front


@inlined_kernel
def _leader(vehicles, records, me, number, road, settings):
    """Return the slot of the leader on a lane, or with `connected_lanes` beyond its ends too."""
    if settings.connected_lanes:
        connections = road.connected[number]
        return _connected_leader(vehicles, records, me, road.lanes, connections, settings.tie)
    front, _ = _neighbours(vehicles, records, me, road.lanes[number], settings.tie)
    return front


@kernel
def _acceleration(vehicles, slot, front, exponent, lanes):
    """Return the acceleration of the Intelligent Driver Model, m/s².

    It is 0 without a vehicle (slot -1), and for an obstacle. A driver attributes the exponent of
    its free-road term to others. The gap is measured along the closest lane, also to a leader on
    the target lane.
    """
    if slot < 0 or vehicles[slot].obstacle:
        return 0.0
    vehicle = vehicles[slot]
    lane = lanes[vehicle.lane]
    limit = lane.speed_limit
    if lane.slow_from < math.inf and longitudinal(lane, vehicle.x, vehicle.y) > lane.slow_from:
        limit = ROLLING
    free = motion.free_acceleration(vehicle, limit, exponent)
    return free if front < 0 else free - motion.braking_for(vehicle, vehicles[front], lane)


@inlined_kernel
def drive(vehicles, records, me, road, settings):
    """Set a driver's steering and acceleration for a sub-step.

    Args:
        vehicles: Records of vehicles and obstacles.
        records: Number of records.
        me: Slot of the driver; one that has crashed is left as it is.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    vehicle = vehicles[me]
    if not vehicle.crashed:
        lanes = road.lanes
        follow_road(vehicle, road)
        if vehicle.changes:
            _change_lane(vehicles, records, me, lanes, settings.tie)
        lane = vehicle.lane
        target = vehicle.target_lane
        vehicle.steering = motion.steering(vehicle, lanes[target])
        front = _leader(vehicles, records, me, lane, road, settings)
        rate = _acceleration(vehicles, me, front, vehicle.exponent, lanes)
        if lane != target:
            front = _leader(vehicles, records, me, target, road, settings)
            rate = min(rate, _acceleration(vehicles, me, front, vehicle.exponent, lanes))
        vehicle.acceleration = clip(rate, -MAX_ACCELERATION, MAX_ACCELERATION)


@kernel
def _change_lane(vehicles, records, me, lanes, tie):
    """Begin a lane change, at most once a second, or give one up that another makes too.

    A change is given up if a vehicle close ahead changes to the same lane.
    """
    vehicle = vehicles[me]
    lane = lanes[vehicle.lane]
    if vehicle.lane != vehicle.target_lane:
        if lane.road != lanes[vehicle.target_lane].road:
            return
        here = longitudinal(lane, vehicle.x, vehicle.y)
        for slot in range(records):
            other = vehicles[slot]
            same = other.target_lane == vehicle.target_lane and other.lane != vehicle.target_lane
            if slot == me or other.obstacle or not same:
                continue
            gap = longitudinal(lane, other.x, other.y) - here
            if 0 < gap < motion.desired_gap(vehicle, other):
                vehicle.target_lane = vehicle.lane
                return
        return
    if not vehicle.timer > CHANGE_EVERY:
        return
    vehicle.timer = 0.0
    here_on = vehicle.lane + 0
    for side in (-1, 1):
        number = lane.number + side
        if not 0 <= number < lane.lanes:
            continue
        candidate = lane.first + number
        reachable = geometry.reachable(lanes[candidate], vehicle.x, vehicle.y)
        if not reachable or abs(vehicle.speed) < LEAST_SPEED:
            continue
        if _worthwhile(vehicles, records, me, here_on, candidate, lanes, tie):
            vehicle.target_lane = candidate


@kernel
def _worthwhile(vehicles, records, me, here, candidate, lanes, tie):
    """Whether MOBIL (Kesting et al. 2007) recommends a lane, without politeness."""
    vehicle = vehicles[me]
    front, rear = _neighbours(vehicles, records, me, lanes[candidate], tie)
    if _acceleration(vehicles, rear, me, vehicle.exponent, lanes) < -MOST_IMPOSED:
        return False
    after = _acceleration(vehicles, me, front, vehicle.exponent, lanes)
    if vehicle.route >= 0 and vehicle.leg == 0:  # its way prescribes the lane on which it began
        return False
    front, _ = _neighbours(vehicles, records, me, lanes[here], tie)
    return not after - _acceleration(vehicles, me, front, vehicle.exponent, lanes) < LEAST_GAIN


@kernel
def choose(vehicle, action, road, settings):
    """Carry out an agent's action: a target lane or a target speed.

    Args:
        vehicle: Record of the agent's vehicle; with continuous actions it is left as it is.
        action: Number of the action, a row of the road's table of actions.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    if settings.continuous:
        return
    follow_road(vehicle, road)
    faster = road.actions[action, 0]
    aside = road.actions[action, 1]
    if faster != 0:
        level = motion.speed_index(vehicle.speed, settings) + faster
        vehicle.target_speed = settings.target_speeds[clip(level, 0, settings.n_speeds - 1)]
    if aside != 0:
        lane = road.lanes[vehicle.target_lane]
        beside = lane.first + clip(lane.number + aside, 0, lane.lanes - 1)
        if geometry.reachable(road.lanes[beside], vehicle.x, vehicle.y):
            vehicle.target_lane = beside


@inlined_kernel
def control(vehicle, road):
    """Set an agent's steering and an unbounded proportional acceleration for a sub-step.

    Args:
        vehicle: Record of the agent's vehicle.
        road: Tables of the road.
    """
    follow_road(vehicle, road)
    vehicle.steering = motion.steering(vehicle, road.lanes[vehicle.target_lane])
    vehicle.acceleration = motion.SPEED_GAIN * (vehicle.target_speed - vehicle.speed)


@kernel
def arrived(vehicle, road):
    """Whether a vehicle has arrived: it is far enough along an exit.

    Args:
        vehicle: Record of the vehicle.
        road: Tables of the road.
    """
    lane = road.lanes[vehicle.lane]
    if lane.kind != EXIT:
        return False
    return longitudinal(lane, vehicle.x, vehicle.y) > road.sight[0].arrival


@kernel
def coordinate(vehicle, road):
    """Return the metres of a vehicle along its route, or along the ego's way by the road's table.

    On another road than those of the ego's way the result is NaN.

    Args:
        vehicle: Record of the vehicle.
        road: Tables of the road.
    """
    if road.sight[0].by_route:
        return route_coordinate(vehicle, road.lanes, road.routes)
    lane = road.lanes[vehicle.target_lane]
    along = longitudinal(lane, vehicle.x, vehicle.y)
    return lane.before + along * (road.lanes[lane.first].length / lane.length)


@kernel
def route_coordinate(vehicle, lanes, routes):
    """Return the metres from the start of a vehicle's route, along its roads' first lanes.

    The vehicle is on the first road, from the last one that it has completed on, whose end it has
    not passed. Roads that it has left are not looked at: a circle leads back to them.

    Args:
        vehicle: Record of the vehicle.
        lanes: Records of the lanes.
        routes: Table of ways, as of `scenes.Road`.
    """
    way = routes[vehicle.route, vehicle.destination]
    last = 0
    while last < len(way) - 1 and way[last + 1] >= 0:
        last += 1
    passed = 0.0
    for leg in range(last):
        lane = lanes[way[leg]]
        if leg >= vehicle.leg - 1:
            along = longitudinal(lane, vehicle.x, vehicle.y)
            if along <= lane.length:
                return passed + max(along, 0.0)
        passed += lane.length
    return passed + max(longitudinal(lanes[way[last]], vehicle.x, vehicle.y), 0.0)
