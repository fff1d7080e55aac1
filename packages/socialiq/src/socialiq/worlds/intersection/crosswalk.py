"""The intersection with people on foot and on bicycles: options, and what is done to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.social.angle import check_class_angle, class_weights
from socialiq.types import ByClass, RewardPair
from socialiq.worlds.highway.options import ROWS, Buffers
from socialiq.worlds.intersection.options import Options

CROSSWALK = "-crosswalk"
"""Part of the name of a world with people on foot."""

SIGNALS = {
    "pedestrian": ("pedestrian_delay", "pedestrian_encounter", "pedestrian_hit"),
    "cyclist": ("cyclist_delay", "cyclist_encounter", "cyclist_hit", "cyclist_braking"),
}
"""Signals of a decision by class: seconds that people lose by waiting and would not without the
ego, the closest encounter with it, 0 to 1, and whether it hits a person; of cyclists the speed too
that they lose by braking for it, m/s."""

PERSON = 2.0  # in the place of a vehicle's presence in an observation (`core.people.CLASS`)

LONGEST = 1.5  # durations of an episode for which arrivals are drawn: the usual end of effects


@dataclass(frozen=True)
class CrosswalkOptions(Options):
    """Options of the intersection with a crosswalk over each arm and bicycle lanes beside it.

    Raises:
        UserError: As `Options`, and if a value is not supported.
    """

    pedestrian_rate: float = 0.1  # arrivals at each arm per s
    walking_speed: float = 1.4  # m/s, mean
    walking_speed_sd: float = 0.25
    accepted_gap: float = 4.5  # s until the next vehicle arrives, mean of those accepted at first
    accepted_gap_sd: float = 0.7
    impatience: float = 0.15  # s less of the gap for each second of waiting
    least_gap: float = 2.0  # s accepted at least
    observed_pedestrians: int = 6  # rows of the observation behind those of the vehicles
    cyclist_rate: float = 0.0  # arrivals at each arm per s
    cycling_speed: float = 4.6  # m/s, mean
    cycling_speed_sd: float = 1.1
    cyclist_gap: float = 4.0  # as of people on foot
    cyclist_gap_sd: float = 0.7
    cyclist_least_gap: float = 2.0
    cyclist_impatience: float = 0.15
    observed_cyclists: int = 4  # rows behind those of people on foot, if any person rides
    class_angle: float = 45.0  # angle b of the class weights (cos b, sin b) in r_social, degrees
    pedestrian_delay_weight: float = -0.2  # of a second that a person waits because of the ego
    pedestrian_encounter_weight: float = -1.0  # of a decision's closest encounter
    pedestrian_hit_weight: float = -20.0  # in r_social of people on foot
    pedestrian_collision_weight: float = -25.0  # in r_env, beside `collision_weight`
    cyclist_delay_weight: float = -0.2  # as of people on foot
    cyclist_encounter_weight: float = -1.0
    cyclist_hit_weight: float = -20.0
    cyclist_braking_weight: float = -0.1  # of 1 m/s that a cyclist loses by braking for the ego
    cyclist_collision_weight: float = -25.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_class_angle(self.class_angle)
        for rate, speed, speed_sd, gap, gap_sd, least_gap, impatience, rows in _COLUMNS.values():
            if not 0 <= (value := getattr(self, rate)) <= 1:
                raise UserError(f"{rate} must be 0 to 1 a second, got {value}")
            if not (isinstance(value := getattr(self, rows), int) and value >= 0):
                raise UserError(f"{rows} must be a whole number of at least 0, got {value}")
            for name in (speed, gap, least_gap):
                if not getattr(self, name) > 0:
                    raise UserError(f"{name} must be positive, got {getattr(self, name)}")
            for name in (speed_sd, gap_sd, impatience):
                if not getattr(self, name) >= 0:
                    raise UserError(f"{name} must be at least 0, got {getattr(self, name)}")

    @property
    def observed_rows(self) -> int:
        """Rows of the observation: vehicles, then people of each class."""
        return self.narrow_rows[0] + (self.observed_cyclists if self.riders else 0)

    @property
    def narrow_rows(self) -> tuple[int, ...]:
        """Rows without cyclists, and rows of vehicles alone."""
        return self.observed_vehicles + self.observed_pedestrians, self.observed_vehicles

    @property
    def first_walker(self) -> int:
        """Slot of the first person: behind all vehicles up to the usual end of effects."""
        return super().capacity + math.ceil((LONGEST - 1) * self.decisions)

    @property
    def walkers(self) -> int:
        """Number of people that can arrive, on foot or on a bicycle."""
        return self._arrivals(self.pedestrian_rate) + self.riders

    @property
    def riders(self) -> int:
        """Number of cyclists that can arrive."""
        return self._arrivals(self.cyclist_rate)

    def _arrivals(self, rate: float) -> int:
        """Return the expected number of arrivals and four standard deviations."""
        expected = 4 * rate * LONGEST * self.duration
        return math.ceil(expected + 4 * math.sqrt(expected))

    @property
    def people(self) -> np.ndarray:
        """The core's table of people by class, (class, column)."""
        table = np.array([[getattr(self, name) for name in row] for row in _COLUMNS.values()])
        table[1, ROWS] *= self.riders > 0
        return table

    @property
    def signals(self) -> tuple[str, ...]:
        """`SIGNALS` of the classes that there are; pedestrians are always one."""
        return SIGNALS["pedestrian"] + (SIGNALS["cyclist"] if self.riders else ())

    @property
    def capacity(self) -> int:
        """Number of records of an episode: vehicles, then people."""
        return self.first_walker + self.walkers

    @property
    def definition(self) -> dict[str, Any]:
        """Weights by class of the reward, as JSON, beside those of any road."""
        weights = {name: getattr(self, f"{name}_weight") for name in self.signals}
        collision = {"pedestrian_collision": self.pedestrian_collision_weight}
        collision |= {"cyclist_collision": self.cyclist_collision_weight} if self.riders else {}
        classes = class_weights(self.class_angle)._asdict()
        return {"vulnerable": weights, "of_ego": collision, "classes": classes}


