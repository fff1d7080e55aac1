"""`train-dial`: one network for every social angle."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli.dial_worlds import (
    ROADS,
    collect_command,
    in_gridworld,
    on_road,
    preset_of,
)
from socialiq.cli.offline_dial import OfflineCommand
from socialiq.cli.options import optional, overridden
from socialiq.cli.run_folder import RunFolder, described_file
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.learners.config import check_seeds
from socialiq.learners.dial.budget import ASCENT_EVERY, Budget, Look
from socialiq.learners.dial.config import PRESETS, Hyperparameters, StaticConfig, check_fit
from socialiq.learners.dial.train import train
from socialiq.learners.kernel import Trained
from socialiq.learners.offline import config as offline
from socialiq.storage import kind_of
from socialiq.types import Row
from socialiq.worlds import CONTINUOUS, WORLD_FILE
from socialiq.worlds.registry import GRIDWORLDS, make_grid
from socialiq_lab.gridworld_runs import Ground, exact_regret, with_clock
from socialiq_lab.recorded_practice import Practice

# Every field of the configs is an option, but for those that the world or the seeds decide.
StaticOptions = tyro.conf.OmitArgPrefixes[optional(StaticConfig, "one_hot", "demonstrators")]
NumberOptions = tyro.conf.OmitArgPrefixes[optional(Hyperparameters, "seed", "dataset")]


@dataclass(frozen=True)
class TrainDial:
    """Train one network for every social angle.

    Example: socialiq train-dial crossing7 --data clocked.safetensors --out run
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5, crossing7, intersection, merge, roundabout, or a file of `socialiq data world`."""
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    data: Path | None = None
    """Demonstrations file, of `socialiq collect`, in a gridworld with --clock; a run without
    demonstrations has none."""
    preset: str | None = None
    """On a road of highway-env: intersection. In a gridworld: online (default), online-short (a
    fifth of its rows, knots of the angle), online-quick (seconds, less exact), online-alone (no
    demonstrations), online-clockless, offline, offline-redrawn (each transition at newly drawn
    times). In both: offline-regularised (from whole episodes alone)."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    angle: float | None = None
    """Train for this one social angle in degrees, instead of 0 to 90."""
    budget: float | None = None
    """With --angle: follow the demonstrations, but for a regret of at most this much at the angle,
    in units of reward; the strength that takes is found while training."""
    practice: int = 0
    """Rounds in which a dial of a recorded junction drives there and learns again, with
    offline-regularised."""
    practice_episodes: int = 100
    """Episodes of a round at each of seven angles; one decision in ten is drawn at random."""
    practice_seed: int = 65_000_000
    """Seed of the first of these episodes."""
    resume: bool = False
    """Go on with a run that was stopped."""
    tensorboard: Path | None = None
    """Folder for TensorBoard's event files too, one for each dial; metrics.csv is always
    written."""
    json: bool = False
    """Print one JSON object."""

    static: StaticOptions = field(default_factory=StaticOptions)  # pyright: ignore[reportInvalidTypeForm]
    """Choices that shape the program; by default the preset's."""
    hyperparameters: NumberOptions = field(  # pyright: ignore[reportInvalidTypeForm]
        default_factory=NumberOptions
    )
    """Numbers of the runs; by default the preset's."""

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        check_seeds(self.seed)
        if self.world in CONTINUOUS:
            raise UserError(
                f"{self.world} has continuous actions: `socialiq train FILE --world {self.world} "
                "--dial True` trains a dial of them"
            )
        if kind_of(Path(self.world)) != WORLD_FILE:
            one_of("world", self.world, (*GRIDWORLDS, *ROADS))
        elif self.preset not in offline.PRESETS:
            raise UserError(
                f"a dial of a recorded junction learns from demonstrations alone: add --preset "
                f"{' or '.join(offline.PRESETS)}"
            )
        if self.preset in offline.PRESETS:
            return self.from_data_alone(self.preset).run()
        if self.practice:
            raise UserError(
                "--practice goes with --preset offline-regularised, at a recorded junction"
            )
        name, chosen = preset_of(self.preset, self.world)
        structure = overridden(self.narrowed(chosen.structure), self.static)
        numbers = overridden(chosen.numbers, self.hyperparameters)
        hyperparameters = [dataclasses.replace(numbers, seed=seed) for seed in self.seed]
        budget = self.dual_ascent(name, structure, hyperparameters)
        data = self.demonstrations(name, structure.demonstrations)
        if self.world in ROADS:
            setting = on_road(self.world, structure, hyperparameters, data)
        else:
            setting = in_gridworld(self.world, chosen, structure, data)
        static, data, sizes, simulator, collector, chunk = setting
        check_fit(static, hyperparameters, data, simulator, sizes, collector is not None)
        folder = RunFolder(self.out, "dial", self.resume, self.tensorboard)
        labels = [{"seed": one.seed} for one in hyperparameters]
        with folder.callbacks(labels) as callbacks:
            trained = train(
                static,
                hyperparameters,
                data,
                simulator,
                sizes,
                callbacks,
                chunk=ASCENT_EVERY if budget else chunk,
                before_chunk=collector,
                budget=budget,
            )
        dials = saved_dials(folder, trained, budget)
        record = {
            "preset": name,
            "world": self.world,
            "data": self.data and described_file(self.data),
            "budget": self.budget,
            "budget_path": [_look_row(look) for look in budget.path] if budget else [],
        }
        folder.finish(trained, labels, dials, record)
        return folder.report(trained, dials, self.json)

    def from_data_alone(self, preset: str) -> OfflineCommand:
        """The call with an offline preset that needs no world to act in.

        Raises:
            UserError: If there are no demonstrations, or an option is not this preset's.
        """
        if self.data is None:
            raise UserError(
                f"preset '{preset}' learns from demonstrations: add --data FILE "
                "(socialiq collect WORLD --out FILE)"
            )
        given = {"--angle": self.angle, "--budget": self.budget, "--tensorboard": self.tensorboard}
        given["--resume"] = self.resume or None
        for option, value in given.items():
            if value is not None:
                raise UserError(f"preset '{preset}' takes no {option}: leave it out")
        practice = Practice(self.practice, self.practice_episodes, first_seed=self.practice_seed)
        options = (self.seed, self.static, self.hyperparameters, practice, self.out, self.json)
        return OfflineCommand(self.world, self.data, (preset, offline.PRESETS[preset]), *options)

    def demonstrations(self, preset: str, wanted: bool) -> list[Demonstrations]:
        """The data of a run that learns from data.

        Raises:
            UserError: If they are missing, or given to a run that takes none.
        """
        if wanted and self.data is None:
            raise UserError(
                f"preset '{preset}' learns from demonstrations: add --data FILE "
                f"({collect_command(self.world)})"
            )
        if not wanted and self.data is not None:
            raise UserError(f"preset '{preset}' takes no demonstrations: leave --data out")
        return [files.load(self.data)] if self.data else []

    def narrowed(self, static: StaticConfig) -> StaticConfig:
        """The preset's structure, for the one angle if there is one.

        Raises:
            UserError: If a budget has no angle.
        """
        if self.budget is not None and self.angle is None:
            raise UserError("a budget is of the regret at one angle: add --angle")
        if self.angle is None:
            return static
        return dataclasses.replace(
            static, low=self.angle, high=self.angle, margin=0.0, high_share=None, knots=0
        )

    def dual_ascent(
        self, preset: str, static: StaticConfig, hyperparameters: list[Hyperparameters]
    ) -> Budget | None:
        """Search of the strength for the budget, if there is one; its path is of this process.

        Raises:
            UserError: If the budget is not above 0, or the run too short to find anything.
        """
        if self.budget is None:
            return None
        if self.world in ROADS:
            raise UserError("a budget needs exact regrets: train in a gridworld, or leave it out")
        if static.updates <= ASCENT_EVERY:
            raise UserError(f"a budget is checked every {ASCENT_EVERY} updates: train for more")
        budgets = np.full(len(hyperparameters), self.budget)
        plain, clock = make_grid(self.world), PRESETS[preset].clock
        ground = with_clock(Ground.of(plain.name), clock)
        return Budget(exact_regret(ground, static, hyperparameters), budgets)


def saved_dials(folder: RunFolder, trained: Trained, budget: Budget | None = None) -> list[Row]:
    """Write the dials; return each one's file, seed, last loss and outcome of the budget."""
    losses = np.asarray(trained.history.array("loss"))[-1]
    dials = []
    for run, saved in enumerate(folder.save_policies(trained)):
        seed = trained.hyperparameters[run].seed
        loss, sha256 = float(losses[run]), saved["sha256"]
        dials.append({"file": saved["file"], "seed": seed, "loss": loss, "sha256": sha256})
        if budget is not None:
            regret = float(budget.path[-1].regret[run])
            dials[-1] |= {"multiplier": float(trained.kept[run]), "regret": regret}
    return dials


def _look_row(look: Look) -> dict[str, Any]:
    """One step of dual ascent, of all runs."""
    return {
        "updates": look.updates,
        "regret": look.regret.tolist(),
        "multiplier": look.multiplier.tolist(),
    }
