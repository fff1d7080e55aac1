"""Options that every road has, and the record of them that the compiled core reads."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_type_hints

import numpy as np

from socialiq.errors import UserError, one_of

Zone = Literal["last_20_m", "last_8_m", "beyond_8_m", "travelled_8_m"]
Counted = Literal["all", "cross", "approaching"]
Disruption = Literal["dead_zone", "literal"]
Crash = Literal["override", "add"]

MOST_SPEEDS = 8


@dataclass(frozen=True)
class ClockOptions:
    """Time of an episode.

    Attributes:
        simulation_frequency: Sub-steps of the physics per second.
        policy_frequency: Decisions per second; divides the simulation frequency.
        duration: Seconds after which an episode times out.
    """

    simulation_frequency: int = 10
    policy_frequency: int = 1
    duration: float = 20.0

    @property
    def frames(self) -> int:
        """Sub-steps of a decision."""
        return self.simulation_frequency // self.policy_frequency

    @property
    def decisions(self) -> int:
        """Number of decisions after which an episode times out."""
        return math.ceil(self.duration * self.policy_frequency)


@dataclass(frozen=True)
class EgoOptions:
    """Choices and sight of the ego.

    Attributes:
        target_speeds: Speeds in m/s, equally spaced, that the ego's speed control steps through.
        observed_vehicles: Rows of the observation, the ego's included.
    """

    target_speeds: tuple[float, ...] = (0.0, 4.5, 9.0)
    observed_vehicles: int = 10

    @property
    def max_speed(self) -> float:
        """Fastest target speed v_max, m/s."""
        return float(self.target_speeds[-1])


@dataclass(frozen=True)
class RewardOptions:
    """Options of the reward pair (thesis 4.1).

    Attributes:
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
    """

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


@dataclass(frozen=True)
class RoadOptions(RewardOptions, EgoOptions, ClockOptions):
    """Options of a road: time, ego and rewards.

    Dataclasses collect fields from the last base to the first; a road with more options places
    these between.

    Raises:
        UserError: If a value is not supported.
    """

    def __post_init__(self) -> None:
        kinds = get_type_hints(type(self))
        for name, kind in kinds.items():
            if get_args(kind) and isinstance(getattr(self, name), str):
                one_of(name, getattr(self, name), get_args(kind))
        for name in ("simulation_frequency", "policy_frequency"):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= 1):
                raise UserError(f"{name} must be a whole number of at least 1, got {value}")
        if self.simulation_frequency % self.policy_frequency:
            raise UserError(
                f"simulation_frequency {self.simulation_frequency} is not a multiple of "
                f"policy_frequency {self.policy_frequency}: choose one that is"
            )
        if not (self.duration > 0 and math.isfinite(self.duration)):
            raise UserError(f"duration must be a positive number of seconds, got {self.duration}")
        speeds = np.array(self.target_speeds, np.float64)
        rising = bool((np.diff(speeds) > 0).all() and np.isfinite(speeds).all())
        if not (2 <= len(speeds) <= MOST_SPEEDS and rising and speeds[-1] > 0):
            raise UserError(
                f"target_speeds must be 2 to {MOST_SPEEDS} rising speeds, the last above 0, "
                f"got {self.target_speeds}"
            )
        if not np.allclose(np.diff(speeds), speeds[1] - speeds[0]):
            raise UserError(f"target_speeds must be equally spaced, got {self.target_speeds}")
        rows = self.observed_vehicles
        if not (isinstance(rows, int) and rows >= 2):
            raise UserError(f"observed_vehicles must be a whole number of at least 2, got {rows}")
        for name, kind in kinds.items():
            if kind is float and not math.isfinite(getattr(self, name)):
                raise UserError(f"{name} must be a finite number, got {getattr(self, name)}")
        for name in ("progress_unit", "conflict_distance", "speed_cap"):
            if not getattr(self, name) > 0:
                raise UserError(f"{name} must be positive, got {getattr(self, name)}")

    @property
    def width(self) -> int:
        """Number of values of a continuous action; 0 if actions are discrete."""
        return 0

    @property
    def continuous(self) -> bool:
        """Whether the ego's actions are continuous."""
        return self.width > 0


SIGNALS = (
    "progress",
    "speed",
    "step",
    "collision",
    "arrival",
    "timeout",
    "yielding",
    "disruption",
    "neighbour_collision",
)
"""All signals, those of r_env first; a signal's weight is the option of that name."""

ENV_SIGNALS = SIGNALS[:6]
SOCIAL_SIGNALS = SIGNALS[6:]

SETTINGS = np.dtype(
    [
        ("dt", np.float64),  # s of a sub-step
        ("decision", np.float64),  # s between decisions
        ("duration", np.float64),
        ("frames", np.int64),  # sub-steps of a decision
        ("warm_up", np.int64),  # sub-steps before the ego enters
        ("rule_period", np.int64),  # sub-steps between applications of the road rules
        ("tie", np.float64),
        ("initial_vehicle_count", np.int64),
        ("spawn_probability", np.float64),
        ("destination", np.int64),  # arm; 0 draws one
        ("n_speeds", np.int64),
        ("target_speeds", np.float64, (MOST_SPEEDS,)),
        ("connected_lanes", np.bool_),
        ("population", np.float64, (5, 4)),
        ("progress_unit", np.float64),
        ("zone", np.int64),  # place in the option's list of names
        ("counted", np.int64),
        ("disruption", np.int64),
        ("crash", np.int64),
        ("conflict_distance", np.float64),
        ("max_speed", np.float64),
        ("speed_threshold", np.float64),
        ("speed_cap", np.float64),
        ("weights", np.float64, (len(SIGNALS),)),
        ("continuous", np.bool_),  # the ego's record holds its commands
        ("offroad_terminal", np.bool_),
    ],
    align=True,
)
"""Record of one set of options; from `warm_up` on some fields are of the intersection alone."""


def settings_of(options: RoadOptions) -> np.ndarray:
    """Return the record as an array of one element.

    What only the intersection has stays 0; `intersection.settings` writes it.
    """
    record = np.zeros(1, SETTINGS)
    for name in SETTINGS.names or ():
        if hasattr(RoadOptions, name) and name not in ("target_speeds", *_NAMED):
            record[name] = getattr(options, name)
    for name, kind in _NAMED.items():
        record[name] = get_args(kind).index(getattr(options, name))
    # highway-env divides in this order, and its rounding decides how many sub-steps fit.
    record["dt"] = 1 / options.simulation_frequency
    record["decision"] = 1 / options.policy_frequency
    record["n_speeds"] = len(options.target_speeds)
    record["target_speeds"][0, : len(options.target_speeds)] = options.target_speeds
    record["weights"] = [getattr(options, f"{name}_weight") for name in SIGNALS]
    return record


_NAMED = {"zone": Zone, "counted": Counted, "disruption": Disruption, "crash": Crash}

_UNITS = (
    "policy_frequency",  # rewards come with each decision
    "duration",
    "target_speeds",  # the fastest is what speeds are relative to
    "progress_unit",
    *_NAMED,
    "conflict_distance",
    "speed_threshold",
    "speed_cap",
)


def reward_definition(options: RoadOptions) -> dict[str, Any]:
    """Return the weights and units that define the reward pair of a road, as JSON."""
    sides = {"env": ENV_SIGNALS, "social": SOCIAL_SIGNALS}
    weights = {
        side: {name: getattr(options, f"{name}_weight") for name in signals}
        for side, signals in sides.items()
    }
    return weights | {"units": {name: getattr(options, name) for name in _UNITS}}