_COLUMNS = {
    "pedestrian": (
        "pedestrian_rate", "walking_speed", "walking_speed_sd", "accepted_gap", "accepted_gap_sd",
        "least_gap", "impatience", "observed_pedestrians",
    ),
    "cyclist": (
        "cyclist_rate", "cycling_speed", "cycling_speed_sd", "cyclist_gap", "cyclist_gap_sd",
        "cyclist_least_gap", "cyclist_impatience", "observed_cyclists",
    ),
}  # fmt: skip
"""Options of each class, by the columns of `highway.options.SETTINGS.people`."""


def people(options: CrosswalkOptions, buffers: Buffers) -> np.ndarray:
    """Return the records of people, on foot and then on bicycles, (batch, person), no copy."""
    return buffers.vehicles[:, options.first_walker :]


def signals_of(options: CrosswalkOptions, buffers: Buffers) -> dict[str, np.ndarray]:
    """Return the signals of the last decision, each (batch,); fields are those of the core."""
    everybody, signals = people(options, buffers), dict[str, Any]()
    on_foot = everybody.shape[1] - options.riders
    for names, records in zip(
        SIGNALS.values(), (everybody[:, :on_foot], everybody[:, on_foot:]), strict=True
    ):
        columns = (
            records["max_acceleration"].sum(axis=1),
            records["comfort_deceleration"].max(axis=1, initial=0.0),
            records["crashed"].any(axis=1).astype(np.float64),
            records["push_x"].sum(axis=1),
        )
        signals |= dict(zip(names, columns, strict=False))
    return {name: signals[name] for name in options.signals}


def begin_decision(options: CrosswalkOptions, buffers: Buffers, rows: np.ndarray) -> None:
    """Set to 0 in some rows what the core adds up in a decision."""
    for name in ("acceleration", "max_acceleration", "comfort_deceleration", "push_x"):
        people(options, buffers)[name][rows] = 0.0


def by_class(
    options: CrosswalkOptions, rewards: RewardPair, signals: dict[str, np.ndarray], parts: bool
) -> RewardPair:
    """Return the pair with the part of people; r_social is by class or weighed by it."""
    env = rewards.env + options.pedestrian_collision_weight * signals["pedestrian_hit"]
    if options.riders:
        env = env + options.cyclist_collision_weight * signals["cyclist_hit"]
    vulnerable = sum(getattr(options, f"{name}_weight") * signals[name] for name in options.signals)
    if parts:
        return RewardPair(env, ByClass(rewards.social, vulnerable))
    weights = class_weights(options.class_angle)
    return RewardPair(env, weights.vehicle * rewards.social + weights.vulnerable * vulnerable)
