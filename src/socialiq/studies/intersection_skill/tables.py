"""Tables of the study of the hidden skill, from the jobs' folders alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.rows import times
from socialiq.experiments.jobs import Job
from socialiq.experiments.results import from_csv
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import paired_row, with_holm
from socialiq.statistics.bootstrap import resample_rows
from socialiq.storage import read_json
from socialiq.studies.intersection_skill.config import ALONE, CLONES, FOLDERS, REFERENCES, Config
from socialiq.studies.intersection_skill.driving import Driven, load
from socialiq.studies.intersection_skill.inference import ANGLES
from socialiq.types import Ending, Row

GROUPS = ("all", "demonstrated", "unseen")
"""Angles over which a method's score is averaged."""
_MEASURED = ("score", "told", "skill", "changes", "standing", "collision", "arrival", "timeout")
_OF_CURVES = ("updates", "loss", "max_q", "total")  # all methods have them
_RESAMPLES, _BOOTSTRAP_SEED = 2000, 0


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    scores = list(_scores(config, work))
    groups = _groups(scores)
    tables = {
        "pooled": _pooled(scores),
        "scores": scores,
        "groups": groups,
        "differences": _differences(config, groups) if len(config.seeds) > 1 else [],
        "angles": list(_angles(jobs, work)),
        "curves": list(_curves(jobs, work)),
        "times": times(jobs, work),
    }
    return Findings(tables, _summary(tables))


def _scores(config: Config, work: Path) -> Iterator[Row]:
    """A row for each method, training seed and angle; references that are not trained have none."""
    for method in (*config.methods, *REFERENCES):
        trained = method in (*config.methods, CLONES)
        for seed in config.seeds if trained else ("",):
            name = f"{FOLDERS[method]}/{seed}" if trained else FOLDERS[method]
            for angle in config.angles:
                driven = load(work / "evaluation" / name, angle)
                label = {"method": method, "seed": seed, "angle": angle}
                shown = {"demonstrated": int(angle in MODES.values())}
                yield label | shown | score_row(driven, angle, config)


def score_row(driven: Driven, angle: float, config: Config) -> Row:
    """Means over episodes, and the score's bootstrap interval."""
    scores = driven.score(angle, config.weight)
    low, high = interval(scores)
    endings = {
        kind.name.lower(): float((driven.ending == kind).mean())
        for kind in (Ending.COLLISION, Ending.ARRIVAL, Ending.TIMEOUT)
    }
    return {
        "score": float(scores.mean()),
        "score_low": low,
        "score_high": high,
        "told": float(driven.told(angle).mean()),
        "skill": float(driven.skill().mean()),
        "r_env": float(driven.env.mean()),
        "r_social": float(driven.social.mean()),
        "changes": float(driven.changes.mean()),
        "standing": float(driven.standing.mean()),
        **endings,
        "length": float(driven.length.mean()),
        "episodes": len(scores),
    }


def interval(values: Float[np.ndarray, " episode"]) -> tuple[float, float]:
    """Percentile bootstrap of the mean over episodes, 95 %."""
    drawn = resample_rows(len(values), _RESAMPLES, _BOOTSTRAP_SEED)
    means = np.concatenate([values[rows].mean(axis=1) for rows in drawn])
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def _pooled(scores: Sequence[Row]) -> list[Row]:
    """Each method at each angle: means over training seeds, and how the score spreads over them."""
    found: list[Row] = []
    for method, angle in dict.fromkeys((row["method"], row["angle"]) for row in scores):
        rows = [row for row in scores if (row["method"], row["angle"]) == (method, angle)]
        values = [row["score"] for row in rows]
        found.append(
            {"method": method, "angle": angle, "demonstrated": rows[0]["demonstrated"]}
            | {name: float(np.mean([row[name] for row in rows])) for name in _MEASURED}
            | {"score_sd": float(np.std(values, ddof=1)) if len(values) > 1 else ""}
            | {"score_least": min(values), "score_most": max(values), "seeds": len(values)}
        )
    return found


def _groups(scores: Sequence[Row]) -> list[Row]:
    """Each method and seed: mean score over all angles, those demonstrated, and the others."""
    found: list[Row] = []
    for method, seed in dict.fromkeys((row["method"], row["seed"]) for row in scores):
        mine = [row for row in scores if (row["method"], row["seed"]) == (method, seed)]
        for group, rows in _by_group(mine).items():
            means = {name: float(np.mean([row[name] for row in rows])) for name in _MEASURED}
            found.append({"method": method, "seed": seed, "angles": group} | means)
    return found


def _by_group(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """The rows of each group of angles that has any."""
    chosen = {
        "all": list(rows),
        "demonstrated": [row for row in rows if row["demonstrated"]],
        "unseen": [row for row in rows if not row["demonstrated"]],
    }
    return {group: some for group, some in chosen.items() if some}


def _differences(config: Config, groups: Sequence[Row]) -> list[Row]:
    """Each method's score less that of RL alone, paired over training seeds, Holm over all rows."""
    found: list[Row] = []
    for method in (*(one for one in config.methods if one != ALONE), CLONES):
        for group in GROUPS:
            theirs, alone = (
                [r["score"] for r in groups if (r["method"], r["angles"]) == (name, group)]
                for name in (method, ALONE)
            )
            if theirs:
                found.append(paired_row({"method": method, "angles": group}, theirs, alone))
    return with_holm(found)


def _angles(jobs: Sequence[Job], work: Path) -> Iterator[Row]:
    """The demonstrators' angles by training seed: under RL alone, and under what it led to."""
    for job in jobs:
        if job.stage == "angles":
            _, step, seed = job.name.split("/")
            for row in read_json(work / job.name / ANGLES):
                kept = {key: row[key] for key in ("mode", "true_angle", "angle")}
                yield {"step": int(step), "seed": int(seed)} | kept


def _curves(jobs: Sequence[Job], work: Path) -> Iterator[Row]:
    """Score of each dial while it trains, a mean over the demonstrated angles."""
    for job in jobs:
        path = work / job.name / "curve.csv"
        if path.is_file():
            for row in from_csv(path):
                yield {"run": job.name} | {name: row[name] for name in _OF_CURVES}


def _summary(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Means over training seeds: of each method by group of angles and by angle; the tests."""
    found: dict[str, Any] = {"methods": {}, "by_angle": {}, "differences": {}}
    for method in dict.fromkeys(row["method"] for row in tables["groups"]):
        for group in GROUPS:
            rows = [r for r in tables["groups"] if (r["method"], r["angles"]) == (method, group)]
            if rows:
                means = {name: float(np.mean([row[name] for row in rows])) for name in _MEASURED}
                found["methods"].setdefault(method, {})[group] = means
    for row in tables["pooled"]:
        found["by_angle"].setdefault(row["method"], {})[f"{row['angle']:g}"] = row
    for row in tables.get("differences", []):
        found["differences"].setdefault(row["method"], {})[row["angles"]] = row
    last = max((row["step"] for row in tables.get("angles", [])), default=None)
    for row in tables.get("angles", []):
        if row["step"] in (0, last):
            by_mode = found.setdefault("inferred_angles", {}).setdefault(row["mode"], {})
            by_mode.setdefault(str(row["step"]), []).append(row["angle"])
    return found
