"""Configuration of the study: its rules, fixed before its episodes were drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from socialiq.learners.config import check_counts
from socialiq.social.angle_rule import AngleRule


def _rule(world: str, default: Any, **when: Any) -> AngleRule:
    """Return a rule of one case: its angle, and conditions by feature."""
    cases = {"when": [when]} if when else {}
    return AngleRule.of({"format": 1, "world": world, "default": default, **cases})


_ONE = {"at_least": 1}

MAIN = "crossing-60"
"""Rule of the example: yield when a vehicle crosses, press on when the junction is free."""

RULES = {
    MAIN: _rule("intersection", 0, angle=60, crossing=_ONE),
    "crossing-75": _rule("intersection", 0, angle=75, crossing=_ONE),
    "crossing-60-else-30": _rule("intersection", 30, angle=60, crossing=_ONE),
    "waiting-75": _rule("intersection", 0, angle=75, waiting=_ONE),
    "waiting-75-else-30": _rule("intersection", 30, angle=75, waiting=_ONE),
    "priority-75-else-30": _rule("intersection", 30, angle=75, crossing_with_priority=_ONE),
    "density": _rule(
        "intersection", {"by": "vehicles_within_30m", "at": [0, 2, 5], "degrees": [0, 45, 75]}
    ),
    "late-30-else-60": _rule("intersection", 60, angle=30, decisions={"at_least": 10}),
    "reversed-60": _rule("intersection", 60, angle=0, crossing=_ONE),
}
"""Rules at the intersection, by name."""

_NEAR = {"by": "cells_to_conflict", "at": [-1, 3], "degrees": [10, 80]}

EXACT_RULES = {
    "approaching-75": {"default": 0, "when": [{"angle": 75, "approaching": _ONE}]},
    "approaching-45": {"default": 0, "when": [{"angle": 45, "approaching": _ONE}]},
    "approaching-65-else-20": {"default": 20, "when": [{"angle": 65, "approaching": _ONE}]},
    "near": {"default": _NEAR},
    "last-cell-75": {
        "default": 0,
        "when": [{"angle": 75, "cells_to_conflict": {"at_least": 1, "at_most": 1}}],
    },
}
"""Rules of both gridworlds, without their world."""

GRIDS = ("crossing5", "crossing7")

CANDIDATES = tuple(15.0 * step for step in range(7))
"""Angles at which decision losses are measured, in degrees."""

COMPARED = (0.0, 30.0, 45.0, 60.0)
"""Constant angles whose decision losses at the main rule are measured, in degrees."""


def exact_rule(world: str, name: str) -> AngleRule:
    """Return a rule of a gridworld."""
    return AngleRule.of({"format": 1, "world": world, **EXACT_RULES[name]})


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results.

    Rules were tried on episodes from 50,000,000; those of the results are other episodes.
    """

    seeds: tuple[int, ...] = (0,)
    """Seed of the split of the episodes: one half selects, the other measures."""
    episodes: int = 10_000
    """Episodes of each driver, the same for all."""
    first_episode: int = 82_000_000
    """Seed of the first of them."""
    every: float = 5.0
    """Degrees between the constant angles."""
    loss_episodes: int = 3_000
    """Episodes in which decision losses are measured by rollouts."""
    first_loss: int = 83_000_000
    """Seed of the first of these."""

    def __post_init__(self) -> None:
        """Refuse empty sizes."""
        check_counts(self, ("episodes", "loss_episodes"))

    @property
    def constants(self) -> tuple[float, ...]:
        """Constant angles, in degrees."""
        return tuple(self.every * step for step in range(int(90.0 / self.every) + 1))
