"""Declaration of a policy's behaviour: the data of `profile.toml`."""

from __future__ import annotations

import datetime
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from socialiq.audit.profile.scenario import World, identity, world_of
from socialiq.errors import UserError
from socialiq.social.angle_rule import AngleRule

WRONG_WORLD = '{path} is of another world: this scenario has "{value}"'


@dataclass(frozen=True)
class Margin:
    """Margins within which a policy counts as declared.

    Attributes:
        regret: Largest regret at the declared angle, in reward per episode.
        degrees: Largest distance of the calibrated angle.
        largest_loss: The most by which one driver's R(α) can lie below another's in an episode;
            None if no bound is declared.
    """

    regret: float
    degrees: float
    largest_loss: float | None = None


@dataclass(frozen=True)
class Reward:
    """Reward pair that the angle weighs: name, and SHA-256 of weights and units."""

    id: str
    sha256: str


@dataclass(frozen=True)
class Scenario:
    """Scenario of the audit: world, options that differ from the defaults, SHA-256."""

    world: str
    options: Mapping[str, Any]
    sha256: str


@dataclass(frozen=True)
class Floor:
    """Safety floor, independent of the angle; shares of episodes.

    Attributes:
        max_at_fault: Largest share of collisions caused by the ego's motion.
        max_struck: Largest share of collisions caused by another's motion.
        min_arrival: Smallest share of arrivals.
        max_timeout: Largest share of timeouts.
    """

    max_at_fault: float
    max_struck: float
    min_arrival: float
    max_timeout: float


@dataclass(frozen=True)
class Profile:
    """Declaration of a policy's social angle.

    Attributes:
        angle: Declared social angle, degrees in [0, 360).
        confidence: Confidence of the verdict.
        owner: Name of the owner.
        date: Date of the declaration.
        margin: Margins within which a policy counts as declared.
        reward: Reward pair that the angle weighs.
        scenario: Scenario of the audit.
        competence: Safety floor.
        source: The file's bytes.
        rule: Rule that gives the angle by the situation; None for the angle alone. With a rule,
            `angle` weighs whole episodes in tables and pictures, and doesn't decide.
    """

    angle: float
    confidence: float
    owner: str
    date: datetime.date
    margin: Margin
    reward: Reward
    scenario: Scenario
    competence: Floor
    source: bytes = field(repr=False, compare=False)
    rule: AngleRule | None = None

    @property
    def sha256(self) -> str:
        """SHA-256 of the file's bytes: one changed byte, and it is another declaration."""
        return hashlib.sha256(self.source).hexdigest()

    def world(self, allow_code: bool = False) -> World:
        """Build the world of the scenario.

        Args:
            allow_code: Whether an environment's module may be imported.

        Raises:
            UserError: If an environment can't be made, or differs from the declared environment.
        """
        world = world_of(self.scenario.world, self.scenario.options, allow_code)
        declared = (self.reward.id, self.reward.sha256, self.scenario.sha256)
        for (path, value), given in zip(identity(world).items(), declared, strict=True):
            if value != given:
                raise UserError(WRONG_WORLD.format(path=path, value=value))
        return world
