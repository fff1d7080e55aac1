"""`train iq-learn`, `behaviour-cloning`, `cql` and `own`: demonstrations in, policies out.

Demonstrations of continuous actions are passed on to `cli.train.actors`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Printing
from socialiq.cli.train import actors
from socialiq.cli.train.options import (
    GridOptions,
    PlainGridOptions,
    RunOptions,
    ScalingOptions,
    SizeOptions,
    label,
)
from socialiq.cli.train.run_folder import CHUNK, RunFolder, described_file
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation.exact import exact_monitor
from socialiq.learners.collect import acting_in
from socialiq.learners.extensions import (
    LEARNERS,
    checked_divergence,
    checked_prior,
    find_learner,
    load,
)
from socialiq.learners.iq_learn.presets import PRESETS
from socialiq.learners.iq_learn.train import check_fit, train
from socialiq.learners.settings import check_seeds
from socialiq.learners.state import Runs
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.environment import environment_maker
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.registry import GRIDWORLDS, make_grid, refuse_file

Data = Annotated[Path, tyro.conf.Positional]
Grid = tyro.conf.OmitArgPrefixes[GridOptions]
Size = tyro.conf.OmitArgPrefixes[SizeOptions]
Scaling = tyro.conf.OmitArgPrefixes[ScalingOptions]
Run = tyro.conf.OmitArgPrefixes[RunOptions]


@dataclass(frozen=True)
class IQLearn(Printing):
    """Train policies by IQ-Learn with R(α), one for every angle, seed and strength.

    Demonstrations of continuous actions train an actor, with --set dial=true one for all angles.

    Example: socialiq train iq-learn mixed.safetensors --world crossing7 --angle 45 --out run
    """

    data: Data
    """Demonstrations file, of `socialiq collect`."""
    _: KW_ONLY
    world: str = ""
    """World of the learner: crossing5, crossing7, or an environment (a Gymnasium id, MODULE:ID
    or MODULE:FUNCTION); none trains offline."""
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    preset: str = ""
    """Settings to begin with: grid (default), table-c1, poc, lambda-sweep; for tens to hundreds of
    demonstrated rows without social rewards few-offline, and with a world few-online. At the
    intersection with continuous actions intersection-continuous."""
    prior: str | None = None
    """Social prior: none, reward, bellman_shift, reweighting, shifted_chi2, or FILE.py:NAME."""
    value_term: str | None = None
    """Term 2 over demonstrations and replay (value), demonstrations (value_expert: offline), or
    initial states (v0: offline)."""
    divergence: str | None = None
    """chi2, kl, reverse_kl, hellinger, js, or FILE.py:NAME."""
    loss: str = ""
    """FILE.py:NAME, a loss of your own in the place of the objective."""
    allow_code: bool = False
    """Import the environment's module, or files of --prior, --divergence, --loss: their author's
    code runs with your rights."""
    grid: Grid = field(default_factory=GridOptions)
    size: Size = field(default_factory=SizeOptions)
    scaling: Scaling = field(default_factory=ScalingOptions)
    options: Run = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        check_seeds(self.grid.seed)
        data = files.load(self.data, continuous=True)
        if data.action_size:
            self._refuse_own_code()
            task = actors.Task(self.out, self.world, self.allow_code, self.preset, self.data)
            return task.run("iq-learn", data, self, self._named(()))
        self.scaling.refuse()
        functions = self._own_code()
        one_of("preset", self.preset or "grid", tuple(PRESETS))
        settings = self._named(functions) | self.size.given()
        static, numbers = self.options.apply(PRESETS[self.preset or "grid"], settings)
        return _trained(self, data, static, self.grid.runs(numbers), functions, self.world)

    def _named(self, own: Any) -> dict[str, Any]:
        """Return the named settings that were given, without those that are code."""
        names = ("prior", "value_term", "divergence")
        values = {name: getattr(self, name) for name in names if name not in own}
        values = {name: value for name, value in values.items() if value is not None}
        return values | {"online": bool(self.world)}

    def _own_code(self) -> dict[str, Any]:
        """Import and try the user's own prior, divergence and loss, if named.

        Raises:
            UserError: If the code may not run, is not found, or fails.
        """
        places = {"loss": self.loss}
        for name in ("prior", "divergence"):
            file = getattr(self, name) or ""
            places[name] = file if ":" in file or file.endswith(".py") else ""
        functions: dict[str, Any] = {
            name: load(file, f"--{name}", self.allow_code) for name, file in places.items() if file
        }
        for name, check in (("prior", checked_prior), ("divergence", checked_divergence)):
            if name in functions:
                functions[name] = check(functions[name])
        return functions

    def _refuse_own_code(self) -> None:
        """Refuse a loss, prior or divergence of the user's own with continuous actions."""
        if self.loss:
            raise UserError("--loss is of discrete actions: leave it out")
        for name in ("prior", "divergence"):
            if ":" in (getattr(self, name) or ""):
                raise UserError(
                    f"a {name} of your own with continuous actions is for Python: pass it to "
                    "learners.continuous.train"
                )


