"""Common parts of `train LEARNER`: options, settings laid over a config, folder of a run."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro

from socialiq.cli.drivers import complain_if_it_stands
from socialiq.cli.output import Display, Policies, Printing, complain, say
from socialiq.cli.signing import fault_of_model, path_of_signature
from socialiq.cli.train.comparison import comparison
from socialiq.cli.words import check_options
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.labels import trusted
from socialiq.learners.callbacks import TRACKERS, Callbacks, Report
from socialiq.learners.collect import from_env
from socialiq.learners.kernel import Trained
from socialiq.learners.settings import check_seeds
from socialiq.nn.dial_policy import Dial
from socialiq.nn.saved import noted
from socialiq.outputs import all_or_none, new_folder
from socialiq.reading import sha256_of_file
from socialiq.results_folder import as_csv, versions
from socialiq.settings import assignments, laid_over
from socialiq.storage import sha256_of, write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import OBSERVATION, ROWS, Row

CHUNK = 500
"""Updates between two rows of metrics.csv."""
DECIDED = ("angle", "strength", "seed", "dataset", "online", "one_hot")
"""Fields of learners' configs that other options, the data or the world decide."""
GRID = ("angle", "strength", "seed")
"""Settings in which the runs of a training differ."""
_LOOK = 1000  # steps of random actions that should show an r_social
PLURALS = {"policy": "policies", "dial": "dials"}
"""Kinds of policies, and their key in run.json."""


class Training(Printing):
    """Base of commands that train."""

    def run(self) -> int:
        """Train, write the folder, print; return the exit status, 1 if a run failed."""
        outcome = self.result()
        self.show(outcome.numbers, outcome.rows)
        for failure in outcome.failures:
            complain(failure)
        if line := comparison(self, outcome):
            say(line)
        return 1 if outcome.failures else 0

    def result(self) -> Policies:
        """Train, write the folder."""
        raise NotImplementedError


@dataclass(frozen=True)
class PlainGridOptions:
    """A run for each combination."""

    angle: tuple[float, ...] = (0.0,)
    """Target angles in degrees."""
    seed: tuple[int, ...] = (0,)
    """Training seeds."""

    def runs(self, base: Any) -> list[Any]:
        """Return hyperparameters for each angle, strength and seed."""
        check_seeds(self.seed)
        for name in GRID:
            if not hasattr(base, name) and getattr(self, name, ()) not in ((), (0.0,), (0,)):
                raise UserError(f"this learner has no '{name}': leave --{name} out")
        names = [name for name in GRID if hasattr(base, name) and getattr(self, name, ())]
        return [
            replace(base, **dict(zip(names, values, strict=True)))
            for values in itertools.product(*(getattr(self, name) for name in names))
        ]


@dataclass(frozen=True)
class GridOptions(PlainGridOptions):
    """A run for each combination."""

    strength: tuple[float, ...] = ()
    """λ; by default the preset's."""


@dataclass(frozen=True)
class SizeOptions:
    """Size of the training and of the network."""

    updates: int | None = None
    """Gradient steps; by default the preset's."""
    hidden: tuple[int, ...] = ()
    """Widths of the hidden layers; by default the preset's."""

    def settings(self) -> dict[str, Any]:
        """Return the settings that were given."""
        updates = {} if self.updates is None else {"updates": self.updates}
        return updates | ({"hidden": self.hidden} if self.hidden else {})


@dataclass(frozen=True)
class SetOptions:
    """Settings of the learner."""

    set: tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]] = ()
    """KEY=VALUE ... of any setting that has no option, with commas between several values; an
    unknown key is answered with the list of those that the learner has."""

    def apply(self, configs: Sequence[Any], options: Mapping[str, Any]) -> list[Any]:
        """Return the learner's configs with the given options and --set laid over them.

        Args:
            configs: Frozen dataclasses of the learner; a setting is changed in the first that has
                it.
            options: Settings by name; --set comes after them.

        Returns:
            The changed configs, in the same order.

        Raises:
            UserError: If a setting is unknown or decided elsewhere, or a value doesn't fit it.
        """
        words = assignments([word for words in self.set for word in words])
        for name in words.keys() & {*DECIDED}:
            raise UserError(f"{name} is no setting: other options, the data or the world decide it")
        changed = laid_over(configs, {**options, **words}, DECIDED)
        for config in changed:
            check_options(config)
        return changed


