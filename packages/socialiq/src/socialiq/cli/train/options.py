"""Groups of options that the learners of `train` share, and how settings are laid over a config."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from socialiq.cli.checks import check_options
from socialiq.errors import UserError
from socialiq.learners.settings import check_seeds
from socialiq.settings import assignments, laid_over
from socialiq.types import Row

DECIDED = ("angle", "strength", "seed", "dataset", "online", "one_hot", "demonstrators")
"""Fields of learners' configs that other options, the data or the world decide."""

GRID = ("angle", "strength", "seed")
"""Settings in which the runs of a training differ."""


@dataclass(frozen=True)
class PlainGridOptions:
    """A run for each combination."""

    angle: tuple[float, ...] = (0.0,)
    """Target angles in degrees."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""

    def runs(self, base: Any) -> list[Any]:
        """Return hyperparameters for each angle, strength and seed.

        Raises:
            UserError: If the learner doesn't have one that was given.
        """
        check_seeds(self.seed)
        for name in GRID:
            if not hasattr(base, name) and getattr(self, name, ()) not in ((), (0.0,), (0,)):
                raise UserError(f"this learner has no '{name}': leave --{name} out")
        names = [name for name in GRID if hasattr(base, name) and getattr(self, name, ())]
        return [
            dataclasses.replace(base, **dict(zip(names, values, strict=True)))
            for values in itertools.product(*(getattr(self, name) for name in names))
        ]


@dataclass(frozen=True)
class GridOptions(PlainGridOptions):
    """A run for each combination."""

    strength: tuple[float, ...] = ()
    """λ; by default the preset's."""


@dataclass(frozen=True)
class SizeOptions:
    """Size of the training and of the network."""

    updates: int | None = None
    """Gradient steps; by default the preset's."""
    hidden: tuple[int, ...] = ()
    """Widths of the hidden layers; by default the preset's."""

    def given(self) -> dict[str, Any]:
        """Return the settings that were given."""
        updates = {} if self.updates is None else {"updates": self.updates}
        return updates | ({"hidden": self.hidden} if self.hidden else {})


@dataclass(frozen=True)
class SetOptions:
    """Settings of the learner."""

    set: tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]] = ()
    """KEY=VALUE ... of any setting that has no option, with commas between several values; an
    unknown key is answered with the list of those that the learner has."""

    def apply(self, configs: Sequence[Any], given: Mapping[str, Any]) -> list[Any]:
        """Return the learner's configs with the given options and --set laid over them.

        Raises:
            UserError: If there is no such setting, or a value is refused.
        """
        words = assignments([word for words in self.set for word in words])
        for name in words.keys() & {*DECIDED}:
            raise UserError(f"{name} is no setting: other options, the data or the world decide it")
        changed = laid_over(configs, {**given, **words}, DECIDED)
        for config in changed:
            check_options(config)
        return changed


@dataclass(frozen=True)
class RunOptions(SetOptions):
    """Settings of the learner, and records of the run."""

    resume: bool = False
    """Go on with a run that was stopped."""
    tensorboard: Path | None = None
    """Folder for TensorBoard's event files too, one for each policy; metrics.csv is always
    written."""


@dataclass(frozen=True)
class ScalingOptions:
    """Features of continuous actions' observations."""

    standardise: bool = False
    """Of continuous actions: let the networks see each feature with mean 0 and deviation 1 over
    the demonstrations, without any over 1,000 steps at random in the world, which the replay
    doesn't hold; the policies take observations as they are."""
    leave_out: tuple[int, ...] = ()
    """With --standardise: features, counted from 0, that the networks do not see."""

    def refuse(self) -> None:
        """Refuse them with discrete actions.

        Raises:
            UserError: If one was given.
        """
        if self.standardise or self.leave_out:
            raise UserError(
                "--standardise and --leave-out are of continuous actions, and these are discrete"
            )


def label(hyperparameters: Any) -> Row:
    """Return what a run differs in from the others of its grid."""
    return {name: getattr(hyperparameters, name) for name in GRID if hasattr(hyperparameters, name)}
