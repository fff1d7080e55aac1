"""Audits by default declarations, of many policies on the same episodes."""

import contextlib
import datetime
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from socialiq import Margin, declare
from socialiq.audit.evidence.collect import drive_references
from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Evidence, Outcomes, Reference
from socialiq.audit.profile.profile import Floor, Profile
from socialiq.audit.profile.template import USUAL, floor_at, possible_loss
from socialiq.audit.request import Trust, dial_angles, resolve_references
from socialiq.audit.verdict.verdict import Decisive, decide
from socialiq.types import Policy
from socialiq.worlds.registry import make
from socialiq.worlds.world import World

DAY = datetime.date(2026, 11, 27)
"""Date of the declarations; no verdict depends on it."""
RESAMPLES = 2000
UNKNOWN = {"kind": "python", "source": "", "sha256": ""}
"""Record of a policy that is none of an audit's references."""


def default_declaration(
    world: str,
    angle: float,
    options: Mapping[str, Any] | None = None,
    floor: Floor | None = None,
    bounded: bool = True,
    owner: str = "a study",
    day: datetime.date = DAY,
) -> Profile:
    """Return the declaration of an angle with the defaults of its world.

    Args:
        world: Name of the world.
        angle: Declared angle in degrees.
        options: Options of the world.
        floor: Safety floor; None for that of the angle.
        bounded: Whether it names the largest loss of an episode where rewards are not clipped.
        owner: Name of the owner.
        day: Date of the declaration.
    """
    usual = USUAL[world]
    loss = None
    if bounded and usual.clip is None:
        loss = possible_loss(make(world, **(options or {})), angle)
    margin = Margin(usual.margin, None, loss, usual.width, usual.beyond)
    how: dict[str, Any] = {"competence": floor or floor_at(angle), "clip": usual.clip}
    return declare(angle, owner, world, margin, day, options, **how)


def course_of(world: World, episodes: int, seed: int, measured: Sequence[str] = ()) -> Course:
    """Return episodes of a world on seeds that are drawn.

    Args:
        world: The world.
        episodes: Number of episodes.
        seed: Seed of the draw.
        measured: Effects that are measured.
    """
    seeds = np.random.default_rng(seed).integers(2**62, size=episodes)
    return Course(world, seeds, measured=measured)


class AuditArena:
    """Episodes on which policies are audited; the references of an angle drive them once."""

    def __init__(
        self,
        course: Course,
        options: Mapping[str, Any] | None = None,
        compared: Course | None = None,
    ) -> None:
        self.course = course
        self.options = options  # of its world
        self.compared = compared or course  # episodes of the references
        self.references: dict[float, tuple[Outcomes, ...]] = {}

    def audited(self, policy: Policy, angle: float, seed: int = 0) -> tuple[Decisive, Outcomes]:
        """Audit a policy by the default declaration of an angle.

        Args:
            policy: Policy under audit.
            angle: Declared angle in degrees.
            seed: Seed of the resamples.

        Returns:
            The verdict, and the outcomes of the policy with its measured effects.
        """
        course = self.course
        world = course.world
        profile = default_declaration(world.name, angle, self.options)
        if angle not in self.references:
            with contextlib.ExitStack() as closing:
                angles = dial_angles(angle, profile.margin.width)
                named = resolve_references(world, (), UNKNOWN, Trust(), closing, angles)
                self.references[angle] = drive_references(self.compared, named.drivers)
        outcomes = course.drive(Reference("policy", policy))
        references = self.references[angle]
        evidence = Evidence(world.description, course.seeds, outcomes, references, {}, ())
        return decide(profile, evidence, seed, RESAMPLES, profile.error), outcomes
