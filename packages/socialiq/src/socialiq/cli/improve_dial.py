"""`improve-dial`: policy iteration of a dial of the intersection."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from socialiq.cli.options import optional, overridden
from socialiq.cli.run_folder import RunFolder, described_file
from socialiq.cli.train_dial import saved_dials
from socialiq.errors import UserError
from socialiq.learners.config import check_seeds
from socialiq.learners.policy_iteration import dial as iteration
from socialiq.learners.policy_iteration.config import Hyperparameters
from socialiq.learners.policy_iteration.dial import StaticConfig
from socialiq.nn.dial_policy import DialPolicy
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection.fitting import CHUNK, sizes_of
from socialiq_lab.intersection.policy_iteration import (
    ITERATION,
    ITERATION_NUMBERS,
    dial_labeller,
    observes_time,
)

# Every field of the configs is an option, but for those that the dial or the seeds decide.
StaticOptions = tyro.conf.OmitArgPrefixes[
    optional(StaticConfig, "view", "times", "hidden", "activation", "knots", "low", "high")
]
NumberOptions = tyro.conf.OmitArgPrefixes[optional(Hyperparameters, "seed", "angle")]


@dataclass(frozen=True)
class ImproveDial:
    """Improve a dial of the intersection by rollouts in copies of the simulator.

    Example: socialiq improve-dial dial.safetensors --out improved
    """

    dial: Annotated[Path, tyro.conf.Positional]
    """Dial file, of `socialiq train-dial intersection`."""
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    environments: int = 256
    """Episodes side by side in which states are labelled."""
    resume: bool = False
    """Go on with a run that was stopped."""
    tensorboard: Path | None = None
    """Folder for TensorBoard's event files too, one for each dial; metrics.csv is always
    written."""
    json: bool = False
    """Print one JSON object."""

    static: StaticOptions = field(default_factory=StaticOptions)  # pyright: ignore[reportInvalidTypeForm]
    """Choices that shape the program."""
    hyperparameters: NumberOptions = field(  # pyright: ignore[reportInvalidTypeForm]
        default_factory=NumberOptions
    )
    """Numbers of the runs."""

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        check_seeds(self.seed)
        start, options = DialPolicy.load(self.dial), Options()
        clock = observes_time(start, options)
        static = iteration.with_network_of(overridden(ITERATION, self.static), start)
        numbers = overridden(ITERATION_NUMBERS, self.hyperparameters)
        runs = [dataclasses.replace(numbers, seed=seed) for seed in self.seed]
        if self.environments < 1:
            raise UserError(f"environments must be at least 1, got {self.environments}")
        labellers = [dial_labeller(static, options, self.environments, clock) for _ in runs]
        folder = RunFolder(self.out, "dial", self.resume, self.tensorboard)
        labels = [{"seed": one.seed} for one in runs]
        with folder.callbacks(labels) as callbacks:
            sizes = sizes_of(options, clock)
            trained = iteration.train(static, runs, labellers, sizes, callbacks, CHUNK, start)
        dials = saved_dials(folder, trained)
        folder.finish(trained, labels, dials, {"start": described_file(self.dial)})
        return folder.report(trained, dials, self.json)
