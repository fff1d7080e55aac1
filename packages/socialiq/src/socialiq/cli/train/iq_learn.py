"""`train iq-learn`, `behaviour-cloning`, `cql` and `own`: demonstrations in, policies out.

Demonstrations of continuous actions are passed on to `cli.train.actors`.
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Display, Policies, say
from socialiq.cli.train import actors, shared
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation.angle_search import AngleSearch, search
from socialiq.evaluation.exact import exact_monitor
from socialiq.evaluation.labels import world_of
from socialiq.learners import extensions
from socialiq.learners.acting import acting_in
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.extensions import LEARNERS
from socialiq.learners.iq_learn.config import PRESETS
from socialiq.learners.iq_learn.train import check_fit, train
from socialiq.learners.settings import check_seeds
from socialiq.types import Row
from socialiq.worlds.catalogue import GRIDS, ROADS, base
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.environment import environment_maker
from socialiq.worlds.files import refuse_file
from socialiq.worlds.registry import make_grid


@dataclass(frozen=True)
class IQLearn(shared.Training):
    """Train policies by IQ-Learn with R(α), one for every angle, seed and strength.

    Demonstrations of continuous actions train an actor, with --set dial=true one for all angles.

    Example: socialiq train iq-learn mixed.safetensors --world crossing7 --angle 45 --out run
    """

    data: shared.Data
    _: KW_ONLY
    world: str = ""
    """World of the learner: crossing5, crossing7, crosswalk7, a road (intersection, merge, ...), or
    an environment (a Gymnasium id, MODULE:ID or MODULE:FUNCTION); none trains offline."""
    out: shared.Out
    preset: str = ""
    """Settings to begin with, by world, also that of the demonstrations. On roads:
    intersection-calibrated (default), intersection-thesis (Table C.1, with which every learner
    waits), intersection-shifted; with continuous actions intersection-continuous. In crossing7 and
    elsewhere: grid (default, Figs 6.2 to 6.4), lambda-sweep (appendix D), table-c1; in crossing5
    poc (6.1). For tens to hundreds of rows without social rewards: few-offline, with a world
    few-online."""
    angle_from: Path | None = None
    """Demonstrations of wanted behaviour, in the place of --angle: the angle of 0, 5, ..., 90 whose
    policy gives their actions the highest likelihood."""
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
    labels: shared.Labels = field(default_factory=shared.LabelOptions)
    grid: shared.Grid = field(default_factory=shared.GridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    scaling: shared.Scaling = field(default_factory=shared.ScalingOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        check_seeds(self.grid.seed)
        data = self.labels.load(self.data, continuous=True)
        names = ("prior", "value_term", "divergence")
        values = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if data.action_size:
            if self.loss or self.angle_from:
                name = "--loss" if self.loss else "--angle-from"
                raise UserError(f"{name} is of discrete actions: leave it out")
            for name in ("prior", "divergence"):
                if ":" in values.get(name, ""):
                    raise UserError(
                        f"a {name} of your own with continuous actions is for Python: pass it to "
                        "learners.continuous.train"
                    )
            values["online"] = bool(self.world)
            task = actors.Task(self, data, self.world, self.allow_code, self.preset)
            return task.run("iq-learn", values)
        self.scaling.refuse()
        functions = {}
        for name in ("loss", "prior", "divergence"):
            path = self.loss if name == "loss" else values.get(name, "")
            if ":" in path or path.endswith(".py") or (path and name == "loss"):
                functions[name] = extensions.load(path, f"--{name}", self.allow_code)
                values.pop(name, None)
        if "prior" in functions:
            functions["prior"] = extensions.checked_prior(functions["prior"])
        if "divergence" in functions:
            functions["divergence"] = extensions.checked_divergence(functions["divergence"])
        name = self.preset or usual_preset(self.world, data)
        one_of("preset", name, tuple(PRESETS))
        preset = PRESETS[name]
        if not self.world and preset[0].value_term == "value":
            values.setdefault("value_term", "value_expert")
        settings = values | {"online": bool(self.world)} | self.size.settings()
        static, numbers = self.options.apply(preset, settings)
        runs = self.grid.runs(numbers)
        record = {}
        if self.angle_from:
            searched = self.searched(data, static, runs[0], functions)
            runs = [replace(run, angle=searched.angle) for run in runs]
            behaviour = shared.described_file(self.angle_from)
            record = {"angle_search": {"behaviour": behaviour} | asdict(searched)}
        return _trained(self, data, static, runs, functions, self.world, record)

    def searched(
        self, data: Demonstrations, static: Any, run: Any, functions: dict[str, Any]
    ) -> AngleSearch:
        """Search the angle of the wanted behaviour, and print it with its interval.

        Args:
            data: Demonstrations of the training.
            static: Config of all runs.
            run: Hyperparameters of the policies but for their angle.
            functions: Functions of the user's own by part.

        Returns:
            The outcome of the search.

        Raises:
            UserError: If an option doesn't go with a search, or the wanted behaviour doesn't fit
                the demonstrations.
        """
        assert self.angle_from is not None
        if self.grid.angle != (0.0,) or len(self.grid.strength) > 1 or self.options.resume:
            raise UserError(
                "--angle-from decides the angle: leave out --angle and --resume, and give one "
                "--strength"
            )
        behaviour = files.load(self.angle_from)
        sizes = behaviour.n_features, behaviour.n_actions
        if sizes != (data.n_features, data.n_actions):
            raise UserError(
                f"{self.angle_from} has {sizes[0]} features and {sizes[1]} actions, and the "
                f"training's demonstrations have {data.n_features} and {data.n_actions}: collect "
                "both in one world"
            )

        def policies_at(angles: Sequence[float]) -> Sequence[Any]:
            runs = [replace(run, angle=angle) for angle in angles]
            simulator, collector = _place(self, data, static, runs, self.world)
            with Display() as display:
                callbacks = Callbacks(on_report=display.stage("search of the angle"))
                trained = train(
                    static, runs, [data], simulator, callbacks, shared.CHUNK, collector, **functions
                )
            if reason := trained.learner.no_angle():
                raise UserError(f"--angle-from needs policies with an angle: {reason}")
            return [trained.policy(number) for number in range(len(runs))]

        searched = search(policies_at, behaviour)
        say(
            f"angle of {self.angle_from}: {searched.angle:g} degrees (95 %: {searched.low:g} to "
            f"{searched.high:g})"
        )
        return searched


def usual_preset(world: str, data: Demonstrations) -> str:
    """Return the preset of a world, or without one of the world that demonstrations name."""
    recorded = None if world else world_of(data)
    name = world if recorded is None else recorded.name
    return "intersection-calibrated" if base(name) in ROADS else "grid"


@dataclass(frozen=True)
class Cloning(shared.Training):
    """Train policies by behaviour cloning, of discrete or continuous actions.

    Demonstrations count alike, or with --set weighted=true by how well they score at --angle.

    Example: socialiq train behaviour-cloning mixed.safetensors --out clone
    """

    data: shared.Data
    _: KW_ONLY
    out: shared.Out
    labels: shared.Labels = field(default_factory=shared.LabelOptions)
    grid: shared.PlainGrid = field(default_factory=shared.PlainGridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    scaling: shared.Scaling = field(default_factory=shared.ScalingOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        data = self.labels.load(self.data, continuous=True)
        if data.action_size:
            return actors.Task(self, data).run("behaviour-cloning")
        self.scaling.refuse()
        return _trained_offline(self, data, LEARNERS["behaviour-cloning"])


@dataclass(frozen=True)
class ConservativeQ(shared.Training):
    """Train policies by conservative Q-learning on λ R(α), offline.

    Example: socialiq train cql mixed.safetensors --angle 0 45 --out run
    """

    data: shared.Data
    _: KW_ONLY
    out: shared.Out
    labels: shared.Labels = field(default_factory=shared.LabelOptions)
    grid: shared.Grid = field(default_factory=shared.GridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        return _trained_offline(self, self.labels.load(self.data), LEARNERS["cql"])


@dataclass(frozen=True)
class Own(shared.Training):
    """Train policies by a learner of your own, offline, with the settings that it has.

    Example: socialiq train own mine.py:Weighted mixed.safetensors --allow-code --out run
    """

    learner: Annotated[str, tyro.conf.Positional]
    """FILE.py:NAME, a class that derives from `learners.kernel.Learner`."""
    data: shared.Data
    _: KW_ONLY
    out: shared.Out
    allow_code: bool = False
    """Import the file: its author's code runs with your rights."""
    labels: shared.Labels = field(default_factory=shared.LabelOptions)
    grid: shared.Grid = field(default_factory=shared.GridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        data = self.labels.load(self.data)
        return _trained_offline(
            self, data, extensions.find_learner(self.learner, "LEARNER", self.allow_code)
        )


def _trained_offline(command: Any, data: Demonstrations, learner: type[Any]) -> Policies:
    """Train a learner with its own settings, and write the folder."""
    configs = (learner.StaticConfig(), learner.Hyperparameters())
    static, numbers = command.options.apply(configs, command.size.settings())
    return _trained(command, data, static, command.grid.runs(numbers), {"learner": learner})


def _trained(
    command: Any,
    data: Demonstrations,
    static: Any,
    runs: list[Any],
    functions: dict[str, Any],
    world: str = "",
    further: Row | None = None,
) -> Policies:
    """Train with discrete actions, and write the folder, with `further` entries in run.json."""
    monitor = None
    simulator, collector = _place(command, data, static, runs, world)
    if "learner" not in functions:
        check_fit(static, runs, [data], simulator, collector is not None)
    schema = data.schema
    folder = shared.RunFolder(command.out, "policy", command.options, command.labels, schema)
    if simulator is not None:
        table = tabulate(simulator).reachable_part()
        monitor = exact_monitor(table, [numbers.temperature for numbers in runs])
    with folder.callbacks([shared.label(numbers) for numbers in runs], monitor) as callbacks:
        trained = train(
            static, runs, [data], simulator, callbacks, shared.CHUNK, collector, **functions
        )
    described = shared.described_file(command.data) | {"transitions": data.n_transitions}
    record = {"world": world, "data": described} | trained.learner.functions() | (further or {})
    return folder.finish_policies(trained, record)


def _place(
    command: Any, data: Demonstrations, static: Any, runs: list[Any], world: str
) -> tuple[Any, Any]:
    """Return the world that the program simulates, and what acts in any other; None without."""
    if world:
        refuse_file(world)
    if base(world) in GRIDS:  # stepped in the compiled program
        return make_grid(world), None
    if not world:
        return None, None
    make = environment_maker(world, (data.n_features, data.n_actions), command.allow_code)
    return None, acting_in(make, static, runs, shared.CHUNK)
