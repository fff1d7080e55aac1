"""Experts of the intersection: their jobs, their evaluation, and their files in the atlas."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from socialiq.evaluation.rollout import MODES
from socialiq.learners import dqn
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import load_values
from socialiq.storage import kind_of, read_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.intersection import atlas
from socialiq_lab.intersection.driving import (
    BEST,
    LAST,
    Evaluation,
    HighwayRun,
    LookaheadRun,
    drive_highway,
    drive_with_lookahead,
    evaluate,
)
from socialiq_lab.intersection.training import ExpertRun, train_expert, train_learner
from socialiq_lab.jobs import RECORD, Job

EXPERT_STEPS = 5_000_000
"""Environment steps of an expert with the flat network (thesis 5.2)."""
_IN_ATLAS = (
    "episodes", "collision", "arrival", "timeout", "speed_kmh", "stopped",
    "r_env", "r_social", "angle",
)  # fmt: skip


def expert_name(network: str, mode: str, seed: int) -> str:
    """Return the folder of an expert."""
    return f"experts/{network}/{mode}/{seed}"


def flat_expert(mode: str, seed: int, steps: int) -> Job:
    """Return the job of an expert with the thesis' network and settings."""
    run = ExpertRun(
        dqn.DQNConfig(steps=steps), dqn.DQNHyperparameters(angle=MODES[mode], seed=seed)
    )
    return Job(expert_name("flat", mode, seed), train_expert, run, cost=900.0)


def finer(numbers: dqn.DQNHyperparameters) -> dqn.DQNHyperparameters:
    """Return hyperparameters whose exploration and step size fall further."""
    return dataclasses.replace(numbers, exploration=0.02, final_learning_rate=1.5e-5)


def evaluations(jobs: Sequence[Job], episodes: int) -> Iterator[Job]:
    """Evaluate each trained policy: experts greedily and with lookahead, learners both ways."""
    for job in jobs:
        name, inputs = f"evaluation/{job.name}", (job.name,)
        if job.work is train_expert:
            run = Evaluation(BEST, ("greedy",), episodes=episodes)
            yield Job(name, evaluate, run, inputs, cost=3.0)
        if job.stage == "experts":
            ahead = LookaheadRun(job.config.numbers.angle, episodes=episodes)
            name = name.replace("experts/", "foresight/")
            yield Job(name, drive_with_lookahead, ahead, inputs, cost=20.0)
        if job.work is train_learner:
            yield Job(name, evaluate, Evaluation(episodes=episodes), inputs, cost=6.0)


def on_highway(members: Mapping[str, str], episodes: int) -> Iterator[Job]:
    """Drive an atlas' policies on the real highway-env, if in any episodes."""
    for name, job in members.items() if episodes else ():
        run = HighwayRun(driver=policy_file(job), episodes=episodes)
        yield Job(f"highway/{name}", drive_highway, run, (job,), cost=100.0)


def policy_file(job: str) -> str:
    """Return the file of a job's network that counts: an expert's best, a learner's last."""
    return LAST if job.startswith("learners/") else BEST


def atlas_files(
    study: str,
    members: Mapping[str, str],
    work: Path,
    rows: Mapping[tuple[str, str], Row],
) -> dict[str, bytes]:
    """Return the content of the atlas' files by path below the results folder.

    Args:
        study: Name of the study that made them.
        members: Job of each policy, by name in the atlas.
        work: Folder of the jobs.
        rows: Metrics of each policy, by (job, readout).
    """
    sources = {name: (job, policy_file(job)) for name, job in members.items()}
    greedy = {name: rows[job, "greedy"] for name, job in members.items()}
    return atlas_entries(study, "intersection", sources, work, greedy)


def atlas_entries(
    study: str,
    world: str,
    sources: Mapping[str, tuple[str, str]],
    work: Path,
    greedy: Mapping[str, Row],
) -> dict[str, bytes]:
    """Return the content of the atlas' files by path below the results folder.

    Args:
        study: Name of the study that made them.
        world: Name of their world.
        sources: Job of each policy and the file in its folder, by name in the atlas.
        work: Folder of the jobs.
        greedy: Metrics of each policy, by name in the atlas.
    """
    contents: dict[str, bytes] = {}
    entries: dict[str, Any] = {}
    for name, (job, policy) in sources.items():
        source, file = work / job / policy, f"{name}.safetensors"
        contents[f"{atlas.FOLDER}/{file}"] = source.read_bytes()
        record = read_json(work / job / RECORD)
        load = ActorPolicy.load if kind_of(source) == ActorPolicy.KIND else load_values
        entries[name] = {
            "file": file,
            "sha256": load(source).sha256,
            "made_by": f"socialiq reproduce {study}",
            "job": job,
            "config": record["config"],
            "inputs": record["inputs"],
            "greedy": {key: greedy[name][key] for key in _IN_ATLAS},
        }
    manifest = {"kind": "atlas", "version": 1, "world": world, "policies": entries}
    text = json.dumps(rounded(manifest), indent=2) + "\n"
    return contents | {f"{atlas.FOLDER}/{atlas.MANIFEST}": text.encode()}
