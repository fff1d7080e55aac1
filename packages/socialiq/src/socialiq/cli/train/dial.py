"""`train dial` and `train improve-dial`: one network for every social angle."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from socialiq.cli.drivers import road_named
from socialiq.cli.output import Printing
from socialiq.cli.train.options import RunOptions, SizeOptions
from socialiq.cli.train.run_folder import CHUNK, RunFolder, described_file
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation import road_training
from socialiq.evaluation.ground import Ground, exact_regret, with_clock
from socialiq.learners.dial.config import INTERSECTION, PRESETS, check_fit
from socialiq.learners.dial.train import ASCENT_EVERY, Budget, train
from socialiq.learners.kernel import Trained
from socialiq.learners.offline import config as offline
from socialiq.learners.policy_iteration import dial as iteration
from socialiq.learners.settings import check_seeds
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import Row, Simulator
from socialiq.worlds import CONTINUOUS, IDS, SCENE_IDS
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.registry import GRIDWORLDS, is_world_file, make_grid

ROADS = ("intersection", *SCENES)
"""Worlds on highway-env's roads, with discrete actions."""
ON_ROADS = "intersection"
"""Preset of these worlds."""


class Setting(NamedTuple):
    """Parts of a world that a training needs.

    Attributes:
        static: Structure for this world.
        data: Sets of demonstrations, with the time if the network sees it.
        sizes: Features of an observation and number of actions.
        simulator: World within JAX; None offline or on a road.
        collector: Collects experience outside JAX; None elsewhere.
        chunk: Updates between two rounds of reports and collection.
    """

    static: Any
    data: list[Demonstrations]
    sizes: tuple[int, int]
    simulator: Simulator | None
    collector: Any
    chunk: int


