"""Configuration of the study of the dial, and the angles of its key regret."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from socialiq.learners.dial.config import RUNS

KEY_ANGLES = tuple(np.arange(0.0, 91.0, 15.0).tolist())
"""Angles in degrees whose mean regret is the key regret of a dial."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (30, 31, 32, 33, 34, 35, 36, 37, 38, 39)
    """Training seeds, each with its own data set. 0 to 9 were used in development."""
    episodes_each: int = 60
    """Demonstrated episodes of each expert."""
    runs: tuple[str, ...] = tuple(RUNS)
    """Names of `learners.dial.config.PRESETS`."""
    updates: int | None = None
    """Gradient steps instead of each run's own number, to try the study."""
    wanted: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 5.0).tolist())
    """Behavioural angles of the mixtures."""
    rollouts: int = 1000
    """Episodes of each requested angle, from which mixtures are estimated."""
    budgets: tuple[float, ...] = (0.05, 0.2, 0.5, 1.0, 2.0)
    """ε of the agents whose strength follows from a budget of regret, beside the run `offline`."""
    budget_angle: float = 45.0
    """Angle of these agents in degrees."""
    budget_seeds: tuple[int, ...] = (30, 31, 32)
    """Training seeds, among `seeds`."""
