"""Options of the intersection, and the named populations of its drivers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args, get_type_hints

import numpy as np

from socialiq.errors import UserError, one_of


class Normal(NamedTuple):
    """Normal distribution whose draws are clipped to an interval."""

    mean: float
    deviation: float
    low: float
    high: float


class Population(NamedTuple):
    """Distributions that a driver draws from when it enters, in the order of the fields.

    The exponent of the free-road term is always drawn first, uniformly from 3.5 to 4.5, as
    highway-env does. A field with deviation 0 draws nothing.

    Attributes:
        desired_speed: m/s. Infinite: the driver starts with the speed it enters at, and takes the
            road's limit after its first yield, as in highway-env.
        time_headway: s.
        jam_distance: m.
        max_acceleration: m/s².
        comfort_deceleration: m/s², positive.
    """

    desired_speed: Normal
    time_headway: Normal
    jam_distance: Normal
    max_acceleration: Normal
    comfort_deceleration: Normal


def _fixed(value: float) -> Normal:
    return Normal(value, 0.0, value, value)


POPULATIONS = {
    "highway_env": Population(
        desired_speed=_fixed(float("inf")),
        time_headway=_fixed(1.5),
        jam_distance=_fixed(7.0),
        max_acceleration=_fixed(6.0),
        comfort_deceleration=_fixed(3.0),
    ),
    "thesis": Population(
        desired_speed=Normal(8.0, 1.0, 5.0, 10.0),
        time_headway=Normal(1.5, 0.4, 0.5, 2.5),
        jam_distance=Normal(7.0, 1.5, 3.0, 11.0),
        max_acceleration=Normal(6.0, 1.0, 3.0, 9.0),
        comfort_deceleration=Normal(3.0, 0.5, 1.5, 4.5),
    ),
}
"""Populations: `highway_env` as in the real environment, `thesis` as described in 5.1.3.

