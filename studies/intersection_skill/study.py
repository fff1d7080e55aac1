"""A skill that demonstrators share and the reward pair lacks, in the intersection."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.statistics.bootstrap import resample_rows
from socialiq.storage import read_json
from socialiq.types import Row
from socialiq_lab.intersection.rows import OUTCOMES, curves, times
from socialiq_lab.jobs import Job
from socialiq_lab.study import Context, Findings, Study, view_of
from socialiq_lab.tables import groups, matching, mean, nested, paired_row, with_holm
from studies.intersection_skill.figures import draw
from studies.intersection_skill.improvement import CHOICE, LEFT_OUT
from studies.intersection_skill.jobs import ANGLES
from studies.intersection_skill.plan import (
    ALONE,
    EXPERTS,
    FOLDERS,
    Config,
    plan,
)
from studies.intersection_skill.skill import ScoredEpisodes, load

GROUPS: dict[str, tuple[int, ...]] = {"all": (0, 1), "demonstrated": (1,), "unseen": (0,)}
"""Groups of angles over which a method's score is averaged, by whether they are demonstrated."""
_MEASURED = ("score", "told", "skill", "changes", "standing", "collision", "arrival", "timeout")
_OF_CURVES = ("updates", "loss", "max_q", "total")  # all methods have them
_RESAMPLES, _BOOTSTRAP_SEED = 2000, 0


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    scores = list(_scores(config, work))
    by_group = _by_group(scores)
    tables = {
        "pooled": _pooled(scores),
        "scores": scores,
        "groups": by_group,
        "differences": _differences(config, by_group) if len(config.seeds) > 1 else [],
        "above": _above_demonstrators(config, by_group) if len(config.seeds) > 1 else [],
        "choices": list(_choices(jobs, work)),
        "angles": list(_angles(jobs, work)),
        "curves": curves(jobs, work, _OF_CURVES),
        "times": times(jobs, work),
    }
    return Findings(tables, _summary(tables))


def _scores(config: Config, work: Path) -> Iterator[Row]:
    """Give a row for each method, training seed and angle; references not trained have no seed."""
    for method in (*config.methods, *config.references):
        trained = method in config.trained
        for seed in config.seeds if trained else ("",):
            name = f"{FOLDERS[method]}/{seed}" if trained else FOLDERS[method]
            for angle in config.angles:
                driven = load(work / "evaluation" / name, angle)
                label = {"method": method, "seed": seed, "angle": angle}
                label["demonstrated"] = int(angle in MODES.values())
                yield label | score_row(driven, angle, config)


def score_row(driven: ScoredEpisodes, angle: float, config: Config) -> Row:
    """Return means over episodes, and the score's bootstrap interval."""
    scores = driven.score(angle, config.weight)
    low, high = interval(scores)
    return {
        "score": float(scores.mean()),
        "score_low": low,
        "score_high": high,
        "told": float(driven.reward(angle).mean()),
        "skill": float(driven.skill().mean()),
        "r_env": float(driven.env.mean()),
        "r_social": float(driven.social.mean()),
        "changes": float(driven.changes.mean()),
        "standing": float(driven.standing.mean()),
        **{name: float((driven.ending == kind).mean()) for name, kind in OUTCOMES.items()},
        "length": float(driven.length.mean()),
        "episodes": len(scores),
    }


