"""Train many runs in an enumerable world and evaluate every one of them exactly."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq import Demonstrations, QPolicy, train
from socialiq.evaluation import exact
from socialiq.evaluation.exact import Ground, Metrics
from socialiq.evaluation.rollout import trajectory_datasets, transition_datasets
from socialiq.learners import behaviour_cloning
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.dial.config import DialPreset
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.kernel import Trained
from socialiq.settings import changed
from socialiq.types import Row
from socialiq.worlds.enumerate import Table

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
    on_report: Callable[[Report], None] | None,
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
        on_report: Progress callback.
        chunk: Updates of a chunk; None for 500.
        monitor: Measures the runs after each chunk. None for the exact metrics if there is a
            progress callback or a chunk, else for no measures.
        prior: A user's penalty in place of the quadratic one; None for the configured prior.
    """
    if monitor is None and (on_report is not None or chunk is not None):
        monitor = exact.exact_monitor(ground.part, [run.temperature for run in hyperparameters])
    callbacks = Callbacks(on_report=on_report, monitor=monitor)
    simulator = ground.table.world if static.online else None
    return train(static, hyperparameters, datasets, simulator, callbacks, chunk or 500, prior=prior)


def train_dials(
    preset: DialPreset,
    world: Any,
    seeds: Sequence[int],
    data: Sequence[Demonstrations],
    updates: int,
    on_report: Callable[[Report], None] | None,
) -> Trained:
    """Train a dial of each seed in a gridworld.

    Args:
        preset: Settings of the dials.
        world: The gridworld, with a clock if the preset has one.
        seeds: Training seeds; seed i learns from data set i.
        data: Demonstrations of each seed; not used by a preset without any.
        updates: Gradient steps; 0 for those of the preset.
        on_report: Progress callback.
    """
    static = preset.structure
    static = replace(static, one_hot=world.one_hot, updates=updates or static.updates)
    runs = [replace(preset.numbers, seed=seed, dataset=number) for number, seed in enumerate(seeds)]
    sets = data if static.demonstrations else ()
    simulator = world if static.online else None
    return train_dial(static, runs, sets, simulator, callbacks=Callbacks(on_report=on_report))


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


def train_declared(
    training: Mapping[str, Any],
    ground: Ground,
    seeds: Sequence[int],
    data_sets: dict[str, list[Demonstrations]],
    on_report: Callable[[Report], None] | None,
    prior: Callable[..., Any] | None = None,
) -> tuple[list[Row], list[Learned]]:
    """Train the runs of a `[[train]]` in one program.

    Args:
        training: The declaration as `declared.variants` multiplies it out.
        ground: The world, enumerated.
        seeds: Training seeds; each has a separate data set.
        data_sets: Data sets by their declaration, as "trajectories 60"; new ones are added.
        on_report: Progress callback.
        prior: A user's penalty in place of the quadratic one.

    Returns:
        The rows and the policies. With `checkpoint` the rows are those of `checkpoint_rows`, and
        there are no policies.
    """
    ((kind, number),) = training["data"].items()
    if (key := f"{kind} {number}") not in data_sets:
        experts = {"trajectories": trajectory_datasets, "transitions": transition_datasets}
        data_sets[key] = experts[kind](ground.table, seeds, number)
    data = data_sets[key]
    chunk = training.get("checkpoint")
    static, numbers = learner_of(training)
    runs = [
        replace(changed(numbers, values), seed=seed, dataset=index)
        for values in training["runs"]
        for index, seed in enumerate(seeds)
    ]
    if isinstance(static, behaviour_cloning.CloningConfig):
        callbacks = Callbacks(on_report=on_report)
        trained = behaviour_cloning.BehaviourCloning.train_on(static, runs, data, callbacks)
    else:
        trained = train_runs(ground, static, runs, data, on_report, chunk, prior=prior)
    labels: list[Row] = [
        {
            name: getattr(run, value[1:]) if str(value).startswith("@") else value
            for name, value in training["label"].items()
        }
        for run in runs
    ]
    if chunk is not None:
        return checkpoint_rows(trained, runs, labels), []
    policies = [trained.policy(number) for number in range(len(runs))]
    rows: list[Row] = []
    for target in training.get("targets", [None]):
        for label, run, policy in zip(labels, runs, policies, strict=True):
            angle = run.angle if target is None else target
            rows += rows_of(ground, policy, angle, label | {"target_angle": angle}, run.seed)
    return rows, [
        Learned(label | {"target_angle": run.angle}, static, run, data[run.dataset], policy)
        for label, run, policy in zip(labels, runs, policies, strict=True)
    ]


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
