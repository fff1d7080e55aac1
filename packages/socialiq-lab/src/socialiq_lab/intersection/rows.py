"""Rows of the studies' tables, from episodes of the intersection and from the jobs' folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from socialiq import results_folder as store
from socialiq.evaluation.episodes import OUTCOMES, REWARDS, Episodes, policy_row
from socialiq.results_folder import from_csv
from socialiq.social.angle import exact_weights
from socialiq.storage import packaged_results, read_json
from socialiq.types import Row
from socialiq_lab.intersection.driving import CURVE, EPISODES, load_episodes
from socialiq_lab.jobs import RECORD, Job

SHARES = ("collision", "arrival", "timeout", "ego_struck", "ego_was_struck")

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
                names = (*_RATES, "ego_struck", "ego_was_struck", *REWARDS)
                rows.append(label | {key: row[key] for key in names})
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


_STUDIES = ("intersection", "intersection-networks", "intersection-ahead", "intersection-dial")
_ELSEWHERE = ("varied_drivers", "connected_lanes")
"""Parts of the names of policies that were driven in other scenarios."""
_TOTALS = ("r_env", "r_social")
_FORESIGHT = "foresight"
"""First part of the names of those that see the true future, and so are no policies."""


def known_policies() -> list[Row]:
    """Return study, policy, r_env and r_social of every policy on the 2,000 common episodes.

    Experts, learners, rules, rollout policies, dials and agents; not those that see the true
    future, and not those of other scenarios.

    Raises:
        UserError: If the results did not come with the package.
    """
    found: list[Row] = []
    for study in _STUDIES:
        for row in store.load(packaged_results() / study).tables["policies"]:
            labels = _name(row).split("/")
            here = labels[0] != _FORESIGHT and not set(_ELSEWHERE) & set(labels)
            if here and row["episodes"] == EPISODES:
                told = {"policy": _name(row), "readout": row.get("readout", "greedy")}
                found.append({"study": study, **told} | {name: row[name] for name in _TOTALS})
    return found


def _name(row: Row) -> str:
    """Return a policy's name; a dial's or an agent's has its family, seed and angle."""
    if "policy" in row:
        return row["policy"]
    return f"{row['family']}/{row['seed']}/{row['asked']:g}"


def value_at(row: Row, angle: float) -> float:
    """Return J(α) of a policy's mean totals (Eq 4.3)."""
    direction = exact_weights(angle)
    return direction.env * row["r_env"] + direction.social * row["r_social"]
