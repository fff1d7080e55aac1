"""Configuration of the study of planted angles."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.errors import UserError
from socialiq.storage import packaged_results

DIAL = packaged_results() / "intersection-dial" / "dial.safetensors"
"""The dial whose policies drive; its middle ends the rollouts."""

OTHER_DIAL = packaged_results() / "intersection-dial-clock" / "calibrated.safetensors"
"""The dial that is the model of drivers: of another training, seed, network and observation."""

INFERENCES = (("planner", "returns"), ("dial", "returns"), ("dial", "another dial"))
"""Kinds of drivers, and what their angles are inferred from."""

MIXED = 10
"""Angles of the dial whose policies are the base predictor of dials; that of planners is even."""

RANDOM = 0.05
"""Share of random actions in it."""

CONFIDENCE = 0.9
"""Of the drivers' intervals."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    first_episode: int = 62_000_000
    """Seed of the first episode. 50,000,000 to 50,999,999 were used in development, 61,000,000 to
    61,999,999 by an earlier version."""
    repeats: int = 5
    """Populations of each kind and spread."""
    drivers: int = 30
    """Drivers of a population."""
    lengths: tuple[int, ...] = (2, 16)
    """Episodes of a driver that are used, half to infer and half to test."""
    mean: float = 45.0
    """Mean of the planted angles, degrees."""
    spreads: tuple[float, ...] = (0.0, 25.0)
    """Standard deviations of the planted angles; angles are cut off at 0 and 90 degrees."""
    strength: float = 3.0
    """β of planners, per typical difference of returns."""
    step: float = 10.0
    """Of the angles integrated over, degrees."""

    def __post_init__(self) -> None:
        """Check what no population can be made of."""
        if not self.lengths or any(one < 2 or one % 2 for one in self.lengths):
            raise UserError(f"lengths must be even numbers from 2, got {list(self.lengths)}")
        if self.drivers < 2 or self.repeats < 1:
            raise UserError("drivers must be at least 2, and repeats at least 1")
        if not self.step > 0 or 360 % self.step:
            raise UserError(f"step must divide 360, got {self.step:g}")
