"""The intersection as a world, and the limits of its rewards."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from socialiq.types import Policy
from socialiq.worlds.highway.options import ACCELERATION_RANGE, MAX_SPEED
from socialiq.worlds.highway.scenes import Scene
from socialiq.worlds.highway.world import SceneWorld
from socialiq.worlds.intersection import atlas, policies
from socialiq.worlds.intersection import options as scenario
from socialiq.worlds.intersection.core.geometry import CROSSING
from socialiq.worlds.intersection.options import CrosswalkOptions, Options

if TYPE_CHECKING:
    from socialiq.worlds.highway.render import View


@dataclass(frozen=True)
class Intersection(SceneWorld):
    """highway-env's unsignalised crossing with the thesis' reward pair (5.1.3)."""

    options: Options = field(  # pyright: ignore[reportIncompatibleVariableOverride]  it is frozen
        default_factory=Options
    )
    scene: Scene = field(default=CROSSING, kw_only=True, hash=False, repr=False)

    drivers: ClassVar[tuple[str, ...]] = policies.NAMES  # pyright: ignore[reportIncompatibleMethodOverride]
    references: ClassVar[tuple[str, ...]] = ("go", "wait", "idm")

    @property
    def shipped(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Studies of the atlas whose policies have the world's kind of actions."""
        return atlas.studies_of(self.options.width)

    @property
    def view(self) -> View:
        """The crossing as pictures show it."""
        from socialiq.worlds.intersection.views import Crossing  # imports Numba

        if self.options.left_hand:
            return super().view
        return Crossing(self.walks, self._rides)

    @property
    def _is_straight(self) -> bool:
        return self.options.destination == "straight"

    def driver(self, name: str, seed: int = 0) -> Policy:
        """Return a rule-based driver.

        Args:
            name: One of `policies.NAMES`.
            seed: Seed of the draws of `random`.

        Raises:
            UserError: If the name is unknown.
        """
        return policies.policy(name, seed, self.options)

    def largest_difference(self, weights: tuple[float, float]) -> float | None:
        """Return the most by which two episodes can differ; None where no limit is known.

        An ego that steers may pass near the centre of a turn, where a metre driven is any part of
        it.
        """
        if self.options.continuous and self.options.destination != "straight":
            return None
        if self.effects or isinstance(self.options, CrosswalkOptions):
            return None
        sides = env_range(self.options), social_range(self.options)
        return sum(abs(w) * (high - low) for w, (low, high) in zip(weights, sides, strict=True))

    def other_traffic(self) -> dict[str, dict[str, Any]]:
        """Return options of other traffic: other populations, and lanes connected or not."""
        populations = {"highway_env", "thesis"} - {self.options.population}
        connected = not self.options.connected_lanes
        sight = "who see across connected lanes" if connected else "who see their own lane only"
        return {
            **{
                f"drivers of population {name}": {"population": name}
                for name in sorted(populations)
            },
            f"drivers {sight}": {"connected_lanes": connected},
        }


_INSIDE_TURN = 1.3
"""Largest advance along a route per metre driven: on the tightest turn, of radius 9 m, within the
half-width of a lane, 2 m, of its centre (9 / 7)."""


def decisions(options: Options) -> int:
    """Return the number of decisions until the time is over, counted as the core counts it."""
    time = 0.0
    count = 0
    while time < options.duration:
        time += 1 / options.policy_frequency
        count += 1
    return count


def largest_progress(options: Options) -> float:
    """Return the largest value of the signal `progress`, either way.

    The ego enters at the speed limit and its speed control doesn't overshoot a target speed, so it
    drives at most the largest of these speeds times the time between decisions. On the inside of a
    turn that is more of the route. With continuous actions it drives at most `MAX_SPEED` and what
    a sub-step adds.
    """
    fastest = max(scenario.SPEED_LIMIT, *map(abs, options.target_speeds))
    if options.continuous:
        fastest = MAX_SPEED + ACCELERATION_RANGE[1] / options.simulation_frequency
    return _INSIDE_TURN * fastest / options.policy_frequency / options.progress_unit


def env_range(options: Options) -> tuple[float, float]:
    """Return limits of an episode's sum of r_env (Eq 4.1), for any driver in any traffic.

    Collision and arrival replace the last decision's reward, a timeout adds to it.
    """
    moved = abs(options.progress_weight) * largest_progress(options)
    held = options.speed_weight
    low = -moved + min(held, 0.0) + options.step_weight
    high = moved + max(held, 0.0) + options.step_weight
    earlier = decisions(options) - 1
    late = options.timeout_weight
    terminal = options.collision_weight, options.arrival_weight
    least = min(earlier * low, 0.0) + min(*terminal, low, low + late)
    return least, max(earlier * high, 0.0) + max(*terminal, high, high + late)


def social_range(options: Options) -> tuple[float, float]:
    """Return limits of an episode's sum of r_social (Eq 4.2), for any driver in any traffic.

    In every decision each other vehicle counts at most once with each of its two signals, which
    lie in [0, 1]. At the first there are at most `initial_vehicle_count` others, and every later
    one adds at most one.
    """
    count = decisions(options)
    vehicles = count * options.initial_vehicle_count + count * (count - 1) // 2
    weights = options.yielding_weight, options.disruption_weight
    crash = options.neighbour_collision_weight
    least = vehicles * sum(min(weight, 0.0) for weight in weights) + min(crash, 0.0)
    return least, vehicles * sum(max(weight, 0.0) for weight in weights) + max(crash, 0.0)
