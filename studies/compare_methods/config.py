"""Configuration of the comparison: one budget for every method."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from socialiq.errors import UserError
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.config import check_counts, check_widths
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq_lab.comparison import GRIDWORLDS, check_choices, nearest_mode
from studies.compare_methods.methods import (
    BY_NAME,
    PEERS,
    SETTINGS_EACH,
    Method,
    Setting,
    middle,
)

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)

FASTER = 3
"""Factor on the rates of Table C.1, as in `compare priors`."""


@dataclass(frozen=True)
class Config:
    """One budget and the same seeds for every method of a world."""

    worlds: tuple[str, ...] = GRIDWORLDS
    """Worlds of the comparison; the intersection takes long and is left out if not named."""
    methods: tuple[str, ...] = tuple(BY_NAME)
    """Names of `METHODS`."""
    angles: tuple[float, ...] = ANGLES
    """Target angles in degrees."""
    development_angles: tuple[float, ...] = (15.0, 45.0, 75.0)
    """Angles at which settings are chosen; 0 and 90 are those of demonstrators."""
    development_seeds: tuple[int, ...] = (100,)
    """Training seeds on which settings are chosen, each with its own data set."""
    seeds: tuple[int, ...] = (300, 301, 302, 303, 304)
    """Training seeds of the table, each with its own data set."""
    updates: int = 2_000
    """Gradient steps for each target angle in a gridworld, and as many steps in the world; a
    network that serves several angles has theirs together."""
    learning_rate: float = FASTER * presets.TABLE_C1_NUMBERS.learning_rate
    """Of methods whose grid has none."""
    polyak: float = FASTER * presets.TABLE_C1_NUMBERS.polyak
    """Of methods whose grid has none."""
    episodes: int = 1000
    """Evaluation episodes of each policy in the intersection."""
    intersection_updates: int = 1_000
    """Gradient steps for each target angle in the intersection, and twice as many steps in the
    world. A GPU affords 5,000, with the next two."""
    intersection_hidden: tuple[int, ...] = (64, 64)
    """Hidden layers in the intersection, over a view of the vehicles as a set. The world's own
    learners have (256, 256)."""
    intersection_batch: int = 64
    """Batch in the intersection. The world's own learners have 256."""
    intersection_settings: int = 2
    """Settings that are tried of each method's grid in the intersection, the middle ones; at most
    `SETTINGS_EACH`, which the gridworlds try."""

    def __post_init__(self) -> None:
        """Refuse unknown worlds and methods, empty options, seeds used twice, and bad sizes."""
        check_choices(self, tuple(BY_NAME), self.development_seeds, self.seeds)
        check_counts(self, ("updates", "episodes", "intersection_updates", "intersection_batch"))
        check_widths(self.intersection_hidden)
        if not 1 <= self.intersection_settings <= SETTINGS_EACH:
            raise UserError(
                f"intersection_settings must be from 1 to {SETTINGS_EACH}, "
                f"got {self.intersection_settings}"
            )

    def settings_of(self, world: str, method: Method) -> tuple[Setting, ...]:
        """Return the settings of a method that are tried in a world."""
        count = SETTINGS_EACH if world in GRIDWORLDS else self.intersection_settings
        return middle(method.settings, count)

    @property
    def structure(self) -> iq.StaticConfig:
        """Static config of the gridworlds: Table C.1's."""
        return presets.TABLE_C1

    @property
    def numbers(self) -> iq.Hyperparameters:
        """Hyperparameters of the gridworlds' runs where a method's grid has none."""
        return dataclasses.replace(
            presets.TABLE_C1_NUMBERS, learning_rate=self.learning_rate, polyak=self.polyak
        )

    @property
    def peers(self) -> tuple[str, ...]:
        """Environments of other libraries that the methods need in these worlds."""
        found = (method.learner for world in self.worlds for method in self.methods_of(world))
        return tuple(dict.fromkeys(PEERS[learner] for learner in found if learner in PEERS))

    def methods_of(self, world: str) -> list[Method]:
        """Return the methods that run in a world."""
        named = [BY_NAME[name] for name in self.methods]
        kept = "gridworlds" if world in GRIDWORLDS else "intersection"
        return [method for method in named if getattr(method, kept)]


def updates_of(method: Method, updates: int) -> int:
    """Return the gradient steps of one network, if an angle has `updates` of them.

    Seven angles have as many for every method that trains a network for each, one for each of
    the three modes, or one for all.
    """
    shares = {"angle": len(ANGLES), "mode": len(MODES), "all": 1}
    return updates * len(ANGLES) // shares[method.serves]


def trained_angles(method: Method, angles: tuple[float, ...]) -> dict[float, tuple[float, ...]]:
    """Return the angle that each network is trained for, and the angles that it serves."""
    if method.serves == "all":
        return {0.0: angles}
    if method.serves == "angle":
        return {angle: (angle,) for angle in angles}
    served = {
        own: tuple(angle for angle in angles if nearest_mode(angle) == mode)
        for mode, own in MODES.items()
    }
    return {own: group for own, group in served.items() if group}
