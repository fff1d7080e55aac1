"""Options of the intersection, its driver, and the records of its core."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from socialiq.errors import UserError
from socialiq.worlds.highway import ego
from socialiq.worlds.highway.options import (
    VEHICLE,
    AgentOptions,
    Buffers,
    ClockOptions,
    ControlOptions,
    EgoOptions,
    RewardOptions,
    RoadOptions,
    TrafficOptions,
)
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.highway.populations import MULTIPLES, Driver
from socialiq.worlds.highway.scenes import sight

DRIVER = Driver(
    speed_limit=10.0,
    time_headway=1.5,
    jam_distance=7.0,
    max_acceleration=6.0,
    comfort_deceleration=3.0,
)
"""highway-env's driver of the intersection."""

POPULATIONS = {name: multiples.of(DRIVER) for name, multiples in MULTIPLES.items()}
"""Populations of its drivers."""

Destination = Literal["right", "left", "straight", "random"]


@dataclass(frozen=True)
class _SpawnOptions:
    """Entry of vehicles."""

    # highway-env's number: one spawn less is tried at the start, each with probability 0.6
    initial_vehicle_count: int = 5
    spawn_probability: float = 0.3  # of a spawn attempt after each decision
    destination: Destination = "left"  # of the ego: highway-env's o1; "random" draws one of three


@dataclass(frozen=True)
class Options(RoadOptions, RewardOptions, TrafficOptions, EgoOptions, _SpawnOptions, ClockOptions):
    """Scenario as configured in thesis 5.1.3, and options of its reward (4.1).

    Fields stand in the order of the bases from last to first, which names of scenarios have; the
    bases describe them.

    Raises:
        UserError: If a value is not supported.
    """

    def __post_init__(self) -> None:
        if not (isinstance(self.initial_vehicle_count, int) and self.initial_vehicle_count >= 1):
            raise UserError(
                "initial_vehicle_count must be a whole number of at least 1, "
                f"got {self.initial_vehicle_count}"
            )
        if not 0 <= self.spawn_probability <= 1:
            raise UserError(
                f"spawn_probability must lie between 0 and 1, got {self.spawn_probability}"
            )
        super().__post_init__()
        if self.simulation_frequency < 2:
            raise UserError(
                "simulation_frequency must be at least 2: road rules apply twice a second"
            )

    @property
    def capacity(self) -> int:
        """Largest number of vehicles of an episode: every spawn attempt, and the agents."""
        return self.initial_vehicle_count + self.agents + self.decisions + 1

    @property
    def usual_driver(self) -> Driver:
        """highway-env's driver of this road."""
        return DRIVER

    @property
    def exits(self) -> dict[Destination, int]:
        """Number of the arm of each exit in right-hand traffic; 0 draws one."""
        return {"random": 0, "left": 1, "straight": 2, "right": 3}

    @property
    def of_traffic(self) -> dict[str, Any]:
        """Fields of the SETTINGS record of vehicles that arrive, by name."""
        exit = self.destination
        if self.left_hand:  # arms of a mirror image are numbered the other way round
            exit = _MIRRORED.get(exit, exit)
        return {
            "warm_up": 3 * self.simulation_frequency,
            "rule_period": int(1 / (1 / self.simulation_frequency) / 2),
            "destination": self.exits[exit],
            "own_frame": isinstance(self, AgentOptions) and self.frame == "own",
        }


@dataclass(frozen=True)
class ContinuousOptions(ControlOptions, Options):  # pyright: ignore[reportIncompatibleVariableOverride]
    """Options of the same scenario with highway-env's continuous actions.

    Raises:
        UserError: As `Options`, and if the ego can't reach its destination.
    """

    # as of `Options`; only its route's progress depends on it. With acceleration alone it must be
    # "straight"
    destination: Destination = "straight"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.actions == "continuous" and self.destination != "straight":
            raise UserError(
                f"the ego can't reach '{self.destination}' by acceleration alone: choose the "
                "destination 'straight', or the actions 'continuous_steering'"
            )


@dataclass(frozen=True)
class CrosswalkOptions(PeopleOptions, Options):
    """Options of the intersection with a crosswalk over each arm, and bicycle lanes along the arms.

    Raises:
        UserError: As `Options` and `PeopleOptions`.
    """


@dataclass(frozen=True)
class WalkedContinuousOptions(ContinuousOptions, CrosswalkOptions):
    """Options of the intersection with crosswalks and continuous actions.

    Raises:
        UserError: As `ContinuousOptions` and `CrosswalkOptions`.
    """


@dataclass(frozen=True)
class FleetOptions(AgentOptions, Options):  # pyright: ignore[reportIncompatibleVariableOverride]
    """Options of the same scenario with several controlled vehicles.

    They enter as an ego does, on the arms from the south on in turn, and from the fifth on 20 m
    further back each round.

    Raises:
        UserError: As `Options`, and if there are too many agents.
    """


MULTI_AGENT: dict[str, Any] = {
    "simulation_frequency": 15,
    "duration": 13.0,
    "initial_vehicle_count": 10,
    "spawn_probability": 0.6,
    "observed_vehicles": 15,
    "ends": "joint",
    "frame": "world",
}
"""Options of `FleetOptions` as in highway-env's intersection-multi-agent-v0 and -v1; -v2 has
`connected_lanes` too."""


_MIRRORED: dict[Destination, Destination] = {"left": "right", "right": "left"}


ACTIONS = ("slower", "idle", "faster")
"""Actions: one target speed down, keep, one up, counted from the present speed."""

SLOWER, IDLE, FASTER = range(len(ACTIONS))
ALONG = np.array([(-1, 0), (0, 0), (1, 0)])
"""Change of the target speed's and of the target lane's number by each of `ACTIONS`."""

SPEED_LIMIT = DRIVER.speed_limit  # of every lane, m/s
POSITION_RANGE = ego.POSITION_RANGE  # m, seen as 1
SPEED_RANGE = ego.SPEED_RANGE  # m/s, seen as 1
EXIT_DISTANCE = 25.0  # m along an exit at which the ego has arrived
# The core asks for more metres than this number, highway-env for at least 25.
_ARRIVAL = float(np.nextafter(EXIT_DISTANCE, 0.0))
_SCALES = POSITION_RANGE, POSITION_RANGE, SPEED_RANGE, SPEED_RANGE
SIGHT = sight(*_SCALES, _ARRIVAL, relative=False, by_route=True)


def buffers_of(options: Options, size: int, traced: bool = False) -> Buffers:
    """Return empty buffers.

    Args:
        options: Options of the scenario.
        size: Number of episodes.
        traced: Whether there is space for every sub-step.

    Raises:
        UserError: If the size is not positive.
    """
    return Buffers.of(options, VEHICLE, options.capacity, size, traced)