@dataclass(frozen=True)
class Dial(Printing):
    """Train one network for every social angle.

    Example: socialiq train dial clocked.safetensors --world crossing7 --out run
    """

    data: Annotated[Path | None, tyro.conf.Positional] = None
    """Demonstrations file, of `socialiq collect`, in a gridworld of `socialiq collect --clock`; a
    run without demonstrations has none."""
    _: KW_ONLY
    world: str
    """crossing5, crossing7, intersection, merge or roundabout."""
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    preset: str = ""
    """On a road of highway-env: intersection. In a gridworld: online (default), online-short (a
    fifth of its rows, knots of the angle), online-quick (seconds, less exact), online-alone (no
    demonstrations), online-clockless, offline, offline-redrawn (each transition at newly drawn
    times)."""
    angle: float | None = None
    """Train for this one social angle in degrees, instead of 0 to 90."""
    budget: float | None = None
    """With --angle: follow the demonstrations, but for a regret of at most this much at the angle,
    in units of reward; the strength that takes is found while training."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    size: tyro.conf.OmitArgPrefixes[SizeOptions] = field(default_factory=SizeOptions)
    options: tyro.conf.OmitArgPrefixes[RunOptions] = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        check_seeds(self.seed)
        self._check_world()
        name, preset = self._preset()
        configs = (self._narrowed(preset.structure), preset.numbers)
        structure, numbers = self.options.apply(configs, self.size.given())
        runs = [dataclasses.replace(numbers, seed=seed) for seed in self.seed]
        budget = self._dual_ascent(name, structure, runs)
        data = self._demonstrations(name, structure.demonstrations)
        if self.world in ROADS:
            setting = on_road(self.world, structure, runs, data)
        else:
            setting = in_gridworld(self.world, preset.clock, structure, data)
        static, data, sizes, simulator, collector, chunk = setting
        check_fit(static, runs, data, simulator, sizes, collector is not None)
        folder = RunFolder(self.out, "dial", self.options, self.json)
        labels = [{"seed": seed} for seed in self.seed]
        with folder.callbacks(labels) as callbacks:
            trained = train(
                static,
                runs,
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
            "budget_path": [
                {
                    "updates": look.updates,
                    "regret": look.regret.tolist(),
                    "multiplier": look.multiplier.tolist(),
                }
                for look in (budget.path if budget else ())
            ],
        }
        folder.finish(trained, labels, dials, record)
        return folder.report(trained, dials)

    def _check_world(self) -> None:
        """Refuse worlds that this learner doesn't know; the line names the learner that does."""
        if self.world in CONTINUOUS:
            raise UserError(
                f"{self.world} has continuous actions: `socialiq train sac --world {self.world} "
                "--set dial=true` trains a dial of them, iq-learn one from demonstrations"
            )
        if self.preset in offline.PRESETS or is_world_file(self.world):
            raise UserError(
                f"`socialiq train offline-dial FILE --world {self.world}` learns from "
                "demonstrations alone: name that learner"
            )
        one_of("world", self.world, (*GRIDWORLDS, *ROADS))

    def _preset(self) -> tuple[str, Any]:
        """Return the name and the preset; by default that of the world.

        Raises:
            UserError: If it is unknown, or of another world.
        """
        presets = {**PRESETS, ON_ROADS: INTERSECTION}
        road = self.world in ROADS
        name = self.preset or (ON_ROADS if road else "online")
        one_of("preset", name, tuple(presets))
        if (name == ON_ROADS) != road:
            names = ", ".join(preset for preset in presets if (preset == ON_ROADS) == road)
            raise UserError(f"preset '{name}' is not for {self.world}: choose {names}")
        return name, presets[name]

    def _demonstrations(self, preset: str, needed: bool) -> list[Demonstrations]:
        """Return the data of a run that learns from data.

        Raises:
            UserError: If they are missing, or given to a run that takes none.
        """
        if needed and self.data is None:
            collect = "socialiq collect WORLD --clock --out FILE"
            if self.world in ROADS:
                world = (IDS | SCENE_IDS)[self.world]
                collect = f"socialiq collect {world} --driver FILE --out FILE"
            raise UserError(
                f"preset '{preset}' learns from demonstrations: name their file ({collect})"
            )
        if not needed and self.data is not None:
            raise UserError(f"preset '{preset}' takes no demonstrations: leave the file out")
        return [files.load(self.data)] if self.data else []

    def _narrowed(self, static: Any) -> Any:
        """Return the preset's structure, for the one angle if there is one.

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

    def _dual_ascent(self, preset: str, static: Any, runs: list[Any]) -> Budget | None:
        """Return the search of the strength for the budget, if there is one.

        Raises:
            UserError: If the budget is not above 0, or the run too short to find anything.
        """
        if self.budget is None:
            return None
        if self.world in ROADS:
            raise UserError("a budget needs exact regrets: train in a gridworld, or leave it out")
        if static.updates <= ASCENT_EVERY:
            raise UserError(f"a budget is checked every {ASCENT_EVERY} updates: train for more")
        ground = with_clock(Ground.of(self.world), PRESETS[preset].clock)
        return Budget(exact_regret(ground, static, runs), np.full(len(runs), self.budget))


def in_gridworld(name: str, clock: bool, structure: Any, data: Sequence[Demonstrations]) -> Setting:
    """Return the setting of a gridworld."""
    plain = make_grid(name)
    world = plain.with_clock() if clock else plain
    times = world.horizon if structure.redraw_times else 0
    static = dataclasses.replace(structure, one_hot=world.one_hot, redraw_times=times)
    sizes = (world.n_features, world.n_actions)
    return Setting(static, list(data), sizes, world if static.online else None, None, CHUNK)


def on_road(
    name: str, structure: Any, runs: Sequence[Any], data: Sequence[Demonstrations]
) -> Setting:
    """Return the setting of the intersection or another road, with its default options.

    Data of `collect` lack the time, which is the number of the step.
    """
    world = road_named(name)
    clock = structure.redraw_times > 0
    if clock:
        structure = dataclasses.replace(
            structure,
            redraw_times=world.options.decisions,
            timeout_reward=world.options.timeout_weight,
        )
    plain = world.n_features
    sizes = (plain + clock, world.n_actions)
    timed = [table.with_clock() if clock and table.n_features == plain else table for table in data]
    collector = None
    if structure.online:
        collector = road_training.dial_collector(
            structure, runs, world, structure.environments, road_training.STEPS_PER_UPDATE
        )
    return Setting(structure, timed, sizes, None, collector, road_training.CHUNK)


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


@dataclass(frozen=True)
class ImproveDial(Printing):
    """Improve a dial of the intersection by rollouts in copies of the simulator.

    Example: socialiq train improve-dial dial.safetensors --out improved
    """

    dial: Annotated[Path, tyro.conf.Positional]
    """Dial file, of `socialiq train dial --world intersection`."""
    _: KW_ONLY
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    updates: int | None = None
    """Gradient steps; by default 20,000."""
    environments: int = 256
    """Episodes side by side in which states are labelled."""
    options: tyro.conf.OmitArgPrefixes[RunOptions] = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out.

        Raises:
            UserError: If there is no environment, or the dial is of another world.
        """
        check_seeds(self.seed)
        start, scenario = DialPolicy.load(self.dial), Options()
        clock = road_training.observes_time(start, scenario)
        settings = {} if self.updates is None else {"updates": self.updates}
        structure, numbers = self.options.apply(
            (road_training.ITERATION, road_training.ITERATION_NUMBERS), settings
        )
        static = iteration.with_network_of(structure, start)
        runs = [dataclasses.replace(numbers, seed=seed) for seed in self.seed]
        if self.environments < 1:
            raise UserError(f"environments must be at least 1, got {self.environments}")
        labellers = [
            road_training.dial_labeller(static, scenario, self.environments, clock) for _ in runs
        ]
        folder = RunFolder(self.out, "dial", self.options, self.json)
        labels = [{"seed": seed} for seed in self.seed]
        with folder.callbacks(labels) as callbacks:
            sizes, chunk = road_training.sizes_of(scenario, clock), road_training.CHUNK
            trained = iteration.train(static, runs, labellers, sizes, callbacks, chunk, start)
        dials = saved_dials(folder, trained)
        folder.finish(trained, labels, dials, {"start": described_file(self.dial)})
        return folder.report(trained, dials)
