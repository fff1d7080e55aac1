"""Ego vehicle: stepped speed control, steering as for the others, and arrival."""

from __future__ import annotations

from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import longitudinal
from socialiq.worlds.highway.core.vehicle import SPEED_GAIN, clip, speed_index, steering
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.intersection.core.geometry import LANES, ROUTES
from socialiq.worlds.intersection.core.traffic import follow_road
from socialiq.worlds.intersection.state import FASTER, IDLE

EXIT_DISTANCE = 25.0  # m along an exit at which the ego has arrived


@inlined_kernel
def choose(vehicle, action, settings):
    """Set the target speed that an action selects; IDLE keeps the current target speed."""
    follow_road(vehicle)
    if action != IDLE:
        change = 1 if action == FASTER else -1
        wanted = speed_index(vehicle.speed, settings) + change
        vehicle.target_speed = settings.target_speeds[clip(wanted, 0, settings.n_speeds - 1)]


@inlined_kernel
def control(vehicle):
    """Set steering and an unbounded proportional acceleration for a sub-step."""
    follow_road(vehicle)
    vehicle.steering = steering(vehicle, LANES[vehicle.target_lane])
    vehicle.acceleration = SPEED_GAIN * (vehicle.target_speed - vehicle.speed)


@kernel
def arrived(vehicle):
    """Whether a vehicle is 25 m along any exit."""
    if vehicle.lane % 5 != EXIT:
        return False
    return longitudinal(LANES[vehicle.lane], vehicle.x, vehicle.y) >= EXIT_DISTANCE


@kernel
def route_coordinate(vehicle):
    """Return the metres from the start of the approach along the vehicle's planned route."""
    passed = 0.0
    for leg in range(2):
        lane = LANES[ROUTES[vehicle.origin, vehicle.destination, leg]]
        along = longitudinal(lane, vehicle.x, vehicle.y)
        if along <= lane.length:
            return passed + max(along, 0.0)
        passed += lane.length
    lane = LANES[ROUTES[vehicle.origin, vehicle.destination, 2]]
    return passed + max(longitudinal(lane, vehicle.x, vehicle.y), 0.0)
