"""`train sac`, `td3-bc`, and all other learners where actions are continuous."""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np

from socialiq.cli.drivers import observed, with_one_ego
from socialiq.cli.output import Policies
from socialiq.cli.train import shared
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.acting import acting_in, actors_together
from socialiq.learners.collect import VectorCollector
from socialiq.learners.continuous import config, standardise
from socialiq.learners.continuous.train import LEARNERS, check_fit, train
from socialiq.nn.actor_policy import ActorDial
from socialiq.types import ROWS
from socialiq.worlds import grammar
from socialiq.worlds.environment import action_size, environment_maker, sizes
from socialiq.worlds.files import refuse_file
from socialiq.worlds.gym import learning_env

SIDE_BY_SIDE = 24
"""Episodes of the intersection side by side, of each run."""


@dataclass(frozen=True)
class SAC(shared.Training):
    """Train actors by soft actor-critic on R(α), in a world and without demonstrations.

    With --set dial=true one actor for all angles.

    Example: socialiq train sac --world intersection-continuous --angle 45 --out run
    """

    world: str = ""
    """intersection-continuous, intersection-continuous-steering (with -offroad: leaving the road
    ends an episode), or an environment (a Gymnasium id, MODULE:ID or MODULE:FUNCTION)."""
    _: KW_ONLY
    out: shared.Out
    preset: str = ""
    """Settings to begin with: intersection-continuous."""
    allow_code: bool = False
    """Import the environment's module: its author's code runs with your rights."""
    grid: shared.Grid = field(default_factory=shared.GridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    scaling: shared.Scaling = field(default_factory=shared.ScalingOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        return Task(self, None, self.world, self.allow_code, self.preset).run("sac")


@dataclass(frozen=True)
class TD3BC(shared.Training):
    """Train actors by TD3+BC on λ R(α), offline from demonstrations of continuous actions.

    Example: socialiq train td3-bc mixed.safetensors --angle 0 45 --out run
    """

    data: shared.Data
    _: KW_ONLY
    out: shared.Out
    labels: shared.Labels = field(default_factory=shared.LabelOptions)
    grid: shared.Grid = field(default_factory=shared.GridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    scaling: shared.Scaling = field(default_factory=shared.ScalingOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        data = self.labels.load(self.data, continuous=True)
        if not data.action_size:
            raise UserError(
                f"{shared.label_of(self.data)} has discrete actions: td3-bc is of continuous ones"
            )
        return Task(self, data).run("td3-bc")


@dataclass(frozen=True)
class Task:
    """Training with continuous actions, of any learner."""

    # has out, the groups of options, and `data`, the file of the demonstrations, if any
    command: Any
    data: Demonstrations | None  # demonstrations of continuous actions; None without
    world: str = ""  # name of the world, "" without
    allow_code: bool = False  # whether the environment's module may be imported
    preset: str = ""  # name of the settings to begin with, "" for the learner's own

    def run(self, name: str, further: Mapping[str, Any] | None = None) -> Policies:
        """Train one of `LEARNERS`, write the folder.

        Args:
            name: Name of the learner.
            further: Settings by name, laid over those of the command's options.

        Returns:
            The outcome.

        Raises:
            UserError: If options, data and world don't fit each other or the learner.
        """
        command = self.command
        data = self.data
        settings = command.size.settings() | dict(further or {})
        configs = LEARNERS[name].StaticConfig(), LEARNERS[name].Hyperparameters()
        if self.preset:
            presets = config.PRESETS.get(self.preset, {})
            names = "intersection,control=continuous" if presets else ", ".join(config.PRESETS)
            if not presets:
                raise UserError(
                    f"no preset '{self.preset}' of continuous actions: choose {names}, or leave "
                    "--preset out"
                )
            if name not in presets:
                learners = " and ".join(presets)
                raise UserError(
                    f"preset {self.preset} is of {learners}, not of {name}: leave it out"
                )
            if self.world and self._steered is None:
                raise UserError(f"preset {self.preset} is not for {self.world}: choose {names}")
            configs = presets[name]
        static, numbers = command.options.apply(configs, settings)
        runs = command.grid.runs(numbers)
        kind = "dial" if getattr(static, "dial", False) else "policy"
        labels = getattr(command, "labels", None)  # SAC has no demonstrations
        schema = ROWS if data is None else data.schema
        schema = self._steered.schema if self._steered is not None else schema
        folder = shared.RunFolder(command.out, kind, command.options, labels, schema)
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
        return folder.finish_policies(
            trained, record, change.policy if change else None, self._observe
        )

    @property
    def _steered(self) -> Any:
        """The world, if it is an intersection with continuous actions; else None."""
        written = grammar.parse(self.world)
        return with_one_ego(written) if written.control and written.is_built else None

    def _observe(self, dial: ActorDial) -> np.ndarray:
        """Return observations of the demonstrations, or of the dial's episodes in the world."""
        if self.data is not None:
            return self.data.observation
        if self._steered is not None:
            return observed(self._steered, dial)
        return observed(
            environment_maker(self.world, None, self.allow_code, continuous=True)(), dial
        )

    def _standardisation(self, static: Any, seed: int) -> standardise.Standardisation | None:
        """Return the change of observations that the command asks for."""
        scaling = self.command.scaling
        if not scaling.standardise:
            if scaling.leave_out:
                raise UserError("--leave-out is of standardised observations: add --standardise")
            return None
        if self._steered is not None or static.view != "flat":
            raise UserError("observations of vehicles are scaled already: leave --standardise out")
        if self.data is not None:
            return standardise.Standardisation.of(self.data.observation, scaling.leave_out)
        if not self.world:
            raise UserError("--standardise is by demonstrations or a world: name one with --world")
        make = environment_maker(self.world, None, self.allow_code, continuous=True)
        return standardise.Standardisation.of(standardise.explored(make(), seed), scaling.leave_out)

    def _acting(
        self, static: Any, runs: list[Any], change: standardise.Standardisation | None
    ) -> dict[str, Any]:
        """Return what `train` needs to let runs act in the world."""
        refuse_file(self.world)
        data = self.data
        chunk = static.updates_per_round
        if (world := self._steered) is not None:
            steps = chunk * getattr(static, "env_steps_per_update", 1)
            listed = world.n_features
            clock = static.times > 0 if data is None else data.n_features == listed + 1
            env = learning_env(world, len(runs) * SIDE_BY_SIDE, clock)
            shape = (listed + clock, world.action_size)
            together = actors_together(static, runs)
            collector = VectorCollector(env, -(-steps // SIDE_BY_SIDE), runs, together)
        else:
            interface = (data.n_features, data.action_size) if data is not None else None
            # Without demonstrations the angle has a meaning by the environment's pair alone.
            turned = getattr(static, "dial", False) or any(run.angle for run in runs)
            how = {"continuous": True, "needs_pair": data is None and turned}
            make = environment_maker(self.world, interface, self.allow_code, **how)
            make = make if change is None else change.maker(make)
            first = make()
            if how["needs_pair"]:
                shared.say_if_silent(first)
            shape = (sizes(first)[0], action_size(first))
            collector = acting_in(make, static, runs, chunk)
        return {"sizes": shape, "chunk": chunk, "before_chunk": collector}
