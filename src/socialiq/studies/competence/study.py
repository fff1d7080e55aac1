"""Do demonstrations add anything beyond reinforcement learning on the hand-written reward?

All experts of the 7x7 world also drive comfortably: they shun changes of speed by two levels, which
neither r_env nor r_social speaks of. Each method gets the experts' demonstrations for 0, 45 and 90
degrees and the reward pair, and is scored on R(α) plus the comfort that it was never told of, also
at angles that nobody demonstrated. All methods are solved exactly, so only the data are random.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.study import Context, Findings, counter
from socialiq.experiments.tables import groups, matching, mean
from socialiq.learners.shared_reward.angles import Inferred
from socialiq.studies.competence.bench import Bench, Config
from socialiq.studies.competence.methods import Told
from socialiq.types import Row


def compute_tables(config: Config, context: Context) -> Findings:
    """Fit every method to every data set, evaluate exactly, and compute_tables."""
    count = counter(context.on_stage, "data sets", len(config.seeds), "data sets")
    bench = Bench.of(config)
    rows = list(bench.without_data())
    angles: list[Row] = []
    for number, seed in enumerate(config.seeds, start=1):
        told = Told.of(bench, seed)
        rows += told.imitation()
        rows += told.priors()
        rows += told.shared()
        more, inferred = told.inferred()
        rows += more
        angles += _angle_rows(seed, inferred)
        count(number)
    tables = {"scores": rows, "pooled": _pooled(rows), "angles": angles}
    return Findings(tables, _summary(tables))


def _angle_rows(seed: int, inferred: Inferred) -> list[Row]:
    return [
        {"seed": seed, "mode": mode, "true_angle": angle, "round": number, "mean": float(mean)}
        for number, means in enumerate(inferred.path)
        for (mode, angle), mean in zip(MODES.items(), means, strict=True)
    ]


def _pooled(rows: Sequence[Row]) -> list[Row]:
    """Mean score over seeds by method, strength and readout: all, demonstrated, unseen angles."""
    found = []
    for (method, strength, readout), group in groups(rows, "method", "strength", "readout").items():
        kinds = {
            "all": group,
            "demonstrated": [row for row in group if row["demonstrated"]],
            "unseen": [row for row in group if not row["demonstrated"]],
        }
        found.append(
            {"method": method, "strength": strength, "readout": readout}
            | {f"score_{kind}": mean(some, "score") for kind, some in kinds.items()}
            | {"score_worst": min(row["score"] for row in group)}
            | {"skill_all": mean(group, "skill")}
        )
    return found


def best_strengths(pooled: Sequence[Row]) -> dict[str, Any]:
    """For each method the strength with the best greedy score over all angles, in hindsight."""
    best: dict[str, Row] = {}
    for row in pooled:
        if row["readout"] == "greedy":
            leader = best.setdefault(row["method"], row)
            if row["score_all"] > leader["score_all"]:
                best[row["method"]] = row
    return {method: row["strength"] for method, row in best.items()}


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Pooled scores by method (with its strength) and readout, and the inferred angles."""
    found: dict[str, Any] = {}
    for row in tables["pooled"]:
        name = row["method"] + (f", λ {row['strength']:g}" if row["strength"] != "" else "")
        entry = {key: value for key, value in row.items() if key.startswith(("score", "skill"))}
        found.setdefault(name, {})[row["readout"]] = entry
    last = max(row["round"] for row in tables["angles"])
    angles = {
        mode: mean(matching(tables["angles"], mode=mode, round=last), "mean") for mode in MODES
    }
    return {"methods": found, "inferred_angles": angles}
