"""`train sac`, `td3-bc`, and all other learners where actions are continuous."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Printing
from socialiq.cli.train.options import GridOptions, RunOptions, ScalingOptions, SizeOptions, label
from socialiq.cli.train.run_folder import CHUNK, RunFolder, described_file
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.continuous.acting import ActorVectorCollector
from socialiq.learners.continuous.behaviour_cloning import BehaviourCloning
from socialiq.learners.continuous.config import PRESETS
from socialiq.learners.continuous.standardise import Standardisation, explored
from socialiq.learners.continuous.train import LEARNERS, acting_in, check_fit, train
from socialiq.learners.kernel import Trained
from socialiq.worlds import CONTINUOUS
from socialiq.worlds.environment import action_size, environment_maker, sizes
from socialiq.worlds.gym import learning_env
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import continuous_options, refuse_file

SIDE_BY_SIDE = 24
"""Episodes of the intersection side by side, of each run."""


@dataclass(frozen=True)
class SAC(Printing):
    """Train actors by soft actor-critic on R(α), in a world and without demonstrations.

    With --set dial=true one actor for all angles.

    Example: socialiq train sac --world intersection-continuous --angle 45 --out run
    """

    world: str = ""
    """intersection-continuous, intersection-continuous-steering (with -offroad: leaving the road
    ends an episode), or an environment (a Gymnasium id, MODULE:ID or MODULE:FUNCTION)."""
    _: KW_ONLY
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    preset: str = ""
    """Settings to begin with: intersection-continuous."""
    allow_code: bool = False
    """Import the environment's module: its author's code runs with your rights."""
    grid: tyro.conf.OmitArgPrefixes[GridOptions] = field(default_factory=GridOptions)
    size: tyro.conf.OmitArgPrefixes[SizeOptions] = field(default_factory=SizeOptions)
    scaling: tyro.conf.OmitArgPrefixes[ScalingOptions] = field(default_factory=ScalingOptions)
    options: tyro.conf.OmitArgPrefixes[RunOptions] = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        return Task(self.out, self.world, self.allow_code, self.preset).run("sac", None, self)


@dataclass(frozen=True)
class TD3BC(Printing):
    """Train actors by TD3+BC on λ R(α), offline from demonstrations of continuous actions.

    Example: socialiq train td3-bc mixed.safetensors --angle 0 45 --out run
    """

    data: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file, of `socialiq collect`."""
    _: KW_ONLY
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    grid: tyro.conf.OmitArgPrefixes[GridOptions] = field(default_factory=GridOptions)
    size: tyro.conf.OmitArgPrefixes[SizeOptions] = field(default_factory=SizeOptions)
    scaling: tyro.conf.OmitArgPrefixes[ScalingOptions] = field(default_factory=ScalingOptions)
    options: tyro.conf.OmitArgPrefixes[RunOptions] = field(default_factory=RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out.

        Raises:
            UserError: If the actions are discrete.
        """
        data = files.load(self.data, continuous=True)
        if not data.action_size:
            raise UserError(f"{self.data} has discrete actions: td3-bc is of continuous ones")
        return Task(self.out, data=self.data).run("td3-bc", data, self)


@dataclass(frozen=True)
class Task:
    """Training with continuous actions, of any learner.

    Attributes:
        out: Folder to make.
        world: Name of the world, "" without.
        allow_code: Whether the environment's module may be imported.
        preset: Name of the settings to begin with, "" for the learner's own.
        data: File of the demonstrations; None without.
    """

    out: Path
    world: str = ""
    allow_code: bool = False
    preset: str = ""
    data: Path | None = None

    def run(
        self,
        name: str,
        data: Demonstrations | None,
        command: Any,
        given: Mapping[str, Any] | None = None,
    ) -> int:
        """Train, write the folder, print what came out; return the exit status.

        Args:
            name: A key of `LEARNERS`.
            data: Demonstrations of continuous actions; None without.
            command: Has the groups of options: grid, size, scaling, options.
            given: Further settings.

        Raises:
            UserError: If settings, data and world don't fit together.
        """
        settings = command.size.given() | dict(given or {})
        static, numbers = command.options.apply(self._begun(name), settings)
        runs = command.grid.runs(numbers)
        kind = "dial" if getattr(static, "dial", False) else "policy"
        folder = RunFolder(self.out, kind, command.options, command.json)
        change = self._standardisation(command.scaling, static, data, runs[0].seed)
        rows = change.transitions(data) if change is not None and data is not None else data
        prepared = self._prepared(LEARNERS[name], static, runs, rows, change)
        labels = [label(one_run) for one_run in runs]
        with folder.callbacks(labels) as callbacks:
            trained = prepared(callbacks)
        record: dict[str, Any] = {"world": self.world}
        if data is not None and self.data is not None:
            record["data"] = described_file(self.data) | {"transitions": data.n_transitions}
        return folder.finish_policies(trained, labels, record, change.policy if change else None)

    def _begun(self, name: str) -> tuple[Any, Any]:
        """Return the settings to begin with: the learner's own, or those of the preset.

        Raises:
            UserError: If the preset is of discrete actions, or of another learner or world.
        """
        learner = LEARNERS[name]
        if not self.preset:
            static, numbers = learner.StaticConfig(), learner.Hyperparameters()
        elif self.preset not in PRESETS:
            names = ", ".join(PRESETS)
            raise UserError(
                f"no preset '{self.preset}' of continuous actions: choose {names}, or leave "
                "--preset out"
            )
        elif name not in PRESETS[self.preset]:
            names = " and ".join(PRESETS[self.preset])
            raise UserError(f"preset {self.preset} is of {names}, not of {name}: leave it out")
        elif self.world and self.world not in CONTINUOUS:
            names = ", ".join(CONTINUOUS)
            raise UserError(f"preset {self.preset} is not for {self.world}: choose {names}")
        else:
            static, numbers = PRESETS[self.preset][name]
        return static, numbers

    def _standardisation(
        self, scaling: ScalingOptions, static: Any, data: Demonstrations | None, seed: int
    ) -> Standardisation | None:
        """Return the change of observations that the command asks for.

        Raises:
            UserError: If there is nothing to standardise by, a view reads observations, or features
                can't be left out.
        """
        if not scaling.standardise:
            if scaling.leave_out:
                raise UserError("--leave-out is of standardised observations: add --standardise")
            return None
        if self.world in CONTINUOUS or static.view != "flat":
            raise UserError("observations of vehicles are scaled already: leave --standardise out")
        if data is not None:
            return Standardisation.of(data.observation, scaling.leave_out)
        if not self.world:
            raise UserError("--standardise is by demonstrations or a world: name one with --world")
        make = environment_maker(self.world, None, self.allow_code, continuous=True)
        return Standardisation.of(explored(make(), seed), scaling.leave_out)

    def _prepared(
        self,
        learner: type[Any],
        static: Any,
        runs: list[Any],
        data: Demonstrations | None,
        change: Standardisation | None,
    ) -> Callable[[Callbacks], Trained]:
        """Make the world, check that all fits, and return the training."""
        if learner is BehaviourCloning:
            assert data is not None  # only soft actor-critic is without
            return lambda callbacks: learner.train_on(static, runs, [data], callbacks, CHUNK)
        datasets = [] if data is None else [data]
        if not self.world:
            check_fit(learner, static, runs, datasets, None, None, False)
            return lambda callbacks: train(
                learner, static, runs, datasets, callbacks=callbacks, chunk=CHUNK
            )
        refuse_file(self.world)
        if self.world in CONTINUOUS:
            acting = _at_intersection(self.world, static, runs, data)
            check_fit(learner, static, runs, datasets, None, acting["sizes"], True)
            return lambda callbacks: train(
                learner, static, runs, datasets, callbacks=callbacks, **acting
            )
        interface = (data.n_features, data.action_size) if data is not None else None
        make = environment_maker(self.world, interface, self.allow_code, continuous=True)
        if change is not None:
            make = change.maker(make)
        first = make()
        shape = (sizes(first)[0], action_size(first))
        check_fit(learner, static, runs, datasets, None, shape, True)
        acting = {
            "sizes": shape,
            "chunk": static.updates_per_round,
            "before_chunk": acting_in(make, static, runs),
        }
        return lambda callbacks: train(
            learner, static, runs, datasets, callbacks=callbacks, **acting
        )


def _at_intersection(
    world: str, static: Any, runs: list[Any], data: Demonstrations | None
) -> dict[str, Any]:
    """Return what `train` needs to let runs act on the compiled core, all in one batch.

    Observations end with the time if those of the demonstrations do; without demonstrations, if the
    networks tell values of it apart.
    """
    steps = static.updates_per_round * getattr(static, "env_steps_per_update", 1)
    options = continuous_options(world)
    listed = Intersection(options).n_features
    clock = static.times > 0 if data is None else data.n_features == listed + 1
    env = learning_env(Intersection(options), len(runs) * SIDE_BY_SIDE, clock)
    rounds = -(-steps // SIDE_BY_SIDE)
    return {
        "sizes": (listed + clock, options.width),
        "chunk": static.updates_per_round,
        "before_chunk": ActorVectorCollector(env, rounds, static, runs),
    }
