"""Train the runs of one job of a sweep, evaluate them, and make the sweep's table."""

import dataclasses
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import UserError, acting_in, train
from socialiq.demonstrations import files
from socialiq.evaluation.exact import READOUTS, Ground, Metrics
from socialiq.learners import extensions
from socialiq.results_folder import Results
from socialiq.storage import read_json, write_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds import environment
from socialiq.worlds.catalogue import GRIDS, base
from socialiq_lab.gridworld_runs import evaluate
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, callbacks_of

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
        options: Keywords of an environment.
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
    options: Mapping[str, Any]
    name: str
    data: str
    sha256: str
    static: Any
    hyperparameters: tuple[Any, ...]
    allow_code: bool


def train_runs(config: RunsConfig, folder: Path, _: Inputs, on_progress: ProgressCallback) -> None:
    """Train the runs in one compiled program; write each policy, and a row for each readout.

    Args:
        config: The runs.
        folder: Folder of the job.
        _: No folders.
        on_progress: Called with the finished share of the training.

    Raises:
        UserError: If the data set has changed, or data, world and settings don't fit together.
    """
    path = Path(config.data)
    if hashlib.sha256(path.read_bytes()).hexdigest() != config.sha256:
        raise UserError(f"{path} has changed since the sweep began: give the command again")
    data = files.load(path)
    ground = Ground.of(config.world) if base(config.world) in GRIDS else None
    checkpoint = folder / "checkpoint.safetensors"
    learner = collector = None
    if config.learner:
        learner = extensions.find_learner(config.learner, "learner", config.allow_code)
    if config.world and not ground:  # the experience of an environment outside JAX
        sizes = (data.n_features, data.n_actions)
        maker = environment.environment_maker(
            config.world, sizes, config.allow_code, options=config.options
        )
        collector = acting_in(maker, config.static, config.hyperparameters, CHUNK)
    trained = train(
        config.static,
        config.hyperparameters,
        [data],
        ground.table.world if ground and not learner else None,
        callbacks_of(on_progress, checkpoint),
        CHUNK,
        collector,
        learner=learner,
    )
    rows = []
    for run, numbers in enumerate(trained.hyperparameters):
        policy = trained.policy(run)
        name = trained.learner.run_name(numbers)
        policy.save(folder / f"policy_{run}.safetensors")
        failure = next((line for line in trained.failures if line.startswith(f"{name} ")), "")
        row: Row = {"number": run, "failure": failure}
        for term in trained.history.values:  # of the objective, over the last chunk
            value = float(trained.history.array(term)[-1, run])
            row[term] = value if math.isfinite(value) else np.nan
        angle = getattr(numbers, "angle", None)
        if ground is None:
            rows.append(row | NOT_EXACT)
            continue
        for readout in READOUTS:
            metrics = evaluate(ground, policy, readout)
            regret = "" if angle is None else ground.optimum.regret(metrics, angle)
            rows.append(row | {"readout": readout} | metrics._asdict() | {"regret": regret})
    write_json(folder / ROWS, rounded(rows))
    checkpoint.unlink(missing_ok=True)


def results_of(jobs: Sequence[Job], work: Path, settings: Mapping[str, Any]) -> Results:
    """Make the results of a sweep from the folders of its finished jobs.

    The table `runs` has one row for each run and readout: the settings that differ, the last
    terms of the objective and, in a gridworld, the exact metrics and the regret at the angle.

    Args:
        jobs: Finished jobs of the sweep.
        work: Work folder.
        settings: Content of the sweep file, which is recorded.

    Returns:
        The table, the policies, and a summary with the numbers of jobs, runs and failures.
    """
    observed: dict[str, set[Any]] = {}
    for job in jobs:
        for numbers in job.config.hyperparameters:
            for name, value in (_flat(job.config.static) | dataclasses.asdict(numbers)).items():
                observed.setdefault(name, set()).add(value)
    always = ("angle", "strength", "seed")
    varied = [name for name, values in observed.items() if len(values) > 1 or name in always]
    table: list[Row] = []
    policies: dict[str, bytes] = {}
    failures = 0
    for job in jobs:
        config: RunsConfig = job.config
        rows = read_json(work / job.name / ROWS)
        for run, numbers in enumerate(config.hyperparameters):
            name = f"policies/{len(policies):05d}.safetensors"
            label: Row = {"run": len(policies), "world": config.world}
            label |= {f"options.{name}": value for name, value in config.options.items()}
            label["data"] = config.name
            policies[name] = (work / job.name / f"policy_{run}.safetensors").read_bytes()
            flat = _flat(config.static) | dataclasses.asdict(numbers)
            for key in varied:
                value = flat[key]
                cell = " ".join(map(str, value)) if isinstance(value, tuple) else value
                label[_COLUMNS.get(key, key)] = cell
            label["policy"] = name
            own = [row for row in rows if row["number"] == run]
            failures += bool(own[0]["failure"])
            table += [label | {k: v for k, v in row.items() if k != "number"} for row in own]
    names = list(dict.fromkeys(name for row in table for name in row))
    table = [{name: row.get(name, "") for name in names} for row in table]
    summary = {"jobs": len(jobs), "runs": len(policies), "failures": failures}
    return Results.of("sweep", _Recorded(dict(settings)), {"runs": table}, summary, policies)


@dataclass(frozen=True)
class _Recorded:
    """The sweep file's content, as the configuration of the results."""

    file: dict[str, Any]


def _flat(static: Any) -> dict[str, Any]:
    """Return the fields of a static config, the treatment of each ending among them."""
    rows = {row.name: getattr(static, row.name) for row in dataclasses.fields(static)}
    endings = vars(rows.pop("endings")) if "endings" in rows else {}
    return rows | {f"endings.{name}": value for name, value in endings.items()}