The thesis prints no distribution. Those of `thesis` are centred on highway-env's values, with
spreads of the size that calibrations of the model report, and clipped to physical values.
"""


Zone = Literal["last_20_m", "last_8_m", "beyond_8_m", "travelled_8_m"]
Counted = Literal["all", "cross", "approaching"]
Disruption = Literal["dead_zone", "literal"]
Crash = Literal["override", "add"]
Destination = Literal["right", "left", "straight", "random"]

MOST_SPEEDS = 8

ContinuousActions = Literal["continuous", "continuous_steering"]


@dataclass(frozen=True)
class Options:
    """Scenario as configured in thesis 5.1.3, and options of its reward (4.1).

    Attributes:
        simulation_frequency: Sub-steps of the physics per second.
        policy_frequency: Decisions per second; divides the simulation frequency.
        duration: Seconds after which an episode times out.
        initial_vehicle_count: highway-env's number: one spawn less than this is tried at the
            start, each with probability 0.6.
        spawn_probability: Probability of a spawn attempt after each decision.
        destination: Destination of the ego; "left" is highway-env's o1. "random" draws one of the
            three.
        target_speeds: Speeds in m/s, equally spaced, that the ego's speed control steps through.
        observed_vehicles: Rows of the observation, the ego's included.
        connected_lanes: Whether drivers search for leaders beyond the end of their lane, as
            in intersection-v2.
        population: Distribution of the other drivers' parameters; a name of `POPULATIONS`.
        canonical: Break exact ties by the order of vehicles and lanes, not by rounding.
        progress_unit: Metres of advance that count as 1.
        zone: Influence zone of the ego. "beyond_8_m" takes the thesis' 8 m as lane coordinate,
            "travelled_8_m" as distance since the start; the others measure from the junction.
        counted: Which neighbours within the conflict distance count: all, those that come from
            another arm and haven't left the junction, or of these only those on an approach.
        disruption: Eq 4.2's loss of speed with a dead zone, as in the text, or as printed,
            which charges every neighbour at least the threshold.
        crash: Whether the ego's collision replaces r_social or is added to it.
        conflict_distance: Metres within which a neighbour counts.
        progress_weight: w_p.
        speed_weight: w_v.
        collision_weight: w_c.
        arrival_weight: w_a.
        step_weight: w_s.
        timeout_weight: w_t.
        yielding_weight: w_y.
        disruption_weight: w_d.
        neighbour_collision_weight: Weight in r_social of the ego's collision.
        speed_threshold: v_thresh of Eq 4.2, m/s.
        speed_cap: v_cap of Eq 4.2, m/s.

    Raises:
        UserError: If a value is not supported.
    """

    simulation_frequency: int = 10
    policy_frequency: int = 1
    duration: float = 20.0
    initial_vehicle_count: int = 5
    spawn_probability: float = 0.3
    destination: Destination = "left"
    target_speeds: tuple[float, ...] = (0.0, 4.5, 9.0)
    observed_vehicles: int = 10
    connected_lanes: bool = False
    population: str = "highway_env"
    canonical: bool = False
    progress_unit: float = 28.0
    zone: Zone = "last_20_m"
    counted: Counted = "all"
    disruption: Disruption = "dead_zone"
    crash: Crash = "override"
    conflict_distance: float = 20.0
    progress_weight: float = 2.0
    speed_weight: float = 0.5
    collision_weight: float = -2.0
    arrival_weight: float = 1.0
    step_weight: float = -0.15
    timeout_weight: float = -0.5
    yielding_weight: float = 0.2
    disruption_weight: float = -1.0
    neighbour_collision_weight: float = -5.0
    speed_threshold: float = 1.0
    speed_cap: float = 5.0

    def __post_init__(self) -> None:
        for name, kind in get_type_hints(Options).items():
            if get_args(kind) and isinstance(getattr(self, name), str):
                one_of(name, getattr(self, name), get_args(kind))
        one_of("population", self.population, tuple(POPULATIONS))
        self._check_clock()
        self._check_traffic()
        self._check_ego()
        for name, kind in get_type_hints(Options).items():
            if kind is float and not math.isfinite(getattr(self, name)):
                raise UserError(f"{name} must be a finite number, got {getattr(self, name)}")
        for name in ("progress_unit", "conflict_distance", "speed_cap"):
            if not getattr(self, name) > 0:
                raise UserError(f"{name} must be positive, got {getattr(self, name)}")

    def _check_clock(self) -> None:
        for name in ("simulation_frequency", "policy_frequency"):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= 1):
                raise UserError(f"{name} must be a whole number of at least 1, got {value}")
        if self.simulation_frequency % self.policy_frequency:
            raise UserError(
                f"simulation_frequency {self.simulation_frequency} is not a multiple of "
                f"policy_frequency {self.policy_frequency}: choose one that is"
            )
        if self.simulation_frequency < 2:
            raise UserError(
                "simulation_frequency must be at least 2: road rules apply twice a second"
            )
        if not (self.duration > 0 and math.isfinite(self.duration)):
            raise UserError(f"duration must be a positive number of seconds, got {self.duration}")

    def _check_traffic(self) -> None:
        if not (isinstance(self.initial_vehicle_count, int) and self.initial_vehicle_count >= 1):
            raise UserError(
                "initial_vehicle_count must be a whole number of at least 1, "
                f"got {self.initial_vehicle_count}"
            )
        if not 0 <= self.spawn_probability <= 1:
            raise UserError(
                f"spawn_probability must lie between 0 and 1, got {self.spawn_probability}"
            )

    def _check_ego(self) -> None:
        speeds = np.array(self.target_speeds, np.float64)
        rising = bool((np.diff(speeds) > 0).all() and np.isfinite(speeds).all())
        if not (2 <= len(speeds) <= MOST_SPEEDS and rising and speeds[-1] > 0):
            raise UserError(
                f"target_speeds must be 2 to {MOST_SPEEDS} rising speeds, the last above 0, "
                f"got {self.target_speeds}"
            )
        if not np.allclose(np.diff(speeds), speeds[1] - speeds[0]):
            raise UserError(f"target_speeds must be equally spaced, got {self.target_speeds}")
        if not (isinstance(self.observed_vehicles, int) and self.observed_vehicles >= 2):
            raise UserError(
                "observed_vehicles must be a whole number of at least 2, "
                f"got {self.observed_vehicles}"
            )

    @property
    def continuous(self) -> bool:
        """Whether the ego's actions are continuous."""
        return False

    @property
    def max_speed(self) -> float:
        """Fastest target speed v_max, m/s."""
        return float(self.target_speeds[-1])

    @property
    def frames(self) -> int:
        """Sub-steps of a decision."""
        return self.simulation_frequency // self.policy_frequency

    @property
    def decisions(self) -> int:
        """Number of decisions after which an episode times out."""
        return math.ceil(self.duration * self.policy_frequency)

    @property
    def capacity(self) -> int:
        """Largest number of vehicles of an episode: every spawn attempt, and the ego."""
        return self.initial_vehicle_count + 1 + self.decisions + 1


@dataclass(frozen=True)
class ContinuousOptions(Options):
    """Options of the same scenario with highway-env's continuous actions.

    Nothing steers along the lane for the ego: with acceleration alone it drives straight on.

    Attributes:
        destination: As of `Options`; only its route's progress depends on it. With acceleration
            alone it must be "straight".
        actions: "continuous": acceleration alone. "continuous_steering": acceleration, then the
            angle of the front wheels.

    Raises:
        UserError: As `Options`, and if the ego can't reach its destination.
    """

    destination: Destination = "straight"
    actions: ContinuousActions = "continuous"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("actions", self.actions, get_args(ContinuousActions))
        if self.actions == "continuous" and self.destination != "straight":
            raise UserError(
                f"the ego can't reach '{self.destination}' by acceleration alone: choose the "
                "destination 'straight', or the actions 'continuous_steering'"
            )

    @property
    def continuous(self) -> bool:
        """Whether the ego's actions are continuous."""
        return True
