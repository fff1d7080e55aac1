"""Rows of the study's tables, read from its jobs' folders."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from socialiq.evaluation.play import Episodes, conflict_rates
from socialiq.experiments.intersection.episodes import load_episodes
from socialiq.experiments.jobs import RECORD, Job
from socialiq.experiments.results import from_csv
from socialiq.social.angle import estimate_angle
from socialiq.statistics.intervals import wilson
from socialiq.storage import read_json
from socialiq.types import Ending, Row
from socialiq.worlds.intersection.state import Contact

_ANGLE_SEED = 0  # of the bootstrap
_RATES = (
    *(
        f"{kind}{end}"
        for kind in ("collision", "arrival", "timeout")
        for end in ("", "_low", "_high")
    ),
    "ego_struck",
    "ego_was_struck",
)
_DEPTH = {"learners": 3, "highway": 1, "connected": 1}  # parts of a name that make a kind of job
_REWARDS = ("r_env", "r_env_sd", "r_social", "r_social_sd")
_CLASSICAL = ("classical_own", "classical_own_sd", "classical_others", "classical_others_sd")


class Played(NamedTuple):
    """One policy's evaluation under one readout.

    Attributes:
        name: Of the policy: the folder of its job, "drivers/NAME" for a driver by rule.
        readout: greedy or soft.
        episodes: What became of them, on seeds common to all.
    """

    name: str
    readout: str
    episodes: Episodes


def played(jobs: Sequence[Job], work: Path) -> Iterator[Played]:
    """Every evaluation of the plan."""
    for job in jobs:
        if job.stage == "evaluation":
            name = job.name.removeprefix("evaluation/")
            for readout in job.config.readouts:
                path = work / job.name / f"{readout}.safetensors"
                yield Played(name, readout, load_episodes(path))


def policy_row(one: Played) -> Row:
    """Everything of thesis 5.4 about one policy, and what its collisions were risked for."""
    outcome, reward = outcome_row(one.episodes), reward_row(one.episodes)
    angle = estimate_angle(*one.episodes.totals, seed=_ANGLE_SEED)
    row = {"policy": one.name, "readout": one.readout} | outcome
    row |= {name: reward[name] for name in (*_REWARDS, *_CLASSICAL)}
    row |= {"angle": angle.angle, "angle_low": angle.low, "angle_high": angle.high}
    exposed = conflict_rates(one.episodes)
    return row | {
        name: "" if value is None else value
        for name, value in exposed.items()
        if name not in row and name not in ("at_fault", "struck")
    }


def curves(jobs: Sequence[Job], work: Path) -> list[Row]:
    """The learning curve of every training run."""
    rows: list[Row] = []
    for job in jobs:
        path = work / job.name / "curve.csv"
        if path.is_file():
            kept = ("updates", "loss", "total", "collision", "arrival", "timeout")
            rows += [{"run": job.name} | {k: row[k] for k in kept} for row in from_csv(path)]
    return rows


def times(jobs: Sequence[Job], work: Path) -> list[Row]:
    """Time of each kind of job, one process on one core for each job."""
    seconds: dict[str, list[float]] = {}
    for job in jobs:
        kind = "/".join(job.name.split("/")[: _DEPTH.get(job.stage, 2)])
        seconds.setdefault(kind, []).append(read_json(work / job.name / RECORD)["seconds"])
    return [
        {"jobs": kind, "number": len(took), "seconds": sum(took), "longest": max(took)}
        for kind, took in seconds.items()
    ]


def connected(jobs: Sequence[Job], work: Path) -> list[Row]:
    """Outcomes of the atlas' policies among drivers who see across connected lanes, and who don't.

    With highway-env's intersection-v2 a driver looks for vehicles ahead on the lane that follows
    its own too; before, it doesn't see who has stopped just beyond the border.
    """
    rows: list[Row] = []
    for job in jobs:
        if job.stage == "connected":
            (trained,) = job.inputs
            folders = {"off": work / "evaluation" / trained, "on": work / job.name}
            for name, folder in folders.items():
                row = policy_row(
                    Played(trained, "greedy", load_episodes(folder / "greedy.safetensors"))
                )
                label = {"member": job.name.removeprefix("connected/"), "connected": name}
                rows.append(label | {key: row[key] for key in (*_RATES, *_REWARDS)})
    return rows


def highway(jobs: Sequence[Job], work: Path) -> list[Row]:
    """Comparison of each final policy's episodes on the real highway-env and on the core."""
    rows: list[Row] = []
    for job in jobs:
        if job.stage == "highway":
            compared = from_csv(work / job.name / "compared.csv")
            worst = ("max_deviation", "max_observation_deviation", "max_reward_deviation")
            rows.append(
                {"policy": job.name.removeprefix("highway/"), "episodes": len(compared)}
                | {"steps": sum(row["steps"] for row in compared)}
                | {"differing": sum(row["discrete_differences"] for row in compared)}
                | {name: max(row[name] for row in compared) for name in worst}
            )
    return rows


KMH = 3.6  # km/h of a m/s


OUTCOMES = {"collision": Ending.COLLISION, "arrival": Ending.ARRIVAL, "timeout": Ending.TIMEOUT}


def outcome_row(episodes: Episodes) -> Row:
    """Rates with Wilson intervals, who ran into whom, speeds."""
    count = len(episodes.ending)
    row: Row = {"episodes": count}
    for name, kind in OUTCOMES.items():
        share = wilson(int((episodes.ending == kind).sum()), count)
        row |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
    length = episodes.length
    return row | {
        "ego_struck": float((episodes.contact == Contact.EGO_STRUCK).mean()),
        "ego_was_struck": float((episodes.contact == Contact.EGO_WAS_STRUCK).mean()),
        "neighbours_collided": float(episodes.neighbours_collided.mean()),
        "length": float(length.mean()),
        "speed_kmh": KMH * float(episodes.speed.mean()),
        "speed_kmh_of_steps": KMH * float((episodes.speed * length).sum() / length.sum()),
        "stopped": float(episodes.stopped.mean()),
        "stopped_of_steps": float((episodes.stopped * length).sum() / length.sum()),
    }


def reward_row(episodes: Episodes) -> Row:
    """Totals of an episode, and the share of decisions in which each signal is not 0."""
    metrics, steps = episodes.metrics(), episodes.length.sum()
    active = episodes.active.sum(axis=0) / steps
    return {
        "r_env": metrics.r_env,
        "r_env_sd": float(episodes.totals.env.std()),
        "r_social": metrics.r_social,
        "r_social_sd": float(episodes.totals.social.std()),
        "angle": metrics.angle,
        "collision": metrics.collision,
        "arrival": metrics.arrival,
        "timeout": metrics.timeout,
        **{
            f"{name}_active": float(a)
            for name, a in zip(episodes.signal_names, active, strict=True)
        },
        "classical_own": float(episodes.classical.env.mean()),
        "classical_own_sd": float(episodes.classical.env.std()),
        "classical_others": float(episodes.classical.social.mean()),
        "classical_others_sd": float(episodes.classical.social.std()),
    }
