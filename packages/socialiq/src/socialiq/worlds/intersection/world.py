"""Intersection as a world, and the limits of an episode's rewards there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from gymnasium import spaces

from socialiq.types import Policy
from socialiq.worlds.highway.state import MAX_SPEED
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.batch import ACCELERATION_RANGE, BackEnd, Batch, space_of
from socialiq.worlds.intersection.options import POPULATIONS, Options
from socialiq.worlds.intersection.state import ACTIONS, SPEED_LIMIT

if TYPE_CHECKING:
    from socialiq.worlds.highway.pictures.render import View


@dataclass(frozen=True)
class Intersection(RoadWorld):
    """highway-env's unsignalised crossing with the thesis' reward pair (5.1.3).

    Attributes:
        options: Scenario and reward options.
        name: Name in the registry.
    """

    options: Options = field(  # pyright: ignore[reportIncompatibleVariableOverride]  it is frozen
        default_factory=Options
    )
    name: str = "intersection"

    drivers: ClassVar[tuple[str, ...]] = policies.NAMES
    references: ClassVar[tuple[str, ...]] = ("go", "wait", "idm")

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions, in the order of their numbers."""
        return ACTIONS

    @property
    def action_space(self) -> spaces.Discrete | spaces.Box:
        """Space of one action: `n_actions` numbers, or values in [-1, 1]."""
        return space_of(self.options)

    @property
    def view(self) -> View:
        """The crossing as pictures show it."""
        from socialiq.worlds.intersection.views import VIEW  # imports Numba

        return VIEW

    def batch(  # pyright: ignore[reportIncompatibleMethodOverride]  one argument more
        self, size: int, threads: int = 1, back_end: BackEnd = "core", traced: bool = False
    ) -> Batch:
        """Return episodes side by side; see `Batch`."""
        return Batch(self.options, size, threads, back_end, traced)

    def driver(self, name: str, seed: int = 0) -> Policy:
        """Return a rule-based driver of `policies.NAMES`.

        Raises:
            UserError: If the name is unknown.
        """
        return policies.policy(name, seed, self.options)

    def largest_difference(self, weights: tuple[float, float]) -> float | None:
        """Return the most by which two episodes can differ; None where nothing limits progress."""
        if is_unlimited(self.options):
            return None
        sides = env_range(self.options), social_range(self.options)
        return sum(abs(w) * side.width for w, side in zip(weights, sides, strict=True))

    def other_traffic(self) -> dict[str, dict[str, Any]]:
        """Return the other populations of drivers, and connected lanes switched the other way."""
        populations = [name for name in POPULATIONS if name != self.options.population]
        connected = not self.options.connected_lanes
        sight = "who see across connected lanes" if connected else "who see their own lane only"
        return {
            **{f"drivers of population {name}": {"population": name} for name in populations},
            f"drivers {sight}": {"connected_lanes": connected},
        }


def make(options: Options) -> Intersection:
    """Build the world."""
    return Intersection(options)


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
