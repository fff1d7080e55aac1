"""Rows of the studies' tables, from episodes of the intersection and from the jobs' folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from socialiq.evaluation.episodes import Episodes, conflict_rates
from socialiq.social.angle import estimate_angle
from socialiq.statistics.intervals import wilson
from socialiq.storage import read_json
from socialiq.types import Ending, Row
from socialiq.worlds.highway.state import Contact
from socialiq_lab.intersection.episodes import CURVE, load_episodes
from socialiq_lab.jobs import RECORD, Job
from socialiq_lab.results import from_csv

OUTCOMES = {"collision": Ending.COLLISION, "arrival": Ending.ARRIVAL, "timeout": Ending.TIMEOUT}
SHARES = ("collision", "arrival", "timeout", "ego_struck", "ego_was_struck")

KMH = 3.6  # km/h of a m/s
_BOOTSTRAP_SEED = 0  # of the angle's interval
_REWARDS = ("r_env", "r_env_sd", "r_social", "r_social_sd")
_CLASSICAL = ("classical_own", "classical_own_sd", "classical_others", "classical_others_sd")
_RATES = tuple(f"{kind}{end}" for kind in OUTCOMES for end in ("", "_low", "_high"))
_DEPTH = {"learners": 3, "highway": 1, "connected": 1}  # parts of a name that make a kind of job

PolicyEpisodes = dict[tuple[str, str], Episodes]
"""Episodes by policy, which is the folder of its job or "drivers/NAME", and by readout."""


def evaluated(jobs: Sequence[Job], work: Path) -> PolicyEpisodes:
    """Load the episodes of every evaluation."""
    return {
        (job.name.removeprefix("evaluation/"), readout): load_episodes(
            work / job.name / f"{readout}.safetensors"
        )
        for job in jobs
        if job.stage == "evaluation"
        for readout in job.config.readouts
    }


def policy_rows(episodes: PolicyEpisodes) -> dict[tuple[str, str], Row]:
    """Return the row of each policy."""
    return {key: policy_row(*key, played) for key, played in episodes.items()}


def policy_row(policy: str, readout: str, episodes: Episodes, off_road: bool = False) -> Row:
    """Return every metric of thesis 5.4 of one policy, and its collisions by exposure.

    Args:
        policy: Its name.
        readout: How it chooses, greedy or soft.
        episodes: Results of its episodes.
        off_road: As of `outcome_row`.
    """
    outcome, reward = outcome_row(episodes, off_road), reward_row(episodes)
    angle = estimate_angle(*episodes.totals, seed=_BOOTSTRAP_SEED)
    row = {"policy": policy, "readout": readout} | outcome
    row |= {name: reward[name] for name in (*_REWARDS, *_CLASSICAL)}
    row |= {"angle": angle.angle, "angle_low": angle.low, "angle_high": angle.high}
    return row | {
        name: "" if value is None else value
        for name, value in conflict_rates(episodes).items()
        if name not in row and name not in ("at_fault", "struck")
    }


def outcome_row(episodes: Episodes, off_road: bool = False) -> Row:
    """Return rates with Wilson intervals, contacts, length and speeds.

    Args:
        episodes: Results of the episodes.
        off_road: Whether to add the share of episodes in which the ego left the road.
    """
    count, length = len(episodes.ending), episodes.length
    row: Row = {"episodes": count}
    happened = {name: episodes.ending == kind for name, kind in OUTCOMES.items()}
    happened |= {"off_road": episodes.off_road} if off_road else {}
    for name, which in happened.items():
        share = wilson(int(which.sum()), count)
        row |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
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
    """Return totals of an episode, and the share of decisions in which each signal is not 0."""
    metrics, steps = episodes.metrics(), episodes.length.sum()
    active = episodes.active.sum(axis=0) / steps
    return {
        "r_env": metrics.r_env,
        "r_env_sd": float(episodes.totals.env.std()),
        "r_social": metrics.r_social,
        "r_social_sd": float(episodes.totals.social.std()),
        **{name: getattr(metrics, name) for name in ("angle", *OUTCOMES)},
        **{
            f"{name}_active": float(share)
            for name, share in zip(episodes.signal_names, active, strict=True)
        },
        "classical_own": float(episodes.classical.env.mean()),
        "classical_own_sd": float(episodes.classical.env.std()),
        "classical_others": float(episodes.classical.social.mean()),
        "classical_others_sd": float(episodes.classical.social.std()),
    }


def curves(
    jobs: Sequence[Job],
    work: Path,
    columns: Sequence[str] | None = ("updates", "loss", "total", *OUTCOMES),
) -> list[Row]:
    """Return the learning curve of every training run that was checked; None keeps all columns."""
    return [
        {"run": job.name} | {name: row[name] for name in columns or row}
        for job in jobs
        if (work / job.name / CURVE).is_file()
        for row in from_csv(work / job.name / CURVE)
    ]


def times(jobs: Sequence[Job], work: Path) -> list[Row]:
    """Return the time of each kind of job, one process on one core for each job."""
    seconds: dict[str, list[float]] = {}
    for job in jobs:
        kind = "/".join(job.name.split("/")[: _DEPTH.get(job.stage, 2)])
        seconds.setdefault(kind, []).append(read_json(work / job.name / RECORD)["seconds"])
    return [
        {"jobs": kind, "number": len(took), "seconds": sum(took), "longest": max(took)}
        for kind, took in seconds.items()
    ]


def connected(jobs: Sequence[Job], work: Path) -> list[Row]:
    """Return outcomes of the atlas' policies with and without connected lanes.

    With highway-env's intersection-v2 a driver also reacts to vehicles on the lane that follows
    its own; before, it ignores a vehicle that has stopped just beyond the border.
    """
    rows: list[Row] = []
    for job in jobs:
        if job.stage == "connected":
            (trained,) = job.inputs
            folders = {"off": work / "evaluation" / trained, "on": work / job.name}
            for name, folder in folders.items():
                episodes = load_episodes(folder / "greedy.safetensors")
                row = policy_row(trained, "greedy", episodes)
                label = {"member": job.name.removeprefix("connected/"), "connected": name}
                kept = (*_RATES, "ego_struck", "ego_was_struck", *_REWARDS)
                rows.append(label | {key: row[key] for key in kept})
    return rows


def highway(jobs: Sequence[Job], work: Path) -> list[Row]:
    """Compare each policy's episodes on the real highway-env with those on the core."""
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
