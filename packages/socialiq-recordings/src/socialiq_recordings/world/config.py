"""Options of a world made of recordings."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from socialiq.errors import UserError, one_of
from socialiq.worlds.intersection.options import Options

Lights = Literal["inferred", "none"]

SUB_STEPS = 10  # sub-steps of a second
LEVELS = (-4.0, -2.0, -1.0, 0.0, 1.0, 2.0)
"""m/s²; default actions. Those of recorded decisions, and a hard braking."""

AS_DRIVER = -1  # action with which the ego drives as a driver of the population
_LONGEST = 600.0  # s; of an episode


@dataclass(frozen=True)
class WorldConfig:
    """Options of a world made of recordings."""

    policy_rate: int = 1  # decisions per second; divides `SUB_STEPS` and the recordings' rates
    # accelerations that the ego can choose, m/s², ascending, one of them 0
    levels: tuple[float, ...] = LEVELS
    duration: float = 20.0  # s after which an episode times out
    observed_vehicles: int = 12  # rows of the observation, the ego's included
    # "inferred": lines are closed while the first vehicle of a lane stood there without a reason
    # that the model of the drivers knows. "none": no line is ever closed
    lights: Lights = "inferred"
    slack: float = 0.3  # m by which vehicles are narrower and shorter than recorded
    # weights and units of the reward pair; its rates, duration, speeds and rows are replaced by
    # those of this world
    rewards: Options = field(default_factory=Options)

    def __post_init__(self) -> None:
        if self.policy_rate < 1 or SUB_STEPS % self.policy_rate:
            raise UserError(f"policy rate must be 1, 2, 5 or 10, got {self.policy_rate}")
        steps = [b - a for a, b in itertools.pairwise(self.levels)]
        if len(self.levels) < 2 or not all(0 < step < math.inf for step in steps):
            raise UserError(f"levels must be two or more ascending numbers, got {self.levels}")
        if 0.0 not in self.levels or not math.isfinite(self.levels[0]):
            raise UserError(f"levels must have 0 among them, got {self.levels}")
        if not 1 / self.policy_rate <= self.duration <= _LONGEST:
            raise UserError(
                f"duration must be from one decision to {_LONGEST:g} s, got {self.duration:g}"
            )
        if not 2 <= self.observed_vehicles <= 100:
            raise UserError(f"observed vehicles must be 2 to 100, got {self.observed_vehicles}")
        if not (math.isfinite(self.slack) and 0 <= self.slack <= 1):
            raise UserError(f"slack must be from 0 to 1 m, got {self.slack}")
        one_of("lights", self.lights, get_args(Lights))

    @property
    def frames(self) -> int:
        """Sub-steps of a decision."""
        return SUB_STEPS // self.policy_rate

    @property
    def decisions(self) -> int:
        """Decisions of an episode that times out."""
        return math.ceil(self.duration * self.policy_rate - 1e-9)
