"""Train many runs in an enumerable world and evaluate every one of them exactly."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq import Demonstrations, QPolicy, train
from socialiq.errors import one_of
from socialiq.evaluation import exact
from socialiq.evaluation.exact import Ground, Metrics, mean_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import behaviour_cloning
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.kernel import Trained
from socialiq.learners.state import History
from socialiq.settings import changed
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq_lab.tables import groups

Monitor = Callable[[Any], dict[str, np.ndarray]]
"""From the `TrainState` of all runs to named values, each (runs,)."""


def grid_of(
    angles: Sequence[float],
    strengths: Sequence[float],
    seeds: Sequence[int],
    base: IQLearnHyperparameters,
) -> list[IQLearnHyperparameters]:
    """Return hyperparameters for every angle, strength and seed; seed i learns from data set i."""
    return [
        dataclasses.replace(base, angle=angle, strength=strength, seed=seed, dataset=dataset)
        for angle in angles
        for strength in strengths
        for dataset, seed in enumerate(seeds)
    ]


def train_runs(
    ground: Ground,
    static: IQLearnConfig,
    hyperparameters: Sequence[IQLearnHyperparameters],
    datasets: Sequence[Demonstrations],
    on_report: Callable[[Report], None] | None,
    chunk: int = 500,
    monitor: Monitor | None = None,
    prior: Callable[..., Any] | None = None,
) -> Trained:
    """Train in the ground's world and record the monitor's values after every chunk.

    The default monitor of a training with a progress callback is the exact metrics.
    """
    if monitor is None and on_report is not None:
        monitor = exact.exact_monitor(ground.part, [run.temperature for run in hyperparameters])
    callbacks = Callbacks(on_report=on_report, monitor=monitor)
    simulator = ground.table.world if static.online else None
    return train(static, hyperparameters, datasets, simulator, callbacks, chunk, prior=prior)


def axes(declared: Mapping[str, Any]) -> dict[str, Sequence[Any]]:
    """Return the values of each axis of a grid of runs; "modes" are the experts' angles."""
    return {
        name: list(MODES.values()) if values == "modes" else values
        for name, values in declared.items()
    }


def learner_of(variant: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return static configuration and hyperparameters of a declared training.

    Those of its `learner` ("iq_learn" or "behaviour_cloning") and `preset`, without the prior if
    it is not `regularized`, with the fields of `static` changed.
    """
    learner = variant.get("learner", "iq_learn")
    one_of("learner", learner, ("iq_learn", "behaviour_cloning"))
    if learner == "iq_learn":
        one_of("preset", variant["preset"], tuple(presets.PRESETS))
        static, numbers = presets.PRESETS[variant["preset"]]
        static = static if variant.get("regularized", True) else presets.baseline(static)
    else:
        static = behaviour_cloning.CloningConfig()
        numbers = behaviour_cloning.CloningHyperparameters()
    return changed(static, variant.get("static", {})), numbers


def train_variant(
    ground: Ground,
    static: Any,
    runs: Sequence[Any],
    datasets: Sequence[Demonstrations],
    on_report: Callable[[Report], None] | None,
    chunk: int | None = None,
    prior: Callable[..., Any] | None = None,
) -> Trained:
    """Train the runs of a declared training, IQ-Learn or behaviour cloning, in one program.

    `chunk` is the number of updates between two exact evaluations (None for none), and `prior` a
    penalty of the user's own in place of the quadratic one.
    """
    if isinstance(static, behaviour_cloning.CloningConfig):
        callbacks = Callbacks(on_report=on_report)
        return behaviour_cloning.BehaviourCloning.train_on(static, runs, datasets, callbacks)
    monitor = None
    if chunk is not None:
        monitor = exact.exact_monitor(ground.part, [run.temperature for run in runs])
    return train_runs(ground, static, runs, datasets, on_report, chunk or 500, monitor, prior)


def checkpoint_rows(history: History, runs: Sequence[Any], labels: Sequence[Row]) -> list[Row]:
    """Return a row for each checkpoint, run and action selection, with the exact metrics."""
    arrays = {
        (readout, name): history.array(f"{readout}_{name}")
        for readout in exact.READOUTS
        for name in Metrics._fields
    }
    return [
        label
        | {"readout": readout, "seed": run.seed, "updates": updates}
        | {name: float(arrays[readout, name][checkpoint, number]) for name in Metrics._fields}
        for number, (run, label) in enumerate(zip(runs, labels, strict=True))
        for readout in exact.READOUTS
        for checkpoint, updates in enumerate(history.updates)
    ]


def evaluate(ground: Ground, policy: QPolicy, readout: exact.Readout) -> Metrics:
    """Return the exact metrics of a trained policy."""
    return exact.evaluate_exactly(ground.part, exact.action_table(policy, ground.part, readout))


def rows_of(
    ground: Ground, policies: Sequence[QPolicy], angle: float, label: Row, seeds: Sequence[int]
) -> list[Row]:
    """Return label, seed, metrics and regret of each policy and action selection."""
    rows = []
    for policy, seed in zip(policies, seeds, strict=True):
        for readout in exact.READOUTS:
            metrics = evaluate(ground, policy, readout)
            regret = ground.optimum.regret(metrics, angle)
            rows.append(
                label | {"readout": readout, "seed": seed} | metrics._asdict() | {"regret": regret}
            )
    return rows


def with_regret(ground: Ground, rows: Sequence[Row], angle: float) -> list[Row]:
    """Add the regret at an angle in degrees to rows with exact metrics."""
    return [row | {"regret": ground.optimum.regret(metrics_of(row), angle)} for row in rows]


def metrics_of(row: Row) -> Metrics:
    """Return the metrics of a row."""
    return Metrics(*(row[name] for name in Metrics._fields))


def pooled(rows: Sequence[Row], keys: Sequence[str]) -> list[Row]:
    """Return means over seeds of rows with equal `keys`; the angle is that of the mean totals.

    `angle_low` and `angle_high` are the least and greatest angle of a single seed.
    """
    means = []
    for values, group in groups(rows, *keys).items():
        metrics = mean_of([metrics_of(row) for row in group])
        angles = [row["angle"] for row in group]
        means.append(
            dict(zip(keys, values, strict=True))
            | {"seeds": len(group)}
            | metrics._asdict()
            | {"angle_low": min(angles), "angle_high": max(angles)}
            | {"regret": float(np.mean([row["regret"] for row in group]))}
        )
    return means


def sequence(table: Table, policy: Float[np.ndarray, "state action"]) -> str:
    """Return the actions of a greedy episode in a deterministic world, W for Wait, G for Go."""
    mdp, letters = table.mdp, ""
    state = int(mdp.initial.argmax())
    for _ in range(table.world.horizon):
        action = int(policy[state].argmax())
        letters += table.world.actions[action][0]
        if mdp.ending[state, action, 0]:
            break
        state = int(mdp.successor[state, action, 0])
    return letters
