"""Range of an episode's rewards at the intersection, from the options alone."""

from __future__ import annotations

from typing import NamedTuple

from socialiq.worlds.highway.core.vehicle import MAX_SPEED
from socialiq.worlds.intersection.actions import ACCELERATION_RANGE
from socialiq.worlds.intersection.core.geometry import SPEED_LIMIT
from socialiq.worlds.intersection.options import Options

_INSIDE_TURN = 1.3
"""Largest advance along a route per metre driven: on the tightest turn, of radius 9 m, within the
half-width of a lane, 2 m, of its centre (9 / 7)."""


class Range(NamedTuple):
    """Smallest and largest value."""

    low: float
    high: float

    @property
    def width(self) -> float:
        """Largest difference of two values."""
        return self.high - self.low


def decisions(options: Options) -> int:
    """Return the number of decisions until the time is over, counted as the core counts it."""
    time, count = 0.0, 0
    while time < options.duration:
        time += 1 / options.policy_frequency
        count += 1
    return count


def is_unlimited(options: Options) -> bool:
    """Whether nothing limits the advance of a decision.

    An ego that steers may pass near the centre of a turn, where a metre driven is any part of it.
    """
    return options.continuous and options.destination != "straight"


def largest_progress(options: Options) -> float:
    """Return the largest value of the signal `progress`, either way.

    The ego enters at the speed limit and its speed control doesn't overshoot a target speed, so it
    drives at most the largest of these speeds times the time between decisions. On the inside of a
    turn that is more of the route. With continuous actions it drives at most `MAX_SPEED` and what
    a sub-step adds.
    """
    fastest = max(SPEED_LIMIT, *map(abs, options.target_speeds))
    if options.continuous:
        fastest = MAX_SPEED + ACCELERATION_RANGE[1] / options.simulation_frequency
    return _INSIDE_TURN * fastest / options.policy_frequency / options.progress_unit


def env_range(options: Options) -> Range:
    """Return limits of an episode's sum of r_env (Eq 4.1), for any driver in any traffic.

    Collision and arrival replace the last decision's reward, a timeout adds to it.
    """
    moved, held = abs(options.progress_weight) * largest_progress(options), options.speed_weight
    low = -moved + min(held, 0.0) + options.step_weight
    high = moved + max(held, 0.0) + options.step_weight
    earlier, late = decisions(options) - 1, options.timeout_weight
    terminal = options.collision_weight, options.arrival_weight
    return Range(
        min(earlier * low, 0.0) + min(*terminal, low, low + late),
        max(earlier * high, 0.0) + max(*terminal, high, high + late),
    )


def social_range(options: Options) -> Range:
    """Return limits of an episode's sum of r_social (Eq 4.2), for any driver in any traffic.

    In every decision each other vehicle counts at most once with each of its two signals, which
    lie in [0, 1]. At the first there are at most `initial_vehicle_count` others, and every later
    one adds at most one.
    """
    count = decisions(options)
    vehicles = count * options.initial_vehicle_count + count * (count - 1) // 2
    weights = options.yielding_weight, options.disruption_weight
    crash = options.neighbour_collision_weight
    return Range(
        vehicles * sum(min(weight, 0.0) for weight in weights) + min(crash, 0.0),
        vehicles * sum(max(weight, 0.0) for weight in weights) + max(crash, 0.0),
    )
