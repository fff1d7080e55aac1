"""`train sac`, `td3-bc`, and all other learners where actions are continuous."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any

from socialiq.cli.output import Printing
from socialiq.cli.train import shared
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.acting import acting_in, actors_together
from socialiq.learners.collect import VectorCollector
from socialiq.learners.continuous.config import PRESETS
from socialiq.learners.continuous.standardise import Standardisation, explored
from socialiq.learners.continuous.train import LEARNERS, check_fit, train
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
    grid: shared.Grid = field(default_factory=shared.GridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    scaling: shared.Scaling = field(default_factory=shared.ScalingOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        return Task(self, None, self.world, self.allow_code, self.preset).run("sac")


@dataclass(frozen=True)
class TD3BC(Printing):
    """Train actors by TD3+BC on λ R(α), offline from demonstrations of continuous actions.

    Example: socialiq train td3-bc mixed.safetensors --angle 0 45 --out run
    """

    data: shared.Data
    """Demonstrations file, of `socialiq collect`."""
    _: KW_ONLY
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    grid: shared.Grid = field(default_factory=shared.GridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    scaling: shared.Scaling = field(default_factory=shared.ScalingOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def run(self) -> int:
        """Train, write the folder, print what came out.

        Raises:
            UserError: If the actions are discrete.
        """
        data = files.load(self.data, continuous=True)
        if not data.action_size:
            raise UserError(f"{self.data} has discrete actions: td3-bc is of continuous ones")
        return Task(self, data).run("td3-bc")


@dataclass(frozen=True)
class Task:
    """Training with continuous actions, of any learner.

    Attributes:
        command: Has the folder `out`, the groups of options grid, size, scaling and options, and
            the file `data` of the demonstrations if there are any.
        data: Demonstrations of continuous actions; None without.
        world: Name of the world, "" without.
        allow_code: Whether the environment's module may be imported.
        preset: Name of the settings to begin with, "" for the learner's own.
    """

    command: Any
    data: Demonstrations | None
    world: str = ""
    allow_code: bool = False
    preset: str = ""

    def run(self, name: str, given: Mapping[str, Any] | None = None) -> int:
        """Train, write the folder, print what came out; return the exit status.

        Args:
            name: A key of `LEARNERS`.
            given: Further settings.

        Raises:
            UserError: If settings, data and world don't fit together.
        """
        command, data = self.command, self.data
        settings = command.size.given() | dict(given or {})
        static, numbers = command.options.apply(self._begun(name), settings)
        runs = command.grid.runs(numbers)
        kind = "dial" if getattr(static, "dial", False) else "policy"
        folder = shared.RunFolder(command.out, kind, command.options, command.json)
        change = self._standardisation(static, runs[0].seed)
        if change is not None and data is not None:
            data = change.transitions(data)
        datasets = [] if data is None else [data]
        acting: dict[str, Any] = self._acting(static, runs, change) if self.world else {}
        clones = name == "behaviour-cloning"
        if not clones:
            check_fit(static, runs, datasets, None, acting.get("sizes"), bool(acting))
        with folder.callbacks([shared.label(one_run) for one_run in runs]) as callbacks:
            if clones:
                trained = LEARNERS[name].train_on(static, runs, datasets, callbacks, shared.CHUNK)
            else:
                acting = {"chunk": shared.CHUNK, **acting}
                trained = train(static, runs, datasets, callbacks=callbacks, **acting)
        record: dict[str, Any] = {"world": self.world}
        if data is not None:
            described = shared.described_file(command.data)
            record["data"] = described | {"transitions": data.n_transitions}
        return folder.finish_policies(trained, record, change.policy if change else None)

    def _begun(self, name: str) -> tuple[Any, Any]:
        """Return the settings to begin with: the learner's own, or those of the preset.

        Raises:
            UserError: If the preset is of discrete actions, or of another learner or world.
        """
        if not self.preset:
            return LEARNERS[name].StaticConfig(), LEARNERS[name].Hyperparameters()
        if self.preset not in PRESETS:
            names = ", ".join(PRESETS)
            raise UserError(
                f"no preset '{self.preset}' of continuous actions: choose {names}, or leave "
                "--preset out"
            )
        if name not in PRESETS[self.preset]:
            names = " and ".join(PRESETS[self.preset])
            raise UserError(f"preset {self.preset} is of {names}, not of {name}: leave it out")
        if self.world and self.world not in CONTINUOUS:
            names = ", ".join(CONTINUOUS)
            raise UserError(f"preset {self.preset} is not for {self.world}: choose {names}")
        return PRESETS[self.preset][name]

    def _standardisation(self, static: Any, seed: int) -> Standardisation | None:
        """Return the change of observations that the command asks for.

        Raises:
            UserError: If there is nothing to standardise by, a view reads observations, or features
                can't be left out.
        """
        scaling = self.command.scaling
        if not scaling.standardise:
            if scaling.leave_out:
                raise UserError("--leave-out is of standardised observations: add --standardise")
            return None
        if self.world in CONTINUOUS or static.view != "flat":
            raise UserError("observations of vehicles are scaled already: leave --standardise out")
        if self.data is not None:
            return Standardisation.of(self.data.observation, scaling.leave_out)
        if not self.world:
            raise UserError("--standardise is by demonstrations or a world: name one with --world")
        make = environment_maker(self.world, None, self.allow_code, continuous=True)
        return Standardisation.of(explored(make(), seed), scaling.leave_out)

    def _acting(
        self, static: Any, runs: list[Any], change: Standardisation | None
    ) -> dict[str, Any]:
        """Return what `train` needs to let runs act in the world.

        At the intersection they act on the compiled core, all in one batch. Observations there end
        with the time if those of the demonstrations do; without demonstrations, if the networks
        tell values of it apart.
        """
        refuse_file(self.world)
        data, chunk = self.data, static.updates_per_round
        if self.world in CONTINUOUS:
            steps = chunk * getattr(static, "env_steps_per_update", 1)
            options = continuous_options(self.world)
            listed = Intersection(options).n_features
            clock = static.times > 0 if data is None else data.n_features == listed + 1
            env = learning_env(Intersection(options), len(runs) * SIDE_BY_SIDE, clock)
            shape = (listed + clock, options.width)
            together = actors_together(static, runs)
            collector = VectorCollector(env, -(-steps // SIDE_BY_SIDE), runs, together)
        else:
            interface = (data.n_features, data.action_size) if data is not None else None
            make = environment_maker(self.world, interface, self.allow_code, continuous=True)
            make = make if change is None else change.maker(make)
            first = make()
            shape = (sizes(first)[0], action_size(first))
            collector = acting_in(make, static, runs, chunk)
        return {"sizes": shape, "chunk": chunk, "before_chunk": collector}