def interval(values: Float[np.ndarray, " episode"]) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of the mean over episodes."""
    drawn = resample_rows(len(values), _RESAMPLES, _BOOTSTRAP_SEED)
    means = np.concatenate([values[rows].mean(axis=1) for rows in drawn])
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def _means(rows: Sequence[Row]) -> Row:
    return {name: mean(rows, name) for name in _MEASURED}


def _pooled(scores: Sequence[Row]) -> list[Row]:
    """Return each method at each angle: means over training seeds, and spread of the score."""
    found: list[Row] = []
    for (method, angle), rows in groups(scores, "method", "angle").items():
        values = [row["score"] for row in rows]
        found.append(
            {"method": method, "angle": angle, "demonstrated": rows[0]["demonstrated"]}
            | _means(rows)
            | {"score_sd": float(np.std(values, ddof=1)) if len(values) > 1 else ""}
            | {"score_least": min(values), "score_most": max(values), "seeds": len(values)}
        )
    return found


def _by_group(scores: Sequence[Row]) -> list[Row]:
    """Return each method and seed: means over each group of angles that has any."""
    found: list[Row] = []
    for (method, seed), mine in groups(scores, "method", "seed").items():
        for group, demonstrated in GROUPS.items():
            rows = [row for row in mine if row["demonstrated"] in demonstrated]
            if rows:
                found.append({"method": method, "seed": seed, "angles": group} | _means(rows))
    return found


def _differences(config: Config, by_group: Sequence[Row]) -> list[Row]:
    """Test each method's score against RL alone, paired over training seeds, Holm over all rows."""
    found: list[Row] = []
    for method in (one for one in config.trained if one != ALONE):
        for group in GROUPS:
            scores, alone = (
                [row["score"] for row in matching(by_group, method=name, angles=group)]
                for name in (method, ALONE)
            )
            if scores and alone:
                found.append(paired_row({"method": method, "angles": group}, scores, alone))
    return with_holm(found)


def _above_demonstrators(config: Config, by_group: Sequence[Row]) -> list[Row]:
    """Test each method's score against the demonstrators', which no seed changes; Holm as above."""
    found: list[Row] = []
    for method in config.methods:
        for group in GROUPS:
            scores, theirs = (
                [row["score"] for row in matching(by_group, method=name, angles=group)]
                for name in (method, EXPERTS)
            )
            if scores:
                same = theirs * len(scores)
                found.append(paired_row({"method": method, "angles": group}, scores, same))
    return with_holm(found)


def _choices(jobs: Sequence[Job], work: Path) -> Iterator[Row]:
    """Give the share of each demonstrator's actions that are predicted without it, by η."""
    chosen = [job for job in jobs if job.stage == "choice"]
    for job in (one for one in jobs if one.stage == "left-out"):
        price = read_json(work / chosen[0].name / CHOICE)["price"]
        for row in read_json(work / job.name / LEFT_OUT):
            label = {"left_out": job.name.split("/")[1]}
            yield label | row | {"chosen": int(row["price"] == price)}


def _angles(jobs: Sequence[Job], work: Path) -> Iterator[Row]:
    """Give the demonstrators' angles by training seed, inferred with RL alone and with its dial."""
    for job in jobs:
        if job.stage == "angles":
            _, step, seed = job.name.split("/")
            for row in read_json(work / job.name / ANGLES):
                kept = {key: row[key] for key in ("mode", "true_angle", "angle")}
                yield {"step": int(step), "seed": int(seed)} | kept


def _summary(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return means over training seeds by group of angles and by angle, tests and angles."""
    methods: dict[str, Any] = {}
    for (method, group), rows in groups(tables["groups"], "method", "angles").items():
        methods.setdefault(method, {})[group] = _means(rows)
    found = {
        "methods": methods,
        "by_angle": _nested(tables["pooled"], "method", "angle"),
        "differences": _nested(tables["differences"], "method", "angles"),
        "above": _nested(tables["above"], "method", "angles"),
    }
    last = max((row["step"] for row in tables["angles"]), default=None)
    for row in tables["angles"]:
        if row["step"] in (0, last):
            by_mode = found.setdefault("inferred_angles", {}).setdefault(row["mode"], {})
            by_mode.setdefault(str(row["step"]), []).append(row["angle"])
    return found


def _nested(rows: Sequence[Row], *keys: str) -> dict[str, Any]:
    """Return whole rows as nested mappings by the values of their keys."""
    return nested(rows, *keys, keep=list(rows[0])) if rows else {}


STUDY = Study(
    name="intersection-skill",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of("pooled"),
)