@dataclass(frozen=True)
class RunOptions(SetOptions):
    """Settings of the learner, and records of the run."""

    resume: bool = False
    """Go on with a run that was stopped."""
    tensorboard: Path | None = None
    """Folder for TensorBoard's event files too, one for each policy; metrics.csv is always
    written."""
    wandb: Path | None = None
    """Folder for runs of Weights & Biases too, offline: `wandb sync` sends them."""
    mlflow: Path | None = None
    """Folder for MLflow's data base too."""


@dataclass(frozen=True)
class ScalingOptions:
    """Features of continuous actions' observations."""

    standardise: bool = False
    """Of continuous actions: let the networks see each feature with mean 0 and deviation 1 over
    the demonstrations, without any over 1,000 steps at random in the world, which the replay
    doesn't hold; the policies take observations as they are."""
    leave_out: tuple[int, ...] = ()
    """With --standardise: features, counted from 0, that the networks do not see."""

    def refuse(self) -> None:
        """Refuse them with discrete actions."""
        if self.standardise or self.leave_out:
            raise UserError(
                "--standardise and --leave-out are of continuous actions, and these are discrete"
            )


@dataclass(frozen=True)
class LabelOptions:
    """Trust in the demonstrations."""

    believe_labels: bool = False
    """Take rewards as the file has them. By default they are computed again where the file names a
    world of ours, and episodes that differ are dropped; a file of which most differ is refused."""
    collector: Path | None = None
    """Public key of who collected the demonstrations, a PEM file: refuse them without its signature
    beside them, FILE.sig, of `collect --key`."""

    @cached_property
    def notices(self) -> list[str]:
        """Lines on what was dropped, or not checked; no option, so no field."""
        return []

    def load_any(self, path: Path | Demonstrations | None) -> list[Demonstrations]:
        """Read demonstrations where a file is named; a key of their collector needs one."""
        if self.collector and not path:
            raise UserError("--collector is of demonstrations: name their file, or leave it out")
        return [self.load(path)] if path else []

    def load(self, path: Path | Demonstrations, continuous: bool = False) -> Demonstrations:
        """Read demonstrations, and check their signature and labels.

        `say` tells what was dropped, or not checked, when the training begins. So a call that is
        refused says its own reason alone.

        Args:
            path: File of the demonstrations, or these themselves.
            continuous: Whether actions may be continuous.

        Raises:
            UserError: If the file can't be read, the collector's key did not sign it, or most of
                its labels are wrong.
        """
        key = self.collector
        if not isinstance(path, Path):
            data = path
            if key:
                raise UserError("--collector signs a file: name that of the demonstrations")
            if data.action_size and not continuous:
                raise UserError("continuous actions: this takes demonstrations of discrete ones")
        elif key and (fault := fault_of_model(path, path_of_signature(path), key)):
            raise UserError(f"{fault}: ask the collector for the file")
        else:
            data = files.load(path, continuous)
        if self.believe_labels:
            return data
        kept, line = trusted(data, label_of(path))
        if line and (isinstance(path, Path) or kept is not data):
            self.notices.append(line)
        return kept

    def say(self) -> None:
        """Say on standard error what of the demonstrations was dropped, or not checked."""
        for line in self.notices:
            complain(line)


