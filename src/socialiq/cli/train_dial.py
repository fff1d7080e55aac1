"""`train-dial`: one network for every social angle of a gridworld."""

from __future__ import annotations

import dataclasses
import hashlib
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli.options import optional, overridden
from socialiq.cli.output import complain, print_json, print_table
from socialiq.cli.progress import Display, to_all
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.experiments.gridworld_runs import Ground, seen, with_clock
from socialiq.experiments.results import as_csv, versions
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.budget import Budget, Look
from socialiq.learners.dial.config import Hyperparameters, StaticConfig, check_fit
from socialiq.learners.dial.presets import PRESETS
from socialiq.learners.dial.train import train
from socialiq.learners.kernel import Trained
from socialiq.learners.ranges import check_seeds
from socialiq.learners.tensorboard import EventFiles
from socialiq.storage import new_folder, write_atomically, write_json
from socialiq.studies.dial.budgets import CHUNK, exact_regret
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.registry import make_grid

# Every field of the configs is an option, but for those that the world or the seeds decide.
StaticOptions = tyro.conf.OmitArgPrefixes[optional(StaticConfig, "one_hot", "demonstrators")]
NumberOptions = tyro.conf.OmitArgPrefixes[optional(Hyperparameters, "seed", "dataset")]


@dataclass(frozen=True)
class TrainDial:
    """Train one network for every social angle of a gridworld.

    Example: socialiq train-dial crossing7 --data clocked.safetensors --out run
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5 or crossing7."""
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    data: Path | None = None
    """Demonstrations file, of `socialiq collect --clock`; a run without demonstrations has none."""
    preset: str = "online"
    """online, online-quick (seconds, less exact), online-alone (no demonstrations),
    online-clockless, offline, offline-redrawn (each transition at times drawn anew)."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    angle: float | None = None
    """Train for this one social angle in degrees, instead of 0 to 90."""
    budget: float | None = None
    """With --angle: follow the demonstrations, but for a regret of at most this much at the angle,
    in units of reward; the strength that takes is found while training."""
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
        one_of("preset", self.preset, tuple(PRESETS))
        check_seeds(self.seed)
        chosen = PRESETS[self.preset]
        plain = make_grid(self.world)
        world = plain.with_clock() if chosen.clock else plain
        structure = self.narrowed(chosen.structure)
        redraw_times = world.horizon if structure.redraw_times else 0
        static = dataclasses.replace(structure, one_hot=seen(world), redraw_times=redraw_times)
        static = overridden(static, self.static)
        numbers = overridden(chosen.numbers, self.hyperparameters)
        hyperparameters = [dataclasses.replace(numbers, seed=seed) for seed in self.seed]
        budget = self.dual_ascent(static, hyperparameters)
        data = self.demonstrations(static.demonstrations)
        simulator = world if static.online else None
        sizes = (world.n_features, world.n_actions)
        check_fit(static, hyperparameters, data, simulator, sizes, collects=False)
        with ExitStack() as stack:
            names = [f"seed_{one.seed}" for one in hyperparameters]
            events = [EventFiles(self.tensorboard, names)] if self.tensorboard else []
            told = [stack.enter_context(one) for one in events]
            checkpoint = self.folder() / "checkpoint.safetensors"
            show = stack.enter_context(Display()).stage("training")
            callbacks = Callbacks(
                on_report=to_all([show, *told]), checkpoint=checkpoint, resume=self.resume
            )
            trained = train(
                static,
                hyperparameters,
                data,
                simulator,
                sizes,
                callbacks,
                chunk=CHUNK if budget else 500,
                budget=budget,
            )
        runs = self.write(trained, budget)
        checkpoint.unlink(missing_ok=True)
        if self.json:
            print_json({"out": str(self.out), "dials": runs})
        else:
            print_table(runs)
        for failure in trained.failures:
            complain(failure)
        return 1 if trained.failures else 0

    def demonstrations(self, wanted: bool) -> list[Demonstrations]:
        """The data of a run that learns from data.

        Raises:
            UserError: If they are missing, or given to a run that takes none.
        """
        if wanted and self.data is None:
            raise UserError(
                f"preset '{self.preset}' learns from demonstrations: add --data FILE "
                "(socialiq collect WORLD --clock --out FILE)"
            )
        if not wanted and self.data is not None:
            raise UserError(f"preset '{self.preset}' takes no demonstrations: leave --data out")
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
        return dataclasses.replace(static, low=self.angle, high=self.angle, margin=0.0)

    def dual_ascent(
        self, static: StaticConfig, hyperparameters: list[Hyperparameters]
    ) -> Budget | None:
        """Search of the strength for the budget, if there is one; its path is of this process.

        Raises:
            UserError: If the budget is not above 0, or the run too short to find anything.
        """
        if self.budget is None:
            return None
        if static.updates <= CHUNK:
            raise UserError(f"a budget is looked at every {CHUNK} updates: train for more")
        budgets = np.full(len(hyperparameters), self.budget)
        plain, clock = make_grid(self.world), PRESETS[self.preset].clock
        ground = with_clock(Ground.of(plain.name), clock)
        return Budget(exact_regret(ground, static, hyperparameters), budgets)

    def folder(self) -> Path:
        """The output folder: a new one, or that of a stopped run."""
        if not self.resume:
            return new_folder(self.out)
        if (self.out / "run.json").exists():
            raise UserError(f"{self.out} holds a finished run: there is nothing to resume")
        return self.out

    def write(self, trained: Trained, budget: Budget | None) -> list[dict[str, Any]]:
        """Dials and the record of the run."""
        runs = []
        for run, hyperparameters in enumerate(trained.hyperparameters):
            name = f"dial_{run}.safetensors"
            sha256 = trained.policy(run).save(self.out / name)
            loss = float(np.asarray(trained.history.array("loss"))[-1, run])
            runs.append(
                {"file": name, "seed": hyperparameters.seed, "loss": loss, "sha256": sha256}
            )
            if budget is not None:
                regret = float(budget.path[-1].regret[run])
                runs[-1] |= {"multiplier": float(trained.kept[run]), "regret": regret}
        write_atomically(self.out / "metrics.csv", as_csv(_history_rows(trained)))
        record = {
            "preset": self.preset,
            "structure": dataclasses.asdict(trained.static),
            "numbers": [dataclasses.asdict(one) for one in trained.hyperparameters],
            "world": self.world,
            "data": self.data
            and {
                "file": str(self.data),
                "sha256": hashlib.sha256(self.data.read_bytes()).hexdigest(),
            },
            "budget": self.budget,
            "budget_path": [look_row(look) for look in budget.path] if budget else [],
            "versions": versions(),
            "failures": trained.failures,
            "dials": runs,
        }
        write_json(self.out / "run.json", rounded(record))
        return runs


def _history_rows(trained: Trained) -> list[Row]:
    """One row for each recorded update and run."""
    history = trained.history
    arrays = {name: np.asarray(history.array(name)) for name in history.values}
    return [
        {"updates": updates, "seed": one.seed}
        | {name: rounded(float(array[chunk, run])) for name, array in arrays.items()}
        for chunk, updates in enumerate(history.updates)
        for run, one in enumerate(trained.hyperparameters)
    ]


def look_row(look: Look) -> dict[str, Any]:
    """One step of dual ascent, of all runs."""
    return {
        "updates": look.updates,
        "regret": look.regret.tolist(),
        "multiplier": look.multiplier.tolist(),
    }
