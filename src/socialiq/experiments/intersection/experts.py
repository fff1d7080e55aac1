"""Experts of the intersection: their jobs, their evaluation, and what a good egoist reaches."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.jobs import (
    BEST,
    LAST,
    Evaluation,
    ExpertRun,
    HighwayRun,
    LookaheadRun,
    drive_highway,
    drive_with_lookahead,
    evaluate,
    train_expert,
    train_learner,
)
from socialiq.experiments.jobs import Job
from socialiq.learners.dqn import config as dqn
from socialiq.types import Row

EXPERT_STEPS = 5_000_000
"""Environment steps of an expert that reads the flat list (thesis 5.2)."""


def expert_name(network: str, mode: str, seed: int) -> str:
    """Folder of an expert."""
    return f"experts/{network}/{mode}/{seed}"


def flat_expert(mode: str, seed: int, steps: int) -> Job:
    """An expert with the thesis' network and settings."""
    run = ExpertRun(
        dqn.StaticConfig(steps=steps), dqn.Hyperparameters(angle=MODES[mode], seed=seed)
    )
    return Job(expert_name("flat", mode, seed), train_expert, run, cost=900.0)


def finer(numbers: dqn.Hyperparameters) -> dqn.Hyperparameters:
    """Exploration and step size fall further."""
    return dataclasses.replace(numbers, exploration=0.02, final_learning_rate=1.5e-5)


def evaluations(jobs: list[Job], episodes: int) -> Iterator[Job]:
    """One job for each trained policy: experts greedily, learners both ways."""
    for job in jobs:
        if job.work is train_expert:
            run = Evaluation(BEST, readouts=("greedy",), episodes=episodes)
            yield Job(f"evaluation/{job.name}", evaluate, run, (job.name,), cost=3.0)
        if job.stage == "experts":
            looking = LookaheadRun(job.config.numbers.angle, episodes=episodes)
            name = job.name.removeprefix("experts/")
            yield Job(
                f"evaluation/foresight/{name}",
                drive_with_lookahead,
                looking,
                (job.name,),
                cost=20.0,
            )
        if job.work is train_learner:
            run = Evaluation(episodes=episodes)
            yield Job(f"evaluation/{job.name}", evaluate, run, (job.name,), cost=6.0)


def on_highway(members: Mapping[str, str], episodes: int) -> Iterator[Job]:
    """Policies of an atlas on the real highway-env."""
    if episodes:
        for name, job in members.items():
            run = HighwayRun(policy_file(job), episodes)
            yield Job(f"highway/{name}", drive_highway, run, (job,), cost=100.0)


def policy_file(job: str) -> str:
    """Network of a job that counts: an expert's best by checks, a learner's last."""
    return LAST if job.startswith("learners/") else BEST


def set_expert(mode: str, seed: int, steps: int) -> Job:
    """An expert that sees a set of vehicles."""
    structure = dqn.StaticConfig("set", (128, 128), steps=steps, steps_per_update=12)
    numbers = dqn.Hyperparameters(angle=MODES[mode], learning_rate=5e-4, polyak=0.01, seed=seed)
    run = ExpertRun(structure, finer(numbers))
    return Job(expert_name("set", mode, seed), train_expert, run, cost=900.0)


SHARES = ("collision", "arrival", "timeout", "ego_struck", "ego_was_struck")


TARGET = {"arrival": 0.95, "collision": 0.04}
"""Aim of an egoist: at least so many arrivals, at most so many collisions."""


def reaches(row: Row) -> bool:
    """Whether a policy is as good as a good egoist should be."""
    """Whether a policy is as good as a good egoist should be."""
    return row["arrival"] >= TARGET["arrival"] and row["collision"] <= TARGET["collision"]
