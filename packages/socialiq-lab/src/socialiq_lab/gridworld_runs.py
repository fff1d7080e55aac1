"""Train many runs in an enumerable world and evaluate every one of them exactly."""

import functools
import itertools
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq import Demonstrations, QPolicy, train
from socialiq.errors import one_of
from socialiq.evaluation import exact
from socialiq.evaluation.exact import Ground, Metrics
from socialiq.evaluation.rollout import trajectory_datasets, transition_datasets
from socialiq.learners import behaviour_cloning
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import DialPreset
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.kernel import Trained
from socialiq.settings import changed
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq_lab.jobs import Inputs, ProgressCallback, callbacks_of

TRAINED = "trained"
"""File of the state of a declared training, in the folder of its job."""

Monitor = Callable[[Any], dict[str, np.ndarray]]
"""From the `TrainState` of all runs to named values, each (runs,)."""


def grid_of(
    angles: Sequence[float],
    strengths: Sequence[float],
    seeds: Sequence[int],
    base: presets.IQLearnHyperparameters,
) -> list[presets.IQLearnHyperparameters]:
    """Return hyperparameters for every angle, strength and seed.

    Args:
        angles: Angles in degrees.
        strengths: Strengths of the prior.
        seeds: Training seeds; seed i learns from data set i.
        base: All other hyperparameters.

    Returns:
        The hyperparameters of each run, the seed varying fastest and the angle slowest.
    """
    return [
        replace(base, angle=angle, strength=strength, seed=seed, dataset=dataset)
        for angle in angles
        for strength in strengths
        for dataset, seed in enumerate(seeds)
    ]


def train_runs(
    ground: Ground,
    static: presets.IQLearnConfig,
    hyperparameters: Sequence[presets.IQLearnHyperparameters],
    datasets: Sequence[Demonstrations],
    callbacks: Callbacks | None = None,
    chunk: int | None = None,
    monitor: Monitor | None = None,
    prior: Callable[..., Any] | None = None,
) -> Trained:
    """Train in the ground's world and record the monitor's values after every chunk.

    Args:
        ground: The world, enumerated.
        static: Static configuration of all runs.
        hyperparameters: Hyperparameters of each run.
        datasets: Demonstrations that the runs' `dataset` numbers.
        callbacks: Progress and checkpoint.
        chunk: Updates of a chunk; None for 500.
        monitor: Measures the runs after each chunk. None for the exact metrics if there is a chunk,
            else for no measures.
        prior: A user's penalty in place of the quadratic one; None for the configured prior.
    """
    if monitor is None and chunk is not None:
        monitor = exact.exact_monitor(ground.part, [run.temperature for run in hyperparameters])
    callbacks = replace(callbacks or Callbacks(), monitor=monitor)
    simulator = ground.table.world if static.online else None
    return train(static, hyperparameters, datasets, simulator, callbacks, chunk or 500, prior=prior)


def train_dials(
    preset: DialPreset,
    world: Any,
    seeds: Sequence[int],
    data: Sequence[Demonstrations],
    updates: int,
    callbacks: Callbacks | None = None,
) -> Trained:
    """Train a dial of each seed in a gridworld.

    Args:
        preset: Settings of the dials.
        world: The gridworld, with a clock if the preset has one.
        seeds: Training seeds; seed i learns from data set i.
        data: Demonstrations of each seed; not used by a preset without any.
        updates: Gradient steps; 0 for those of the preset.
        callbacks: Progress and checkpoint.
    """
    static = preset.structure
    static = replace(static, one_hot=world.one_hot, updates=updates or static.updates)
    runs = [replace(preset.numbers, seed=seed, dataset=number) for number, seed in enumerate(seeds)]
    sets = data if static.demonstrations else ()
    simulator = world if static.online else None
    return train_dial(static, runs, sets, simulator, callbacks=callbacks)


