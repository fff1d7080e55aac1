"""Rows of tables and files of the atlas, from the folders of the intersection's jobs."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import QPolicy
from socialiq.evaluation.episodes import OUTCOMES, policy_row
from socialiq.evaluation.measures import Episodes
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.saved import load_one_of
from socialiq.results_folder import from_csv
from socialiq.social.angle import exact_weights
from socialiq.storage import read_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.intersection import atlas
from socialiq_lab.intersection import driving, training
from socialiq_lab.jobs import RECORD, Job

_DEPTH = {"learners": 3, "highway": 1, "connected": 1}  # parts of a name that make a kind of job
_IN_ATLAS = (
    "episodes", "collision", "arrival", "timeout", "speed_kmh", "stopped",
    "r_env", "r_social", "angle",
)  # fmt: skip

PolicyEpisodes = dict[tuple[str, str], Episodes]
"""Episodes by policy, which is the folder of its job or "drivers/NAME", and by readout."""


def evaluated(jobs: Sequence[Job], work: Path) -> PolicyEpisodes:
    """Load the episodes of every evaluation of one policy.

    Args:
        jobs: Jobs of any stage; those of the stage `evaluation` are read.
        work: Work folder.

    Returns:
        Episodes by policy and readout. A policy with oracle lookahead, which is named by its angle,
        has the readout "greedy".
    """
    return {
        (job.name.removeprefix("evaluation/"), cell if isinstance(cell, str) else "greedy"): (
            driving.load_episodes(driving.episodes_at(work / job.name, job.config.driver, cell))
        )
        for job in jobs
        if job.stage == "evaluation"
        for cell in job.config.angles or job.config.readouts
    }


def value_at(row: Row, angle: float) -> float:
    """Return J(α) of a policy's mean totals (Eq 4.3).

    Args:
        row: Row with the mean totals `r_env` and `r_social`.
        angle: α in degrees.
    """
    direction = exact_weights(angle)
    return direction.env * row["r_env"] + direction.social * row["r_social"]


def valued(label: Row, file: Path, angle: float) -> Row:
    """Return a row with J(α) at an angle and the metrics of a file of episodes.

    Args:
        label: First columns of the row.
        file: File of `driving.save_episodes`.
        angle: α in degrees.
    """
    row = policy_row("", "greedy", driving.load_episodes(file))
    metrics = {name: row[name] for name in row if name not in ("policy", "readout")}
    return label | {"value": value_at(row, angle)} | metrics


def points_of(rows: Sequence[Row]) -> np.ndarray:
    """Return the mean totals of policies, (policy, 2)."""
    return np.array([(row["r_env"], row["r_social"]) for row in rows])


def backward_steps(rows: Sequence[Row]) -> Row:
    """Return the largest rise of r_env and drop of r_social between successive angles."""
    turns = np.diff(points_of(rows), axis=0)
    return {
        "rise_r_env": float(turns[:, 0].max(initial=0.0)),
        "drop_r_social": float((-turns[:, 1]).max(initial=0.0)),
    }


def curves(
    jobs: Sequence[Job],
    work: Path,
    columns: Sequence[str] = ("updates", "loss", "total", *OUTCOMES),
) -> list[Row]:
    """Return the learning curve of every training run that was checked.

    Args:
        jobs: Training jobs; those without a curve have no rows.
        work: Work folder.
        columns: Columns that are taken from a curve.

    Returns:
        A row for each check of a run.
    """
    return [
        {"run": job.name} | {name: row[name] for name in columns}
        for job in jobs
        if (work / job.name / training.CURVE).is_file()
        for row in from_csv(work / job.name / training.CURVE)
    ]


def times(jobs: Sequence[Job], work: Path) -> list[Row]:
    """Return the time of each kind of job, one process on one core for each job.

    Args:
        jobs: Finished jobs.
        work: Work folder.

    Returns:
        A row for each kind of job: the number of jobs, their seconds together, and those of the
        longest.
    """
    seconds: dict[str, list[float]] = {}
    for job in jobs:
        kind = "/".join(job.name.split("/")[: _DEPTH.get(job.stage, 2)])
        seconds.setdefault(kind, []).append(read_json(work / job.name / RECORD)["seconds"])
    return [
        {"jobs": kind, "number": len(took), "seconds": sum(took), "longest": max(took)}
        for kind, took in seconds.items()
    ]


def atlas_files(
    study: str,
    world: str,
    sources: Mapping[str, tuple[str, str]],
    work: Path,
    greedy: Mapping[str, Row],
) -> dict[str, bytes]:
    """Return the content of the atlas' files.

    Args:
        study: Name of the study that made the policies.
        world: Name of the world.
        sources: Name of the job of each policy, and the file in its folder, by name in the atlas.
        work: Work folder.
        greedy: Metrics of each greedy policy, by name in the atlas.

    Returns:
        Bytes by path below the results folder: the policies, and the manifest.
    """
    contents: dict[str, bytes] = {}
    entries: dict[str, Any] = {}
    for name, (job, policy) in sources.items():
        source = work / job / policy
        file = f"{name}.safetensors"
        contents[f"{atlas.FOLDER}/{file}"] = source.read_bytes()
        record = read_json(work / job / RECORD)
        entries[name] = {
            "file": file,
            "sha256": load_one_of(source, (EnsemblePolicy, ActorPolicy, QPolicy)).sha256,
            "made_by": f"socialiq reproduce {study}",
            "job": job,
            "config": record["config"],
            "inputs": record["inputs"],
            "greedy": {key: greedy[name][key] for key in _IN_ATLAS},
        }
    manifest = {"kind": "atlas", "version": 1, "world": world, "policies": entries}
    text = json.dumps(rounded(manifest), indent=2) + "\n"
    return contents | {f"{atlas.FOLDER}/{atlas.MANIFEST}": text.encode()}
