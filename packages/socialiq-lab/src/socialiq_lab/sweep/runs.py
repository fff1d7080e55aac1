"""Train the runs of one job of a sweep, evaluate them, and make the sweep's table."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.exact import READOUTS, Ground, Metrics
from socialiq.learners.acting import acting_in
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.extensions import find_learner
from socialiq.learners.iq_learn.train import train
from socialiq.learners.kernel import Trained
from socialiq.learners.state import Runs
from socialiq.nn.q_policy import QPolicy
from socialiq.results_folder import Results
from socialiq.storage import read_json, write_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.environment import environment_maker
from socialiq.worlds.registry import GRIDWORLDS
from socialiq_lab.gridworld_runs import evaluate
from socialiq_lab.jobs import Job, ProgressCallback

CHUNK = 500
ROWS = "rows.json"
_COLUMNS = {"angle": "target_angle"}  # `angle` is what came out
NOT_EXACT = dict.fromkeys(("readout", *Metrics._fields, "regret"), "")
"""Cells of a run whose world can't be evaluated exactly."""


@dataclass(frozen=True)
class RunsConfig:
    """Runs of one static config, world and data set.

    Attributes:
        learner: "" for IQ-Learn; else a name of `extensions.LEARNERS` or FILE.py:NAME.
        learner_sha256: Of that file, else "".
        world: Where IQ-Learn acts, a gridworld or an environment, and where every learner is
            evaluated; "" trains offline.
        name: Of the data set, as the sweep file has it.
        data: Absolute path of the data set.
        sha256: Of that file.
        static: Shared by the runs.
        hyperparameters: Of each run.
        allow_code: Whether the environment's module may be imported.
    """

    learner: str
    learner_sha256: str
    world: str
    name: str
    data: str
    sha256: str
    static: Any
    hyperparameters: tuple[Any, ...]
    allow_code: bool


def train_runs(
    config: RunsConfig, folder: Path, _: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train the runs in one compiled program; write each policy, and a row for each readout.

    Raises:
        UserError: If the data set has changed, or data, world and settings don't fit together.
    """
    path = Path(config.data)
    if hashlib.sha256(path.read_bytes()).hexdigest() != config.sha256:
        raise UserError(f"{path} has changed since the sweep began: give the command again")
    data = files.load(path)
    ground = Ground.of(config.world) if config.world in GRIDWORLDS else None
    checkpoint = folder / "checkpoint.safetensors"
    learner = None
    if config.learner:
        learner = find_learner(config.learner, "learner", config.allow_code)
    trained = train(
        config.static,
        config.hyperparameters,
        [data],
        ground.table.world if ground and not learner else None,
        Callbacks(
            on_report=lambda report: on_progress(report.done / report.total),
            checkpoint=checkpoint,
            resume=checkpoint.is_file(),
        ),
        CHUNK,
        _collector(config, data) if config.world and not ground else None,
        learner=learner,
    )
    rows = []
    for run, one in enumerate(trained.hyperparameters):
        policy = trained.policy(run)
        policy.save(folder / f"policy_{run}.safetensors")
        found = {"failure": _failure(trained, run)} | _last(trained, run)
        exact = _exact(ground, policy, getattr(one, "angle", None)) if ground else [NOT_EXACT]
        rows += [{"number": run} | found | row for row in exact]
    write_json(folder / ROWS, rounded(rows))
    checkpoint.unlink(missing_ok=True)


def _exact(ground: Ground, policy: QPolicy, angle: float | None) -> list[Row]:
    """Return the exact metrics of a policy, and its regret at its angle, for each readout."""
    rows = []
    for readout in READOUTS:
        metrics = evaluate(ground, policy, readout)
        regret = "" if angle is None else ground.optimum.regret(metrics, angle)
        rows.append({"readout": readout} | metrics._asdict() | {"regret": regret})
    return rows


def _collector(config: RunsConfig, data: Demonstrations) -> Callable[[Runs, int], Runs]:
    """Bring in the experience of an environment outside JAX."""
    given = (data.n_features, data.n_actions)
    make = environment_maker(config.world, given, config.allow_code)
    return acting_in(make, config.static, config.hyperparameters, CHUNK)


def _failure(trained: Trained, run: int) -> str:
    name = trained.learner.run_name(trained.hyperparameters[run])
    return next((line for line in trained.failures if line.startswith(f"{name} ")), "")


def _last(trained: Trained, run: int) -> dict[str, float]:
    """Return the terms of the objective over the last chunk."""
    history = trained.history
    rows = {name: float(history.array(name)[-1, run]) for name in history.values}
    return {name: value if math.isfinite(value) else np.nan for name, value in rows.items()}


def results_of(jobs: Sequence[Job], work: Path, settings: Mapping[str, Any]) -> Results:
    """Make the results of a sweep from the folders of its finished jobs.

    The table `runs` has one row for each run and readout: the settings that differ, the last
    terms of the objective and, in a gridworld, the exact metrics and the regret at the angle.
    """
    varied = _varied([job.config for job in jobs])
    table: list[Row] = []
    policies: dict[str, bytes] = {}
    failures, number = 0, 0
    for job in jobs:
        config: RunsConfig = job.config
        rows = read_json(work / job.name / ROWS)
        for run, one in enumerate(config.hyperparameters):
            name = f"policies/{number:05d}.safetensors"
            policies[name] = (work / job.name / f"policy_{run}.safetensors").read_bytes()
            path = {"run": number, "world": config.world, "data": config.name}
            flat = _flat(config.static) | dataclasses.asdict(one)
            label = path | {_COLUMNS.get(key, key): _cell(flat[key]) for key in varied}
            label["policy"] = name
            own = [row for row in rows if row["number"] == run]
            failures += bool(own[0]["failure"])
            table += [label | {k: v for k, v in row.items() if k != "number"} for row in own]
            number += 1
    names = list(dict.fromkeys(name for row in table for name in row))
    table = [{name: row.get(name, "") for name in names} for row in table]
    summary = {"jobs": len(jobs), "runs": number, "failures": failures}
    return Results.of("sweep", _Recorded(dict(settings)), {"runs": table}, summary, policies)


@dataclass(frozen=True)
class _Recorded:
    """The sweep file's content, as the configuration of the results."""

    file: dict[str, Any]


def _varied(configs: Sequence[RunsConfig]) -> list[str]:
    """Return names of the settings that differ between runs, angle, λ and seed always."""
    observed: dict[str, set[Any]] = {}
    for config in configs:
        for name, value in _flat(config.static).items():
            observed.setdefault(name, set()).add(value)
        for row in config.hyperparameters:
            for name, value in dataclasses.asdict(row).items():
                observed.setdefault(name, set()).add(value)
    always = ("angle", "strength", "seed")
    return [name for name, values in observed.items() if len(values) > 1 or name in always]


def _flat(static: Any) -> dict[str, Any]:
    """Return the fields of a static config, the treatment of each ending among them."""
    rows = {row.name: getattr(static, row.name) for row in dataclasses.fields(static)}
    endings = vars(rows.pop("endings")) if "endings" in rows else {}
    return rows | {f"endings.{name}": value for name, value in endings.items()}


def _cell(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, tuple) else value