def file_of(policy: Any) -> bytes:
    """Return the content of the file of a policy or a dial."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.safetensors"
        policy.save(path)
        return path.read_bytes()


class Learned(NamedTuple):
    """A trained policy of a declared study."""

    label: Row  # of its rows
    static: Any  # configuration of its learner
    run: Any  # its hyperparameters
    data: Demonstrations  # that it learned from
    policy: QPolicy


@dataclass(frozen=True)
class Training:
    """A `[[train]]` of a study, as the configuration of its job."""

    world: str
    seeds: tuple[int, ...]  # each has a separate data set
    declared: Mapping[str, Any]  # as `declared_settings.variants` multiplies it out
    prior: Mapping[str, str]  # name and SHA-256 of the user's penalty, if there is one

    def runs(self) -> list[Any]:
        """Return the hyperparameters of each run, the seed varying fastest."""
        numbers = learner_of(self.declared)[1]
        return [
            replace(changed(numbers, values), seed=seed, dataset=index)
            for values in self.declared["runs"]
            for index, seed in enumerate(self.seeds)
        ]

    def labels(self) -> list[Row]:
        """Return the label of each run.

        Raises:
            UserError: If a label names an unknown number of the runs.
        """
        rows: list[Row] = []
        for run in self.runs():
            row: Row = {}
            for name, value in self.declared["label"].items():
                if str(value).startswith("@"):
                    one_of("number of the runs", value[1:], tuple(vars(run)))
                    value = getattr(run, value[1:])
                row[name] = value
            rows.append(row)
        return rows

    def invented(self) -> list[Row]:
        """Return rows of the columns and labels that the training will have, of random numbers."""
        updates = learner_of(self.declared)[0].updates
        rng = np.random.default_rng(0)
        rows: list[Row] = []
        for target, readout in itertools.product(
            self.declared.get("targets", [None]), exact.READOUTS
        ):
            for label, run in zip(self.labels(), self.runs(), strict=True):
                measured = {name: rng.random() for name in Metrics._fields}
                row = label | {"readout": readout, "seed": run.seed}
                if "checkpoint" in self.declared:
                    rows.append(row | {"updates": updates} | measured)
                else:
                    angle = run.angle if target is None else target
                    rows.append(row | {"target_angle": angle, "regret": rng.random()} | measured)
        return rows


def train_declared(
    config: Training,
    folder: Path,
    _inputs: Inputs,
    on_progress: ProgressCallback,
    prior: Callable[..., Any] | None = None,
) -> None:
    """Train the runs of a `[[train]]` in one program, and keep their state in a folder.

    Args:
        config: The training.
        folder: Folder of the job.
        _inputs: No folders.
        on_progress: Called with the finished share of the training.
        prior: A user's penalty in place of the quadratic one.
    """
    _trained(config, callbacks_of(on_progress, folder / TRAINED, keep=True), prior)


world_of = functools.lru_cache(4)(Ground.of)


@functools.lru_cache(4)
def _data_sets(world: str, seeds: tuple[int, ...], kind: str, number: int) -> list[Demonstrations]:
    experts = {"trajectories": trajectory_datasets, "transitions": transition_datasets}
    return experts[kind](world_of(world).table, seeds, number)


def _trained(
    config: Training, callbacks: Callbacks, prior: Callable[..., Any] | None
) -> tuple[Trained, list[Demonstrations]]:
    """Train, or read what was trained; return it, and the data sets."""
    ((kind, number),) = config.declared["data"].items()
    data = _data_sets(config.world, config.seeds, kind, number)
    static = learner_of(config.declared)[0]
    runs = config.runs()
    if isinstance(static, behaviour_cloning.CloningConfig):
        train_on = behaviour_cloning.BehaviourCloning.train_on
        return train_on(static, runs, data, callbacks), data
    chunk = config.declared.get("checkpoint")
    inputs = world_of(config.world), static, runs, data, callbacks, chunk
    return train_runs(*inputs, prior=prior), data


def declared_rows(
    config: Training, folder: Path, prior: Callable[..., Any] | None
) -> tuple[list[Row], list[Learned], list[Demonstrations]]:
    """Evaluate what `train_declared` left in a folder.

    Args:
        config: The training.
        folder: Folder of its job.
        prior: The user's penalty that the training had.

    Returns:
        The rows, the policies and the data sets. With `checkpoint` the rows are those of
        `checkpoint_rows`, and there are no policies.
    """
    callbacks = Callbacks(checkpoint=folder / TRAINED, resume=True)
    trained, data = _trained(config, callbacks, prior)
    ground = world_of(config.world)
    runs = config.runs()
    labels = config.labels()
    if "checkpoint" in config.declared:
        return checkpoint_rows(trained, runs, labels), [], data
    policies = [trained.policy(number) for number in range(len(runs))]
    rows: list[Row] = []
    for target in config.declared.get("targets", [None]):
        for label, run, policy in zip(labels, runs, policies, strict=True):
            angle = run.angle if target is None else target
            rows += rows_of(ground, policy, angle, label | {"target_angle": angle}, run.seed)
    learned = [
        Learned(label | {"target_angle": run.angle}, trained.static, run, data[run.dataset], policy)
        for label, run, policy in zip(labels, runs, policies, strict=True)
    ]
    return rows, learned, data


def learner_of(training: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return static configuration and hyperparameters of a declared training.

    Those of its `learner` and `preset`, without the prior if it is not `regularized`, with the
    fields of `static` changed.
    """
    if training.get("learner") == "behaviour_cloning":
        static = behaviour_cloning.CloningConfig()
        numbers = behaviour_cloning.CloningHyperparameters()
    else:
        static, numbers = presets.PRESETS[training["preset"]]
        static = static if training.get("regularized", True) else presets.baseline(static)
    return changed(static, training.get("static", {})), numbers


