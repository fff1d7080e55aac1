"""`train dial`, `offline-dial` and `improve-dial`: one network for every social angle."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from socialiq.audit.profile.environment import Environment
from socialiq.cli.drivers import complain_if_it_stands, observed, with_one_ego, world_of
from socialiq.cli.output import Display, Policies
from socialiq.cli.train import shared
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation import labels, road_training
from socialiq.evaluation.exact import Ground, exact_regret
from socialiq.learners import policy_iteration as iteration
from socialiq.learners.acting import acting_in
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial import config, offline
from socialiq.learners.dial.config import (
    OWN_DATA,
    OfflineDialConfig,
    OfflineDialHyperparameters,
)
from socialiq.learners.dial.train import ASCENT_EVERY, Budget, train
from socialiq.learners.kernel import Trained
from socialiq.learners.settings import check_seeds, check_social
from socialiq.nn.dial_policy import DialPolicy
from socialiq.outputs import all_or_none, new_folder, whole_folder
from socialiq.population.fleet import DURATION
from socialiq.results_folder import as_csv, versions
from socialiq.storage import write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds import catalogue, grammar, grid_world, registry
from socialiq.worlds.catalogue import ROADS
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.files import is_world_file

ON_ROADS = "intersection"
"""Preset of these worlds."""
OFFLINE = "offline-regularised"
"""Preset of `train offline-dial`."""


class _Place(NamedTuple):
    """World of a training with what learns there."""

    world: Any
    static: config.DialConfig
    data: Sequence[Demonstrations]
    sizes: tuple[int, int]  # of features and actions
    simulator: Any  # world that the program simulates; None where `collector` acts
    collector: Any
    chunk: int  # updates


@dataclass(frozen=True)
class Dial(shared.Training):
    """Train one network for every social angle.

    Example: socialiq train dial clocked.safetensors --world crossing7 --out run
    """

    data: Annotated[Path | None, tyro.conf.Positional] = None
    """Demonstrations file, of `socialiq collect`, in a gridworld of `socialiq collect --clock`; a
    run without demonstrations has none."""
    _: KW_ONLY
    world: str
    """crossing5, crossing7, crosswalk7, a road (intersection, merge, roundabout, ...), or an
    environment: a Gymnasium id, MODULE:ID or MODULE:FUNCTION."""
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    preset: str = ""
    """On a road of highway-env: intersection. In a gridworld: online-short (default), online (five
    times its rows), online-quick (seconds, less exact), online-alone (no demonstrations),
    online-classes (no demonstrations, in crosswalk7: the class angle is free too),
    online-clockless, offline, offline-redrawn (each transition at newly drawn times). In an
    environment: environment (default, no demonstrations), online-clockless, offline."""
    angle: float | None = None
    """Train for this one social angle in degrees, instead of 0 to 90."""
    budget: float | None = None
    """With --angle: follow the demonstrations, but for a regret of at most this much at the angle,
    in units of reward; the strength that takes is found while training."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    allow_code: bool = False
    """Import the environment's module: its author's code runs with your rights."""
    labels: shared.Labels = field(default_factory=shared.LabelOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        check_seeds(self.seed)
        written = grammar.parse(self.world)
        world = self._world(written)
        name, preset = self._preset(written)
        structure = preset.structure
        if self.angle is not None:
            narrow = {"low": self.angle, "high": self.angle, "margin": 0.0}
            structure = replace(structure, high_share=None, knots=0, **narrow)
        elif self.budget is not None:
            raise UserError("a budget is of the regret at one angle: add --angle")
        static, numbers = self.options.apply((structure, preset.numbers), self.size.settings())
        runs = [replace(numbers, seed=seed) for seed in self.seed]
        budget = self._dual_ascent(name, static, runs)
        self._check_data(name, static, written)
        data = self.labels.load_any(self.data)
        at = self._place(written, world, preset, static, runs, data)
        learning = at.static, runs, at.data, at.simulator, at.sizes
        config.check_fit(*learning, at.collector is not None)
        folder = shared.RunFolder(self.out, "dial", self.options, self.labels, at.world.schema)
        with folder.callbacks([{"seed": seed} for seed in self.seed]) as callbacks:
            options = {"chunk": ASCENT_EVERY if budget else at.chunk, "before_chunk": at.collector}
            trained = train(*learning, callbacks, budget=budget, **options)
        data_file = self.data and shared.described_file(self.data)
        record = {"preset": name, "world": self.world, "data": data_file}
        record |= {"budget": self.budget, "budget_path": []}
        place = at.world
        if isinstance(place, grid_world.GridWorld) and not static.classes:
            place = tabulate(place).reachable_part()
        return finish_dials(folder, trained, record, place, budget)

    def _place(
        self,
        written: grammar.Written,
        world: Any,
        preset: Any,
        static: config.DialConfig,
        runs: Sequence[Any],
        data: Sequence[Demonstrations],
    ) -> _Place:
        """Return where and from what the dials learn: on a road, elsewhere by rollouts, or exactly.

        Args:
            written: The world as it is written.
            world: The world.
            preset: The preset.
            static: Structure of the dial.
            runs: Hyperparameters of each dial.
            data: Demonstrations of each dial, or none.
        """
        simulator = None
        collector = None
        chunk = shared.CHUNK
        if written.name in ROADS:
            chunk = road_training.CHUNK
            clock = static.redraw_times > 0
            if clock:
                # Data of `collect` lack the time, which is the number of the step.
                times = world.options.decisions
                reward = world.options.timeout_weight
                static = replace(static, redraw_times=times, timeout_reward=reward)
                plain = world.n_features
                data = [rows.with_clock() if rows.n_features == plain else rows for rows in data]
            sizes = (world.n_features + clock, world.n_actions)
            if static.online:
                rounds = (static.environments, road_training.STEPS_PER_UPDATE)
                collector = road_training.dial_collector(static, runs, world, *rounds)
        elif not world.is_exact:
            sizes = (world.n_features, world.n_actions)
            if static.online:
                shared.say_if_silent(world.env)
                collector = acting_in(lambda: world.of(*written, True).env, static, runs, chunk)
        else:
            world = world.with_clock() if preset.clock else world
            world = world.with_parts() if static.classes else world
            times = world.horizon if static.redraw_times else 0
            static = replace(static, one_hot=world.one_hot, redraw_times=times)
            sizes = (world.n_features, world.n_actions)
            simulator = world if static.online else None
        return _Place(world, static, data, sizes, simulator, collector, chunk)

    def _world(self, written: grammar.Written) -> Any:
        """Return the world to learn in; refuse one of continuous actions or of demonstrations."""
        if self.preset == OFFLINE or is_world_file(self.world):
            raise UserError(
                f"`socialiq train offline-dial FILE --world {self.world}` learns from "
                "demonstrations alone: name that learner"
            )
        world: Any = world_of(written, self.allow_code)
        if world.action_size:
            raise UserError(
                f"{self.world} has continuous actions: `socialiq train sac --world {self.world} "
                "--set dial=true` trains a dial of them, iq-learn one from demonstrations"
            )
        return world

    def _check_data(self, name: str, static: config.DialConfig, written: grammar.Written) -> None:
        """Refuse demonstrations that a preset doesn't take, and a preset without its own."""
        if static.demonstrations and self.data is None:
            collect = "socialiq collect WORLD --clock --out FILE"
            if written.name not in catalogue.GRIDS:
                collect = f"socialiq collect {self.world} --driver FILE --out FILE"
            raise UserError(
                f"preset '{name}' learns from demonstrations: name their file ({collect})"
            )
        if not static.demonstrations and self.data is not None:
            raise UserError(f"preset '{name}' takes no demonstrations: leave the file out")

    def _preset(self, written: grammar.Written) -> tuple[str, Any]:
        """Return the name and the preset, by default the first that is for the world."""
        presets: dict[str, Any] = config.PRESETS
        usual = "online-short"
        if written.name in ROADS:
            presets = {ON_ROADS: config.INTERSECTION}
            usual = ON_ROADS
        elif not written.is_built:
            presets = config.IN_ENVIRONMENTS
            usual = "environment"
        name = self.preset or usual
        if name not in presets:
            choice = ", ".join(presets)
            raise UserError(f"preset '{name}' is not for {self.world}: choose {choice}")
        return name, presets[name]

    def _dual_ascent(self, preset: str, static: Any, runs: list[Any]) -> Budget | None:
        """Return the search of the strength for the budget, if there is one."""
        if self.budget is None:
            return None
        if catalogue.base(self.world) not in catalogue.GRIDS:
            raise UserError("a budget needs exact regrets: train in a gridworld, or leave it out")
        if static.classes:
            raise UserError("a budget is of one class angle: leave it out with --set classes=true")
        if static.updates <= ASCENT_EVERY:
            raise UserError(
                f"a budget is checked every {ASCENT_EVERY} updates: give more --updates"
            )
        ground = Ground.of(self.world).with_clock(config.PRESETS[preset].clock)
        return Budget(exact_regret(ground, static, runs), np.full(len(runs), self.budget))


def finish_dials(
    folder: shared.RunFolder,
    trained: Trained,
    record: Row,
    world: Any,
    budget: Budget | None = None,
) -> Policies:
    """Write the dials and their record, with the outcome of the budget.

    Args:
        folder: Folder of the run.
        trained: Outcome of the training.
        record: Further fields of run.json; the path of the budget is added to it.
        world: World whose observations show whether a dial stands, as for `observed`.
        budget: Search of the strength for a budget of regret; None if there was none.

    Returns:
        The outcome.
    """
    losses = np.asarray(trained.history.array("loss"))[-1]
    labels = [{"seed": numbers.seed} for numbers in trained.hyperparameters]
    if budget is not None:
        record["budget_path"] = [
            {"updates": look.updates}
            | {"regret": look.regret.tolist(), "multiplier": look.multiplier.tolist()}
            for look in budget.path
        ]
    with all_or_none(folder.out) if folder.out else nullcontext():
        dials = []
        for run, saved in enumerate(
            folder.save_policies(trained, observe=partial(observed, world))
        ):
            sha256 = saved.pop("sha256")
            row = {**saved, **labels[run], "loss": float(losses[run]), "sha256": sha256}
            dials.append(row)
            if budget is not None:
                regret = float(budget.path[-1].regret[run])
                dials[-1] |= {"multiplier": float(trained.retained[run]), "regret": regret}
        return folder.finish(trained, labels, dials, record)


@dataclass(frozen=True)
class ImproveDial(shared.Training):
    """Improve a dial of the intersection by rollouts in copies of the simulator.

    With crosswalks it begins with no dial, and the dial has two angles: the class angle is free
    too.

    Example: socialiq train improve-dial dial.safetensors --out improved
    """

    dial: Annotated[Path | None, tyro.conf.Positional] = None
    """Dial file, of `socialiq train dial --world intersection`; with crosswalks none."""
    _: KW_ONLY
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    world: str = "intersection"
    """World to improve in: intersection, or intersection-caused, whose r_social is what the ego
    causes; or intersection-crosswalk, its -caused, or its -bicycles, in which some people ride."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    updates: int | None = None
    """Gradient steps; by default 20,000, with crosswalks 8,000."""
    agents: int = 1
    """Vehicles of an episode, of 2 to 16, that the dial drives against itself; r_social is then
    what the other agents get, the sum of their r_env."""
    environments: int = 256
    """Episodes side by side in which states are labelled."""
    shift: tuple[str, ...] = ()
    """Worlds of the intersection to train in, by their shifts (`socialiq evaluate --shift`): equal
    shares of the states are of each, and an episode draws one of several that "or" divides, as
    "none or late or unseen=.3" right straight. A front end knows them, and the clock tells the
    exit: drive the dial with --front-end known,exit=own."""
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        check_seeds(self.seed)
        written = grammar.parse(self.world)
        one_of("world", written.name, (catalogue.INTERSECTION,))
        world: Any = with_one_ego(written)
        if written.control:
            raise UserError(
                f"{self.world} has continuous actions: `socialiq train sac` learns there"
            )
        if self.agents < 1 or (self.agents > 1 and world.effects):
            raise UserError(f"--agents {self.agents}: give 1, or 2 to 16 in the plain intersection")
        if self.environments < 1:
            raise UserError(f"--environments {self.environments}: give 1 or more")
        if self.shift and (self.agents > 1 or written.options):
            raise UserError("--shift is of one ego in intersection: leave out the other")
        walks = world.walks
        if walks != (self.dial is None) or (walks and self.agents > 1):
            raise UserError(
                f"a dial of {self.world} begins with no dial and drives alone: leave both out"
                if walks
                else f"name the dial to improve in {self.world}, of `socialiq train dial`"
            )
        settings = {} if self.updates is None else {"updates": self.updates}
        static, numbers, labeller, sizes, start = self._method(world, settings)
        runs = [replace(numbers, seed=seed) for seed in self.seed]
        folder = shared.RunFolder(self.out, "dial", self.options, schema=world.schema)
        with folder.callbacks([{"seed": seed} for seed in self.seed]) as callbacks:
            method = static, runs, [labeller] * len(runs), sizes
            trained = iteration.train(*method, callbacks, road_training.CHUNK, start)
        record = {"start": self.dial and shared.described_file(self.dial), "agents": self.agents}
        record |= {"shifts": list(self.shift)} if self.shift else {}
        return finish_dials(folder, trained, record, world)

    def _method(self, world: Any, settings: dict[str, Any]) -> tuple[Any, ...]:
        """Return structure, numbers, labeller, sizes and the first dial, if there is one."""
        if self.dial is None:
            presets = road_training.CROSSWALK, road_training.CROSSWALK_NUMBERS
            structure, numbers = self.options.apply(presets, settings)
            learned = road_training.of_crosswalks(structure, world, self.environments)
            return learned[0], numbers, *learned[1:], None
        presets = road_training.ITERATION, road_training.ITERATION_NUMBERS
        structure, numbers = self.options.apply(presets, settings)
        start = DialPolicy.load(self.dial)
        clock = road_training.observes_time(start, world.options)
        static = iteration.with_network_of(structure, start)
        sizes = road_training.sizes_of(world.options, clock)
        if self.shift:
            method = structure, start, self.shift, self.environments
            start, static, labeller = road_training.shifted(*method)
            return static, numbers, labeller, sizes, start
        labeller = road_training.dial_labeller(static, world, self.environments, clock)
        if self.agents > 1:
            fleet = registry.make_fleet(agents=self.agents, duration=DURATION)
            labeller = road_training.fleet_labeller(static, fleet, self.environments, clock)
        return static, numbers, labeller, sizes, start


@dataclass(frozen=True)
class OfflineDial(shared.Training):
    """Train a dial of any world from demonstrations alone, regularised towards their drivers.

    Example: socialiq train offline-dial mixed.safetensors --out run
    """

    data: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file, of `socialiq collect` or `socialiq data`."""
    _: KW_ONLY
    world: str = ""
    """World of the demonstrations, which they must fit: a world, an environment, or a file of
    `socialiq data world`; by default the one that they name, if any."""
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    allow_code: bool = False
    """Import the environment's module: its author's code runs with your rights."""
    seed: tuple[int, ...] = (0,)
    """Training seeds, a dial each."""
    labels: shared.Labels = field(default_factory=shared.LabelOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    options: shared.Set = field(default_factory=shared.SetOptions)

    def result(self) -> Policies:
        """Train a dial for each seed, write the folder."""
        check_seeds(self.seed)
        data = self.labels.load(self.data)
        check_social([data])
        settings = encoding_of(self.world, data, self.allow_code) | self.size.settings()
        configs = OfflineDialConfig(), OfflineDialHyperparameters()
        static, numbers = self.options.apply(configs, settings)
        runs = [replace(numbers, seed=seed) for seed in self.seed]
        out: Path | None = self.out  # a function may have none
        if out:
            new_folder(out).rmdir()  # refused now if it has content or can't be made
        self.labels.say()
        with whole_folder(out) if out else nullcontext() as folder:
            dials, trained = self.write(folder, static, runs, data)
        numbers = {"out": str(out or ""), "dials": dials}
        return Policies(numbers, dials, table=dials, trained=trained)

    def write(
        self, folder: Path | None, static: Any, runs: Sequence[Any], data: Demonstrations
    ) -> tuple[list[Row], list[DialPolicy]]:
        """Train, and fill the folder with dials and their record.

        Args:
            folder: Folder to fill; None for none.
            static: Structure of the networks and of the training.
            runs: Hyperparameters of each dial.
            data: The demonstrations.

        Returns:
            The dials' entries in run.json (file, seed, SHA-256), and the dials.
        """
        dials: list[Row] = []
        policies: list[DialPolicy] = []
        metrics: list[Row] = []
        for number, numbers in enumerate(runs):
            with Display() as display:
                stages = self.stages(number, static, numbers, data, display)
            file = f"dial_{number}.safetensors"
            dial = shared.of_schema(stages["dial"].policy(0), data.schema)
            policies.append(dial)
            saved = shared.saved_in(folder, file, dial)
            sha256 = saved.pop("sha256")
            name = str(self.out / file) if folder else dial
            complain_if_it_stands(name, dial, data.observation)
            dials.append({**saved, "seed": numbers.seed, "sha256": sha256})
            for stage, trained in stages.items():
                losses = np.asarray(trained.history.array("loss"))[:, 0]
                start = {"seed": numbers.seed, "stage": stage}
                metrics += [
                    start | {"updates": updates, "loss": rounded(float(loss))}
                    for updates, loss in zip(trained.history.updates, losses, strict=True)
                ]
        if folder is None:
            return dials, policies
        write_atomically(folder / "metrics.csv", as_csv(metrics))
        record = {
            "structure": asdict(static),
            "numbers": [asdict(numbers) for numbers in runs],
            "preset": OFFLINE,
            "world": self.world,
            "data": shared.described_file(self.data),
            "practice": self.practised(),
            "versions": versions(),
            "dials": dials,
        }
        write_json(folder / "run.json", rounded(record))
        return dials, policies

    def practised(self) -> Row | None:
        """Return the record of practice in the world; None for a training without."""
        return None

    def stages(
        self, number: int, static: Any, numbers: Any, data: Demonstrations, display: Display
    ) -> dict[str, Trained]:
        """Train one dial.

        Args:
            number: Number of the dial, from 0.
            static: Structure of the networks and of the training.
            numbers: Hyperparameters of the dial.
            data: The demonstrations.
            display: Shows the progress.

        Returns:
            The outcome of each stage of the training; "dial" has the policy.
        """
        del number  # of use to trainings that practise

        def progress(stage: str) -> Callbacks:
            return Callbacks(on_report=display.stage(stage))

        return offline.train(static, [numbers], [data], progress, shared.CHUNK)


def encoding_of(name: str, data: Demonstrations, allow_code: bool) -> dict[str, Any]:
    """Return what a world determines of the static config: encoding, length of an episode.

    Args:
        name: Name of the world; "" for the one that the demonstrations name, if any.
        data: Demonstrations of this world, with a clock or without.
        allow_code: Whether the module of an environment may be imported.

    Returns:
        Settings of the learner by name.

    Raises:
        UserError: If the demonstrations have other features or actions than the world.
    """
    sizes = data.n_features, data.n_actions
    world = world_of(grammar.parse(name), allow_code) if name else labels.world_of(data)
    if world is None:
        return OWN_DATA
    for view in (world, world.with_clock()):
        if (view.n_features, view.n_actions) == sizes:
            return OWN_DATA if isinstance(view, Environment) else view.encoding
    raise UserError(
        f"the demonstrations have {sizes[0]} features and {sizes[1]} actions, {world.name} has "
        f"{world.n_features} and {world.n_actions}: they belong to another world"
    )
