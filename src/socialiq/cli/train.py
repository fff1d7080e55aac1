"""`train`: demonstrations in, policies out; a grid of runs in one compiled program."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import tyro

from socialiq.cli.output import complain, print_json, print_table
from socialiq.cli.progress import Display, to_all
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation.exact import exact_monitor
from socialiq.experiments.results import as_csv, versions
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import acting_in
from socialiq.learners.iq_learn.config import Hyperparameters, StaticConfig
from socialiq.learners.iq_learn.presets import PRESETS
from socialiq.learners.iq_learn.train import Trained, check_fit, train
from socialiq.learners.ranges import check_seeds
from socialiq.learners.state import Runs
from socialiq.learners.tensorboard import EventFiles
from socialiq.recordings.recording import refuse_recording
from socialiq.storage import new_folder, write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.environment import make_environment, sizes
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.registry import GRIDWORLDS, make_grid

CHUNK = 500


@dataclass(frozen=True)
class Train:
    """Train a policy for every angle, strength and seed given, from one file of demonstrations.

    Example: socialiq train mixed.safetensors --world crossing7 --angle 45 --out run
    """

    data: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file, of `socialiq collect`."""
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    world: str = ""
    """World of the learner: crossing5, crossing7, or an environment (a Gymnasium id, MODULE:ID
    or MODULE:FUNCTION); none trains offline."""
    allow_code: bool = False
    """Import the environment's module: its author's code runs with your rights."""
    angle: tuple[float, ...] = (0.0,)
    """Target angles in degrees."""
    strength: tuple[float, ...] = ()
    """λ; by default the preset's."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    preset: str = "grid"
    """Settings to begin with: table-c1, poc, grid, lambda-sweep. Every option below overrides."""
    resume: bool = False
    """Go on with a run that was stopped."""
    tensorboard: Path | None = None
    """Folder for TensorBoard's event files too, one for each policy; metrics.csv is always
    written."""
    json: bool = False
    """Print one JSON object."""

    prior: str | None = None
    """none (the baseline), reward, bellman_shift, reweighting, shifted_chi2."""
    target_kind: str | None = None
    """Reading of "cumulative": running, to_go, trajectory, instantaneous; or advantage,
    advantage_fitted."""
    divergence: str | None = None
    """chi2, kl, reverse_kl, hellinger, js."""
    value_term: str | None = None
    """value (needs a world), value_expert, v0."""
    chi2_on: str | None = None
    """expert or mixture."""
    next_value: str | None = None
    """V(s') by a target network (target) or by the network with gradient (online)."""
    hidden: tuple[int, ...] | None = None
    """Widths of the hidden layers."""
    activation: str | None = None
    """relu or elu."""
    batch_size: int | None = None
    """Transitions per batch."""
    updates: int | None = None
    """Gradient steps."""
    timeout: str | None = None
    """V(s') after a timeout: zero (terminal, as in the thesis), bootstrap or absorbing."""
    prior_weight: float | None = None
    """w, the weight of the social prior."""
    temperature: float | None = None
    """τ."""
    discount: float | None = None
    """γ."""
    chi2_alpha: float | None = None
    """α_χ."""
    learning_rate: float | None = None
    """Of Adam."""
    polyak: float | None = None
    """τ_target."""

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        data = files.load(self.data)
        static, hyperparameters = self.settings()
        simulator, before_chunk = self.surroundings(static, hyperparameters, data)
        check_fit(static, hyperparameters, [data], simulator, before_chunk is not None)
        with ExitStack() as stack:
            events = self.event_files(hyperparameters, stack)
            checkpoint = self.folder() / "checkpoint.safetensors"
            told = [stack.enter_context(Display()).stage("training"), *events]
            trained = train(
                static,
                hyperparameters,
                [data],
                simulator,
                Callbacks(
                    on_report=to_all(told),
                    monitor=_monitor(simulator, hyperparameters),
                    checkpoint=checkpoint,
                    resume=self.resume,
                ),
                CHUNK,
                before_chunk,
            )
        runs = self.write(trained, data)
        checkpoint.unlink(missing_ok=True)
        if self.json:
            print_json({"out": str(self.out), "policies": runs})
        else:
            print_table([{k: v for k, v in run.items() if k != "sha256"} for run in runs])
        for failure in trained.failures:
            complain(failure)
        return 1 if trained.failures else 0

    def settings(self) -> tuple[StaticConfig, list[Hyperparameters]]:
        """The preset with the options laid over it."""
        one_of("preset", self.preset, tuple(PRESETS))
        check_seeds(self.seed)
        static, base = PRESETS[self.preset]
        static = dataclasses.replace(static, online=bool(self.world), **self._given(StaticConfig))
        if self.timeout is not None:
            endings = dataclasses.replace(static.endings, timeout=self.timeout)
            static = dataclasses.replace(static, endings=endings)
        base = dataclasses.replace(base, **self._given(Hyperparameters))
        hyperparameters = [
            dataclasses.replace(base, angle=angle, strength=strength, seed=seed)
            for angle in self.angle
            for strength in self.strength or (base.strength,)
            for seed in self.seed
        ]
        return static, hyperparameters

    def _given(self, kind: type) -> dict[str, Any]:
        """Options of this command that override fields of a settings class."""
        own = {"angle", "strength", "seed"}
        names = {field.name for field in dataclasses.fields(kind)} - own
        given = {name: getattr(self, name, None) for name in names}
        return {name: value for name, value in given.items() if value is not None}

    def surroundings(
        self, static: StaticConfig, hyperparameters: list[Hyperparameters], data: Demonstrations
    ) -> tuple[GridWorld | None, Callable[[Runs, int], Runs] | None]:
        """A gridworld to step in the compiled program, or a collector for a Gymnasium id."""
        if not self.world:
            return None, None
        refuse_recording(self.world)
        if self.world in GRIDWORLDS:
            return make_grid(self.world), None

        def make() -> gymnasium.Env[Any, Any]:
            env = make_environment(self.world, allow_code=self.allow_code)
            given, wanted = (data.n_features, data.n_actions), sizes(env)
            if given != wanted:
                raise UserError(
                    f"the demonstrations have {given[0]} features and {given[1]} actions, "
                    f"the world has {wanted[0]} and {wanted[1]}: they belong to another world"
                )
            return env

        return None, acting_in(make, static, hyperparameters, CHUNK)

    def event_files(
        self, hyperparameters: list[Hyperparameters], stack: ExitStack
    ) -> list[EventFiles]:
        """Event files of all runs, if they are asked for; closed with the stack."""
        if self.tensorboard is None:
            return []
        names = [
            f"angle_{n.angle:g}_strength_{n.strength:g}_seed_{n.seed}" for n in hyperparameters
        ]
        return [stack.enter_context(EventFiles(self.tensorboard, names))]

    def folder(self) -> Path:
        """The output folder: a new one, or that of a stopped run."""
        if not self.resume:
            return new_folder(self.out)
        if (self.out / "run.json").exists():
            raise UserError(f"{self.out} holds a finished run: there is nothing to resume")
        return self.out

    def write(self, trained: Trained, data: Demonstrations) -> list[Row]:
        """Policies, metrics and the record of the run."""
        runs = []
        for run, hyperparameters in enumerate(trained.hyperparameters):
            name = f"policy_{run}.safetensors"
            sha256 = trained.policy(run).save(self.out / name)
            last = {
                name.removeprefix("greedy_"): trained.history.array(name)[-1, run]
                for name in trained.history.values
                if name in ("greedy_angle", "greedy_arrival", "loss")
            }
            described = {"angle": hyperparameters.angle, "strength": hyperparameters.strength}
            described |= {"seed": hyperparameters.seed, "file": name, "sha256": sha256}
            names = {"angle": "angle_hat"}
            runs.append(described | {names.get(k, k): float(v) for k, v in last.items()})
        write_atomically(self.out / "metrics.csv", as_csv(_history_rows(trained)))
        record = {
            "structure": dataclasses.asdict(trained.static),
            "numbers": [dataclasses.asdict(one) for one in trained.hyperparameters],
            "world": self.world,
            "data": {
                "file": str(self.data),
                "sha256": hashlib.sha256(self.data.read_bytes()).hexdigest(),
                "transitions": data.n_transitions,
            },
            "versions": versions(),
            "failures": trained.failures,
            "policies": runs,
        }
        write_json(self.out / "run.json", rounded(record))
        return runs


def _monitor(simulator: GridWorld | None, hyperparameters: list[Hyperparameters]) -> Any:
    if simulator is None:
        return None
    part = tabulate(simulator).reachable_part()
    return exact_monitor(part, [one.temperature for one in hyperparameters])


def _history_rows(trained: Trained) -> list[Row]:
    """One row for each recorded update and run."""
    history = trained.history
    arrays = {name: history.array(name) for name in history.values}
    return [
        {"updates": updates, "angle_target": one.angle, "strength": one.strength, "seed": one.seed}
        | {name: rounded(float(array[chunk, run])) for name, array in arrays.items()}
        for chunk, updates in enumerate(history.updates)
        for run, one in enumerate(trained.hyperparameters)
    ]
