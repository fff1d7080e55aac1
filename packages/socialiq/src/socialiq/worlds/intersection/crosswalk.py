"""The intersection with people on foot: options, and what a decision does to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.social.angle import check_class_angle, class_weights
from socialiq.types import ByClass, RewardPair
from socialiq.worlds.highway.options import Buffers
from socialiq.worlds.intersection.options import Options

CROSSWALK = "-crosswalk"
"""Part of the name of a world with people on foot."""

SIGNALS = ("pedestrian_delay", "pedestrian_encounter", "pedestrian_hit")
"""Signals of a decision: seconds that people wait and would not without the ego, the closest
encounter with the ego, 0 to 1, and whether it hits a person."""

PERSON = 2.0  # in the place of a vehicle's presence in an observation (`core.pedestrians.CLASS`)

LONGEST = 1.5  # durations of an episode for which arrivals are drawn: the usual end of effects


@dataclass(frozen=True)
class CrosswalkOptions(Options):
    """Options of the intersection with a crosswalk over each arm.

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
    class_angle: float = 45.0  # angle b of the class weights (cos b, sin b) in r_social, degrees
    pedestrian_delay_weight: float = -0.2  # of a second that a person waits because of the ego
    pedestrian_encounter_weight: float = -1.0  # of a decision's closest encounter
    pedestrian_hit_weight: float = -20.0  # in r_social of people on foot
    pedestrian_collision_weight: float = -25.0  # in r_env, beside `collision_weight`

    def __post_init__(self) -> None:
        super().__post_init__()
        check_class_angle(self.class_angle)
        if not 0 <= self.pedestrian_rate <= 1:
            raise UserError(f"pedestrian_rate must be 0 to 1 a second, got {self.pedestrian_rate}")
        if not (isinstance(self.observed_pedestrians, int) and self.observed_pedestrians >= 0):
            raise UserError(
                "observed_pedestrians must be a whole number of at least 0, "
                f"got {self.observed_pedestrians}"
            )
        for name in ("walking_speed", "accepted_gap", "least_gap"):
            if not getattr(self, name) > 0:
                raise UserError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("walking_speed_sd", "accepted_gap_sd", "impatience"):
            if not getattr(self, name) >= 0:
                raise UserError(f"{name} must be at least 0, got {getattr(self, name)}")

    @property
    def observed_rows(self) -> int:
        """Rows of the observation: vehicles, then people."""
        return self.observed_vehicles + self.observed_pedestrians

    @property
    def first_walker(self) -> int:
        """Slot of the first person: behind all vehicles up to the usual end of effects."""
        return super().capacity + math.ceil((LONGEST - 1) * self.decisions)

    @property
    def walkers(self) -> int:
        """Number of people that can arrive: the expected number and four standard deviations."""
        expected = 4 * self.pedestrian_rate * LONGEST * self.duration
        return math.ceil(expected + 4 * math.sqrt(expected))

    @property
    def capacity(self) -> int:
        """Number of records of an episode: vehicles, then people."""
        return self.first_walker + self.walkers

    @property
    def definition(self) -> dict[str, Any]:
        """Weights by class of the reward, as JSON, beside those of any road."""
        weights = {name: getattr(self, f"{name}_weight") for name in SIGNALS}
        collision = {"pedestrian_collision": self.pedestrian_collision_weight}
        classes = class_weights(self.class_angle)._asdict()
        return {"vulnerable": weights, "of_ego": collision, "classes": classes}


def people(options: CrosswalkOptions, buffers: Buffers) -> np.ndarray:
    """Return the records of people, (batch, person), without a copy."""
    return buffers.vehicles[:, options.first_walker :]


def signals_of(options: CrosswalkOptions, buffers: Buffers) -> dict[str, np.ndarray]:
    """Return `SIGNALS` of the last decision, each (batch,); fields are those of the core."""
    records = people(options, buffers)
    signals: Any = (
        records["max_acceleration"].sum(axis=1),
        records["comfort_deceleration"].max(axis=1, initial=0.0),
        records["crashed"].any(axis=1).astype(np.float64),
    )
    return dict(zip(SIGNALS, signals, strict=True))


def begin_decision(options: CrosswalkOptions, buffers: Buffers, rows: np.ndarray) -> None:
    """Set to 0 in some rows what the core adds up in a decision."""
    for name in ("acceleration", "max_acceleration", "comfort_deceleration"):
        people(options, buffers)[name][rows] = 0.0


def by_class(
    options: CrosswalkOptions, rewards: RewardPair, signals: dict[str, np.ndarray], parts: bool
) -> RewardPair:
    """Return the pair with the part of people on foot; r_social is by class or weighed by it."""
    hit = signals["pedestrian_hit"]
    env = rewards.env + options.pedestrian_collision_weight * hit
    vulnerable = sum(getattr(options, f"{name}_weight") * signals[name] for name in SIGNALS)
    if parts:
        return RewardPair(env, ByClass(rewards.social, vulnerable))
    weights = class_weights(options.class_angle)
    return RewardPair(env, weights.vehicle * rewards.social + weights.vulnerable * vulnerable)
