"""`train`: demonstrations in, policies out; a grid of runs in one compiled program."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli import train_continuous
from socialiq.cli.options import optional, overridden, refuse_given
from socialiq.cli.run_folder import CHUNK, RunFolder, described_file
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation.exact import exact_monitor
from socialiq.learners.collect import acting_in
from socialiq.learners.config import check_seeds
from socialiq.learners.continuous.config import CriticLoss, Shared, TowardsData, Tuning
from socialiq.learners.extensions import (
    checked_divergence,
    checked_prior,
    find_learner,
    load,
)
from socialiq.learners.iq_learn.config import Hyperparameters, StaticConfig
from socialiq.learners.iq_learn.presets import PRESETS
from socialiq.learners.iq_learn.train import check_fit, train
from socialiq.learners.kernel import Trained
from socialiq.learners.state import Runs
from socialiq.types import Row
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.environment import environment_maker
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.registry import GRIDWORLDS, make_grid, refuse_file

# Every field of the configs is an option, but for those that a grid or the world decides.
StaticOptions = tyro.conf.OmitArgPrefixes[optional(StaticConfig, "online")]
NumberOptions = tyro.conf.OmitArgPrefixes[
    optional(Hyperparameters, "angle", "strength", "seed", "dataset")
]


SharedOptions = tyro.conf.OmitArgPrefixes[
    optional(Shared, "hidden", "batch_size", "updates", "endings")
]
CriticOptions = tyro.conf.OmitArgPrefixes[optional(CriticLoss)]
TuningOptions = tyro.conf.OmitArgPrefixes[optional(Tuning)]
# Both have the actor's rate; an option may be there once.
DataOptions = tyro.conf.OmitArgPrefixes[optional(TowardsData, "actor_rate")]


@dataclass(frozen=True)
class Train:
    """Train a policy for every angle, strength and seed given, from one file of demonstrations.

    Demonstrations of continuous actions train an actor, by IQ-Learn or another --learner: td3-bc,
    behaviour-cloning, or in a world and without demonstrations sac; with --dial one for all angles.

    Example: socialiq train mixed.safetensors --world crossing7 --angle 45 --out run
    """

    data: Annotated[Path | None, tyro.conf.Positional] = None
    """Demonstrations file, of `socialiq collect`; none for --learner sac."""
    _: KW_ONLY
    out: Path
    """Folder to make: policies, metrics.csv, run.json."""
    world: str = ""
    """World of the learner: crossing5, crossing7, or an environment (a Gymnasium id, MODULE:ID
    or MODULE:FUNCTION); none trains offline."""
    allow_code: bool = False
    """Import the environment's module, or files of --prior, --divergence, --loss, --learner: their
    author's code runs with your rights."""
    angle: tuple[float, ...] = (0.0,)
    """Target angles in degrees."""
    strength: tuple[float, ...] = ()
    """λ; by default the preset's."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""
    preset: str = "grid"
    """Settings to begin with: table-c1, poc, grid, lambda-sweep; for tens to hundreds of
    demonstrated rows without social rewards few-offline, and with a world few-online. At the
    intersection with continuous actions intersection-continuous, of IQ-Learn and of sac. Every
    option below overrides."""
    resume: bool = False
    """Go on with a run that was stopped."""
    tensorboard: Path | None = None
    """Folder for TensorBoard's event files too, one for each policy; metrics.csv is always
    written."""
    json: bool = False
    """Print one JSON object."""

    standardise: bool = False
    """Of continuous actions: let the networks see each feature with mean 0 and deviation 1 over
    the demonstrations, without any over 1,000 steps at random in the world, which the replay
    doesn't hold; the policies take observations as they are."""
    leave_out: tuple[int, ...] = ()
    """With --standardise: features, counted from 0, that the networks do not see."""
    loss: str = ""
    """FILE.py:NAME, a loss of your own in the place of the objective; --prior and --divergence
    take one in the same way."""
    learner: str = ""
    """behaviour-cloning, cql, or FILE.py:NAME, a learner of your own, in the place of IQ-Learn; it
    trains offline, with the options that it has. Of continuous actions sac, td3-bc or
    behaviour-cloning."""
    static: StaticOptions = field(default_factory=StaticOptions)  # pyright: ignore[reportInvalidTypeForm]
    """Choices that shape the program."""
    hyperparameters: NumberOptions = field(  # pyright: ignore[reportInvalidTypeForm]
        default_factory=NumberOptions
    )
    """Numbers of the runs."""
    continuous: SharedOptions = field(  # pyright: ignore[reportInvalidTypeForm]
        default_factory=SharedOptions
    )
    """Choices of learners of continuous actions."""
    critics: CriticOptions = field(  # pyright: ignore[reportInvalidTypeForm]
        default_factory=CriticOptions
    )
    """Loss of IQ-Learn's critics."""
    tuning: TuningOptions = field(  # pyright: ignore[reportInvalidTypeForm]
        default_factory=TuningOptions
    )
    """Rate of the actor, and numbers of a tuned temperature."""
    towards_data: DataOptions = field(  # pyright: ignore[reportInvalidTypeForm]
        default_factory=DataOptions
    )
    """Numbers of TD3+BC."""

    def run(self) -> int:
        """Train, write the folder, print what came out."""
        data = self.demonstrations()
        if data is None or data.action_size:
            return train_continuous.run(self, data)
        assert self.data is not None
        for options in (self.continuous, self.critics, self.tuning, self.towards_data):
            refuse_given(options, "continuous actions, and these are discrete")
        if self.standardise or self.leave_out:
            raise UserError(
                "--standardise and --leave-out are of continuous actions, and these are discrete"
            )
        own = self.own_code()
        static, hyperparameters = self.settings(own)
        simulator, before_chunk = self.experience(static, hyperparameters, data)
        if "learner" not in own:
            check_fit(static, hyperparameters, [data], simulator, before_chunk is not None)
        folder = RunFolder(self.out, "policy", self.resume, self.tensorboard)
        labels = [self.label(one) for one in hyperparameters]
        with folder.callbacks(labels, _monitor(simulator, hyperparameters)) as callbacks:
            trained = train(
                static, hyperparameters, [data], simulator, callbacks, CHUNK, before_chunk, **own
            )
        policies = self.policies(folder, trained)
        columns = {"angle": "angle_target"}
        labels = [{columns.get(name, name): v for name, v in one.items()} for one in labels]
        described = described_file(self.data) | {"transitions": data.n_transitions}
        record = {"world": self.world, "data": described} | trained.learner.functions()
        folder.finish(trained, labels, policies, record)
        return folder.report(trained, policies, self.json)

    def demonstrations(self) -> Demonstrations | None:
        """Return the demonstrations; None for soft actor-critic.

        Raises:
            UserError: If they are missing or not needed, or the file is not sound.
        """
        if (self.data is None) != (self.learner == "sac"):
            raise UserError(
                "name a file of demonstrations: only --learner sac learns without"
                if self.data is None
                else "sac learns from no demonstrations: leave the file out"
            )
        return None if self.data is None else files.load(self.data, continuous=True)

    def own_code(self) -> dict[str, Any]:
        """Import and try the user's own prior, divergence and loss, and find the learner, if named.

        Raises:
            UserError: If the code may not run, is not found, or fails.
        """
        places = {"loss": self.loss}
        for part in ("prior", "divergence"):
            named = getattr(self.static, part) or ""
            places[part] = named if ":" in named or named.endswith(".py") else ""
        named = {part: place for part, place in places.items() if place}
        found: dict[str, Any] = {
            part: load(place, f"--{part}", self.allow_code) for part, place in named.items()
        }
        for part, check in (("prior", checked_prior), ("divergence", checked_divergence)):
            if part in found:
                found[part] = check(found[part])
        if self.learner:
            found["learner"] = find_learner(self.learner, "--learner", self.allow_code)
        if "learner" in found and (len(found) > 1 or self.world):
            raise UserError("--learner takes no --world, --prior, --divergence or --loss")
        return found

    def settings(self, own: dict[str, Any]) -> tuple[Any, list[Any]]:
        """Return the preset with the options laid over it, and the grid of runs."""
        one_of("preset", self.preset, tuple(PRESETS))
        check_seeds(self.seed)
        ours = {part: None for part in ("prior", "divergence") if part in own}
        given = dataclasses.replace(self.static, **ours)
        if "learner" in own:
            static = overridden(own["learner"].StaticConfig(), given)
            base = own["learner"].Hyperparameters()
        else:
            static, base = PRESETS[self.preset]
            static = overridden(static, given, online=bool(self.world))
        return static, self.grid(overridden(base, self.hyperparameters))

    def grid(self, base: Any) -> list[Any]:
        """Return a run for each angle, strength and seed.

        Raises:
            UserError: If the learner doesn't have one that was given.
        """
        check_seeds(self.seed)
        names = {one.name for one in dataclasses.fields(base)}
        grids = {"angle": self.angle, "strength": self.strength, "seed": self.seed}
        for name in grids.keys() - names:
            if grids[name] not in ((), (0.0,), (0,)):
                raise UserError(f"this learner has no '{name}': leave --{name} out")
        kept = {name: values for name, values in grids.items() if values and name in names}
        return [
            dataclasses.replace(base, **dict(zip(kept, values, strict=True)))
            for values in itertools.product(*kept.values())
        ]

    def experience(
        self, static: Any, hyperparameters: list[Any], data: Demonstrations
    ) -> tuple[GridWorld | None, Callable[[Runs, int], Runs] | None]:
        """A gridworld to step in the compiled program, or a collector for a Gymnasium id."""
        if not self.world:
            return None, None
        refuse_file(self.world)
        if self.world in GRIDWORLDS:
            return make_grid(self.world), None

        given = (data.n_features, data.n_actions)
        make = environment_maker(self.world, given, self.allow_code)
        return None, acting_in(make, static, hyperparameters, CHUNK)

    @staticmethod
    def label(hyperparameters: Any) -> Row:
        """Return what a run differs in from the others of its grid."""
        names = [name for name in ("angle", "strength", "seed") if hasattr(hyperparameters, name)]
        return {name: getattr(hyperparameters, name) for name in names}

    @staticmethod
    def policies(
        folder: RunFolder, trained: Trained, change: Callable[[Any], Any] | None = None
    ) -> list[Row]:
        """Write the policies; return what each differs in, its file and its last measurements."""
        arrays = {name: trained.history.array(name) for name in trained.history.values}
        columns = {"greedy_angle": "angle_hat", "greedy_arrival": "arrival", "loss": "loss"}
        return [
            Train.label(hyperparameters)
            | saved
            | {columns[name]: float(arrays[name][-1, run]) for name in arrays if name in columns}
            for run, (hyperparameters, saved) in enumerate(
                zip(trained.hyperparameters, folder.save_policies(trained, change), strict=True)
            )
        ]


def _monitor(simulator: GridWorld | None, hyperparameters: list[Any]) -> Any:
    if simulator is None:
        return None
    part = tabulate(simulator).reachable_part()
    return exact_monitor(part, [one.temperature for one in hyperparameters])
