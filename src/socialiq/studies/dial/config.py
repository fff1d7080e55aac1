"""What the study of the dial runs: ways to train it, sizes, seeds; the defaults are the results."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from socialiq.experiments.gridworld_runs import Ground
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.worlds.grid_world import GridWorld

KEY_ANGLES = tuple(np.arange(0.0, 91.0, 15.0).tolist())


class Run(NamedTuple):
    """One way to train a dial.

    Attributes:
        structure: Its structure; what the network sees of the world is added.
        numbers: Its numbers; the seed is added.
        clock: Whether the world shows the time.
        support: Which actions an offline learner can know: at the time at which they were
            demonstrated ("timed"), or at any ("any time"); empty online.
    """

    structure: StaticConfig
    numbers: Hyperparameters
    clock: bool = True
    support: str = ""


_ONLINE = StaticConfig(redraw_times=25, replay_batch=448)
_OFFLINE = StaticConfig(online=False, scored="demonstrations")
# Chosen on training seeds 0 to 4 (docs/dial.md).
RUNS = {
    "online": Run(_ONLINE, Hyperparameters()),
    "online-alone": Run(
        dataclasses.replace(_ONLINE, demonstrations=False, replay_batch=512), Hyperparameters()
    ),
    "online-clockless": Run(
        dataclasses.replace(_ONLINE, redraw_times=0), Hyperparameters(discount=0.99), clock=False
    ),
    "offline": Run(
        dataclasses.replace(_OFFLINE, updates=12_000),
        Hyperparameters(prior_weight=50.0, temperature=0.03),
        support="timed",
    ),
    "offline-redrawn": Run(
        dataclasses.replace(_OFFLINE, updates=16_000, redraw_times=25),
        Hyperparameters(prior_weight=200.0),
        support="any time",
    ),
}

# Chosen on training seeds 0 to 4; what it costs and what it reaches: benchmarks/README.md.
QUICK = Run(
    dataclasses.replace(_ONLINE, hidden=(64, 64), expert_batch=8, replay_batch=120, updates=6000),
    Hyperparameters(learning_rate=6e-3, polyak=0.05),
)
PRESETS = RUNS | {"online-quick": QUICK}
"""The study's runs, and one that takes less than twice the time of a run of the thesis' learner."""


@dataclass(frozen=True)
class Config:
    """What the study runs; the defaults are the committed results."""

    seeds: tuple[int, ...] = (30, 31, 32, 33, 34, 35, 36, 37, 38, 39)
    """Training seeds, each with a data set of its own. 0 to 9 were used in development."""
    episodes_each: int = 60
    """Demonstrated episodes of each expert."""
    runs: tuple[str, ...] = tuple(RUNS)
    """Which of `RUNS`."""
    updates: int | None = None
    """Gradient steps in place of each run's own; for trying the study out."""
    wanted: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 5.0).tolist())
    """Behavioural angles that the mixtures are to have."""
    rollouts: int = 1000
    """Episodes of each queried angle from which mixtures are estimated."""
    budgets: tuple[float, ...] = (0.05, 0.2, 0.5, 1.0, 2.0)
    """ε of the agents whose strength is found by a budget of regret."""
    budget_angle: float = 45.0
    """Their angle in degrees."""
    budget_seeds: tuple[int, ...] = (30, 31, 32)
    """Of their training, among `seeds`."""


def with_clock(ground: Ground, clock: bool) -> Ground:
    """The same ground, whose world shows the time or doesn't."""
    if not clock:
        return ground
    table, part = (
        dataclasses.replace(one, world=one.world.with_clock())
        for one in (ground.table, ground.part)
    )
    return Ground(table, part, ground.optimum)


def seen(world: GridWorld) -> tuple[tuple[int, int], ...]:
    """What a network is told of a gridworld: smallest value and number of values by feature."""
    return tuple((feature.low, feature.size) for feature in world.observed)