def checkpoint_rows(trained: Trained, runs: Sequence[Any], labels: Sequence[Row]) -> list[Row]:
    """Return a row for each run, action selection and checkpoint, with the exact metrics.

    Args:
        trained: Runs whose history has the exact metrics.
        runs: Hyperparameters of each run.
        labels: Further columns of each run.
    """
    arrays = {
        (readout, name): trained.history.array(f"{readout}_{name}")
        for readout in exact.READOUTS
        for name in Metrics._fields
    }
    return [
        label
        | {"readout": readout, "seed": run.seed, "updates": updates}
        | {name: float(arrays[readout, name][checkpoint, number]) for name in Metrics._fields}
        for number, (run, label) in enumerate(zip(runs, labels, strict=True))
        for readout in exact.READOUTS
        for checkpoint, updates in enumerate(trained.history.updates)
    ]


def evaluate(ground: Ground, policy: QPolicy, readout: exact.Readout) -> Metrics:
    """Return the exact metrics of a trained policy.

    Args:
        ground: The world, enumerated.
        policy: The policy.
        readout: Action selection, one of `exact.READOUTS`.
    """
    return exact.evaluate_exactly(ground.part, exact.action_table(policy, ground.part, readout))


def rows_of(ground: Ground, policy: QPolicy, angle: float, label: Row, seed: int) -> list[Row]:
    """Return label, seed, metrics and regret of a policy, a row for each action selection.

    Args:
        ground: The world, enumerated.
        policy: The policy.
        angle: Angle of the regret, in degrees.
        label: Columns of every row.
        seed: Training seed.
    """
    rows = []
    for readout in exact.READOUTS:
        metrics = evaluate(ground, policy, readout)
        regret = {"regret": ground.optimum.regret(metrics, angle)}
        rows.append(label | {"readout": readout, "seed": seed} | metrics._asdict() | regret)
    return rows


def sequence(table: Table, policy: Float[np.ndarray, "state action"]) -> str:
    """Return the actions of a greedy episode in a deterministic world.

    Args:
        table: The world.
        policy: Action probabilities or scores, of which the largest is taken.

    Returns:
        The first letter of each action: in the 5x5 world W for Wait, G for Go.
    """
    mdp = table.mdp
    letters = ""
    state = int(mdp.initial.argmax())
    for _ in range(table.world.horizon):
        action = int(policy[state].argmax())
        letters += table.world.actions[action][0]
        if mdp.ending[state, action, 0]:
            break
        state = int(mdp.successor[state, action, 0])
    return letters