def say_if_silent(env: gymnasium.Env[Any, Any]) -> None:
    """Say that r_social was 0 in every step of random actions, if it was.

    This is no refusal: a sound effect on others may be rare, as a collision is. Another constant
    than 0 is not told: a cost of each step teaches a policy to end the episode.

    Args:
        env: Environment with a reward pair, which an angle steers.
    """
    space = env.action_space
    space.seed(0)
    rng = np.random.default_rng(0)
    # In parts, because most environments show an r_social in the first.
    source = from_env(env, _LOOK // 4, isinstance(space, gymnasium.spaces.Box))
    parts = (source(lambda _: np.array([space.sample()]), rng) for _ in range(4))
    if not any(np.any(part.target.social) for part in parts):
        complain(
            f"r_social was 0 in {_LOOK:,} steps of random actions: if it is always 0, the angle "
            "teaches nothing; see to the environment's pair"
        )


def of_schema(policy: Any, schema: str) -> Any:
    """Return a policy whose provenance names the schema of its observations, if not rows.

    Args:
        policy: A policy or dial.
        schema: Name and version, as `World.schema`.
    """
    return noted(policy, {} if schema == ROWS else {OBSERVATION: schema})


@dataclass(frozen=True)
class RunFolder:
    """Output folder of `train`, for policies of a kind: "policy" or "dial".

    A function may train without a folder; the policies are then in the outcome alone.
    """

    out: Path | None
    kind: str
    options: RunOptions
    labels: LabelOptions | None = None  # of the demonstrations, if there are some
    schema: str = ROWS  # of the observations of the policies

    @cached_property
    def trained(self) -> list[Any]:
        """Policies that `save_policies` got; no option, so no field."""
        return []

    @contextmanager
    def callbacks(self, runs: Sequence[Row], monitor: Any = None) -> Iterator[Callbacks]:
        """Make the folder; yield the callbacks of the training, with its progress shown.

        If the training fails and has written no file, a folder that it made is removed.

        Args:
            runs: By run, the settings in which it differs from the remaining runs.
            monitor: Measures the policies after each chunk.
        """
        listeners: list[Callable[[Report], None]] = []
        if self.labels is not None:
            self.labels.say()

        def remove_if_empty(failed: type[BaseException] | None, *_: Any) -> None:
            if failed is not None and self.out:
                with suppress(OSError):
                    self.out.rmdir()

        def report_to_all(report: Report) -> None:
            for listener in listeners:
                listener(report)

        with ExitStack() as stack:
            for option, tracker in TRACKERS.items():
                if (folder := getattr(self.options, option)) is None:
                    continue
                names = [
                    "_".join(f"{name}_{value:g}" for name, value in row.items()) for row in runs
                ]
                listeners.append(stack.enter_context(tracker(folder, names)))
            if self.out is None:
                if self.options.resume:
                    raise UserError("--resume goes on with the run of a folder: add --out")
            elif not self.options.resume:
                if not self.out.exists():
                    stack.push(remove_if_empty)
                new_folder(self.out)
            elif (self.out / "run.json").exists():
                raise UserError(f"{self.out} holds a finished run: there is nothing to resume")
            listeners.insert(0, stack.enter_context(Display()).stage("training"))
            yield Callbacks(
                on_report=report_to_all,
                monitor=monitor,
                checkpoint=self.out and self.out / "checkpoint.safetensors",
                resume=self.options.resume,
            )

    def save_policies(
        self,
        trained: Trained,
        change: Callable[[Any], Any] | None = None,
        observe: Callable[[Any], np.ndarray] | None = None,
    ) -> list[Row]:
        """Write the policy of each run, if there is a folder.

        Args:
            trained: Outcome of the training.
            change: Changes a policy before it is written; None leaves it as it is.
            observe: Returns observations for a dial. If the dial takes the same actions of them at
                every angle, a line on standard error says so. None checks no dial.

        Returns:
            File name and SHA-256 of each policy, in the order of the runs.
        """
        labels = [label(numbers) for numbers in trained.hyperparameters]
        words = list(map(str, range(len(labels))))
        if self.kind == "policy" and not trained.learner.no_angle():
            words = names_of(labels)
        saved = []
        for run, word in enumerate(words):
            file = f"{self.kind}_{word}.safetensors"
            policy = trained.policy(run)
            policy = change(policy) if change else policy
            policy = of_schema(policy, self.schema)
            self.trained.append(policy)
            saved.append(saved_in(self.out, file, policy))
            if observe is not None and isinstance(policy, Dial):
                name = str(self.out / file) if self.out else policy
                complain_if_it_stands(name, policy, observe(policy))
        return saved

    def finish_policies(
        self,
        trained: Trained,
        record: Mapping[str, Any],
        change: Callable[[Any], Any] | None = None,
        observe: Callable[[Any], np.ndarray] | None = None,
    ) -> Policies:
        """Write the policies of a grid, with metrics.csv and run.json.

        Args:
            trained: Outcome of the training.
            record: Further fields of run.json.
            change: As for `save_policies`.
            observe: As for `save_policies`.

        Returns:
            The outcome.
        """
        arrays = {name: trained.history.array(name) for name in trained.history.values}
        columns = {"greedy_angle": "angle_hat", "greedy_arrival": "arrival", "loss": "loss"}
        labels = [label(numbers) for numbers in trained.hyperparameters]
        if reason := trained.learner.no_angle():
            labels = [row | {"angle": None} if "angle" in row else row for row in labels]
            complain(f"no angle is in the policies: {reason}")
        last = [
            {columns[name]: float(arrays[name][-1, run]) for name in arrays if name in columns}
            for run in range(len(labels))
        ]
        renamed = [
            {"angle_target" if name == "angle" else name: value for name, value in row.items()}
            for row in labels
        ]
        with all_or_none(self.out) if self.out else nullcontext():
            saved = self.save_policies(trained, change, observe)
            policies = [
                row | file | end for row, file, end in zip(labels, saved, last, strict=True)
            ]
            return self.finish(trained, renamed, policies, record)

    def finish(
        self,
        trained: Trained,
        runs: Sequence[Row],
        policies: Sequence[Row],
        record: Mapping[str, Any],
    ) -> Policies:
        """Write metrics.csv and run.json, remove the checkpoint; return the outcome.

        Args:
            trained: The training's outcome.
            runs: By run, the settings in which it differs, as columns of metrics.csv.
            policies: By run, its entry in run.json.
            record: Further entries of run.json.
        """
        hidden = "sha256" if self.kind == "policy" else ""
        shown = [{k: v for k, v in row.items() if k != hidden} for row in policies]
        numbers = {"out": str(self.out or ""), PLURALS[self.kind]: policies}
        trainings = {"trained": tuple(self.trained), "failures": trained.failures}
        outcome = Policies(numbers, shown, table=policies, **trainings)
        if self.out is None:
            return outcome
        history = trained.history
        arrays = {name: history.array(name) for name in history.values}
        rows = [
            {"updates": updates}
            | row
            | {name: rounded(float(array[chunk, run])) for name, array in arrays.items()}
            for chunk, updates in enumerate(history.updates)
            for run, row in enumerate(runs)
        ]
        write_atomically(self.out / "metrics.csv", as_csv(rows))
        settings = {
            "structure": asdict(trained.static),
            "numbers": [trained.learner.numbers(run) for run in trained.hyperparameters],
        }
        end = {"versions": versions(), "failures": trained.failures, PLURALS[self.kind]: policies}
        write_json(self.out / "run.json", rounded({**settings, **record, **end}))
        (self.out / "checkpoint.safetensors").unlink(missing_ok=True)
        return outcome


def saved_in(folder: Path | None, file: str, policy: Any) -> Row:
    """Write a policy into a folder, if there is one; return its file's name and SHA-256.

    Args:
        folder: The folder; None without.
        file: Name of the file.
        policy: The policy, a `Saved`.
    """
    if folder:
        return {"file": file, "sha256": policy.save(folder / file)}
    return {"sha256": sha256_of(policy.KIND, policy.version, *policy.content())}


def label(hyperparameters: Any) -> Row:
    """Return the settings in which a run differs from the remaining runs of its grid."""
    return {name: getattr(hyperparameters, name) for name in GRID if hasattr(hyperparameters, name)}


def names_of(labels: Sequence[Row]) -> list[str]:
    """Return the name of each run: its angle, and what else tells the runs apart."""
    telling = [
        name for name in labels[0] if name == "angle" or len({row[name] for row in labels}) > 1
    ]
    return [
        "_".join(f"{name}{str(row[name]).removesuffix('.0')}" for name in telling) or "0"
        for row in labels
    ]


def label_of(data: Path | Demonstrations) -> str:
    """Return the name of demonstrations in messages."""
    return str(data) if isinstance(data, Path) else "the demonstrations"


def described_file(path: Path | Demonstrations) -> Row:
    """Return the name and the SHA-256 of a file, for run.json; of a table that of its content."""
    if not isinstance(path, Path):
        return {"sha256": files.sha256_of(path)}
    return {"file": str(path), "sha256": sha256_of_file(path)}


DATA = "Demonstrations file, of `socialiq collect`."
Data = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(help=DATA)]
OUT = "Folder to make: policies, metrics.csv, run.json."
Out = Annotated[Path, tyro.conf.arg(help=OUT)]
Grid = tyro.conf.OmitArgPrefixes[GridOptions]
PlainGrid = tyro.conf.OmitArgPrefixes[PlainGridOptions]
Size = tyro.conf.OmitArgPrefixes[SizeOptions]
Labels = tyro.conf.OmitArgPrefixes[LabelOptions]
Scaling = tyro.conf.OmitArgPrefixes[ScalingOptions]
_FURTHER = tyro.conf.arg(name="further")  # the title of the group in the help page
Run = Annotated[tyro.conf.OmitArgPrefixes[RunOptions], _FURTHER]
Set = Annotated[tyro.conf.OmitArgPrefixes[SetOptions], _FURTHER]