@dataclass(frozen=True)
class Cloning(Printing):
    """Train policies by behaviour cloning, of discrete or continuous actions.

    Demonstrations count alike, or with --set weighted=true by how well they score at --angle.

    Example: socialiq train behaviour-cloning mixed.safetensors --out clone
    """

    data: Data
    """Demonstrations file, of `socialiq collect`."""
    _: KW_ONLY
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    grid: tyro.conf.OmitArgPrefixes[PlainGridOptions] = field(default_factory=PlainGridOptions)
    size: Size = field(default_factory=SizeOptions)
    scaling: Scaling = field(default_factory=ScalingOptions)
    options: Run = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        data = files.load(self.data, continuous=True)
        if data.action_size:
            return actors.Task(self.out, data=self.data).run("behaviour-cloning", data, self)
        self.scaling.refuse()
        return _trained_offline(self, data, LEARNERS["behaviour-cloning"])


@dataclass(frozen=True)
class ConservativeQ(Printing):
    """Train policies by conservative Q-learning on λ R(α), offline.

    Example: socialiq train cql mixed.safetensors --angle 0 45 --out run
    """

    data: Data
    """Demonstrations file, of `socialiq collect`."""
    _: KW_ONLY
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    grid: Grid = field(default_factory=GridOptions)
    size: Size = field(default_factory=SizeOptions)
    options: Run = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        return _trained_offline(self, files.load(self.data), LEARNERS["cql"])


@dataclass(frozen=True)
class Own(Printing):
    """Train policies by a learner of your own, offline, with the settings that it has.

    Example: socialiq train own mine.py:Weighted mixed.safetensors --allow-code --out run
    """

    learner: Annotated[str, tyro.conf.Positional]
    """FILE.py:NAME, a class that derives from `learners.kernel.Learner`."""
    data: Data
    """Demonstrations file, of `socialiq collect`."""
    _: KW_ONLY
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    allow_code: bool = False
    """Import the file: its author's code runs with your rights."""
    grid: Grid = field(default_factory=GridOptions)
    size: Size = field(default_factory=SizeOptions)
    options: Run = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        data = files.load(self.data)
        return _trained_offline(self, data, find_learner(self.learner, "LEARNER", self.allow_code))


def _trained_offline(command: Any, data: Demonstrations, learner: type[Any]) -> int:
    """Train a learner with its own settings, and write the folder; return the exit status."""
    configs = (learner.StaticConfig(), learner.Hyperparameters())
    static, numbers = command.options.apply(configs, command.size.given())
    return _trained(command, data, static, command.grid.runs(numbers), {"learner": learner})


def _trained(
    command: Any,
    data: Demonstrations,
    static: Any,
    runs: list[Any],
    own: dict[str, Any],
    world: str = "",
) -> int:
    """Train with discrete actions, and write the folder; return the exit status."""
    simulator, before_chunk = _experience(command, static, runs, data, world)
    if "learner" not in own:
        check_fit(static, runs, [data], simulator, before_chunk is not None)
    folder = RunFolder(command.out, "policy", command.options, command.json)
    monitor = None
    if simulator is not None:
        table = tabulate(simulator).reachable_part()
        monitor = exact_monitor(table, [numbers.temperature for numbers in runs])
    labels = [label(numbers) for numbers in runs]
    with folder.callbacks(labels, monitor) as callbacks:
        trained = train(static, runs, [data], simulator, callbacks, CHUNK, before_chunk, **own)
    described = described_file(command.data) | {"transitions": data.n_transitions}
    record = {"world": world, "data": described} | trained.learner.functions()
    return folder.finish_policies(trained, labels, record)


def _experience(
    command: Any, static: Any, runs: list[Any], data: Demonstrations, world: str
) -> tuple[GridWorld | None, Callable[[Runs, int], Runs] | None]:
    """Return a gridworld to step in the compiled program, or a collector for a Gymnasium id."""
    if not world:
        return None, None
    refuse_file(world)
    if world in GRIDWORLDS:
        return make_grid(world), None
    sizes = (data.n_features, data.n_actions)
    make = environment_maker(world, sizes, command.allow_code)
    return None, acting_in(make, static, runs, CHUNK)
