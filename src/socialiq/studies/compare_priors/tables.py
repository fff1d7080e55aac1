"""Tables of the comparison: the choice of λ, means over seeds, and angle error against regret."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from socialiq.evaluation.metrics import Metrics, mean_of
from socialiq.experiments.tables import column, groups, mean, spread, with_holm
from socialiq.social.angle import angle_difference
from socialiq.types import Row

KEYS = ("world", "method", "strength", "target_angle", "readout")

Chosen = Mapping[tuple[str, str], float]
"""λ by world and method."""

_LEVEL = 0.05


def choose(rows: Sequence[Row]) -> dict[tuple[str, str], float]:
    """Return, for each world and method, the λ with the greatest mean J(α).

    The mean is over angles, seeds and action selections; J*(α) is the same for all λ, so this is
    also the least mean regret. Of equal ones the smaller λ is chosen.
    """
    chosen: dict[tuple[str, str], float] = {}
    for (world, method), group in groups(rows, "world", "method").items():
        values = {
            float(strength): round(mean(of_strength, "value"), 9)
            for (strength,), of_strength in groups(group, "strength").items()
        }
        chosen[world, method] = max(sorted(values), key=values.__getitem__)
    return chosen


def means(rows: Sequence[Row]) -> list[Row]:
    """Return means over seeds; α̂ is that of the mean totals, low and high are of single seeds."""
    pooled: list[Row] = []
    for values, group in groups(rows, *KEYS).items():
        metrics = mean_of([Metrics(*(row[name] for name in Metrics._fields)) for row in group])
        pooled.append(
            dict(zip(KEYS, values, strict=True))
            | {"seeds": len(group)}
            | metrics._asdict()
            | _spread(group, "value")
            | _spread(group, "regret")
            | {"effective_share": _mean(group, "effective_share")}
        )
    return pooled


def overall(pooled: Sequence[Row]) -> list[Row]:
    """Return mean J(α), mean regret and worst regret of each method over all target angles.

    Regrets are empty where the optimum is unknown.
    """
    keys = ("world", "method", "strength", "readout")
    return [
        dict(zip(keys, values, strict=True))
        | {"angles": len(group), "value": _mean(group, "value"), "regret": _mean(group, "regret")}
        | {"worst_regret": "" if group[0]["regret"] == "" else max(column(group, "regret"))}
        for values, group in groups(pooled, *keys).items()
    ]


def _spread(group: Sequence[Row], name: str) -> Row:
    if any(row[name] == "" for row in group):
        return {name: "", f"{name}_low": "", f"{name}_high": ""}
    ends = spread(group, name)
    return {name: ends["mean"], f"{name}_low": ends["low"], f"{name}_high": ends["high"]}


def _mean(group: Sequence[Row], name: str) -> float | str:
    return "" if group[0][name] == "" else mean(group, name)


def summarise(pooled: Sequence[Row]) -> dict[str, Any]:
    """Return λ, α̂, arrival and value by world, method, action selection and target angle."""
    summary: dict[str, Any] = {}
    for row in pooled:
        method = summary.setdefault(row["world"], {}).setdefault(row["method"], {})
        method["strength"] = row["strength"]
        entry = method.setdefault(row["readout"], {})
        names = ("value", "regret", "regret_low", "regret_high", "angle", "arrival")
        entry[f"{row['target_angle']:g}"] = {name: row[name] for name in names}
    return summary


def alignment(policies: Sequence[Row]) -> list[Row]:
    """Return the rank correlation of |α̂ - α| and regret by world, action selection and angle.

    Each policy of each method and seed is a point. The p-value of Spearman's ρ is two-sided,
    adjusted by Holm over all rows. Each row also has the angle error of the policy of least
    regret, and the regret of the policy of least angle error.

    Args:
        policies: Rows with a target angle, an empirical angle and a regret; those without a known
            optimum are left out.
    """
    from scipy.stats import spearmanr

    keys = ("world", "readout", "target_angle")
    rows: list[Row] = []
    for values, group in groups([row for row in policies if row["regret"] != ""], *keys).items():
        errors = [abs(angle_difference(row["angle"], row["target_angle"])) for row in group]
        error, regret = np.array(errors), np.array(column(group, "regret"))
        if len(group) < 3 or np.ptp(error) == 0 or np.ptp(regret) == 0:
            continue  # ranks need a difference
        test: Any = spearmanr(error, regret)
        rows.append(
            dict(zip(keys, values, strict=True))
            | {"policies": len(group), "spearman": float(test.statistic)}
            | {"p": float(test.pvalue)}
            | {"error_at_least_regret": float(error[regret.argmin()])}
            | {"regret_at_least_error": float(regret[error.argmin()])}
            | {"least_regret": float(regret.min())}
        )
    return with_holm(rows)


def alignment_counts(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the numbers of groups with a positive, a negative and no significant correlation."""
    sure = [row for row in rows if row["p_holm"] < _LEVEL]
    return {
        "groups": len(rows),
        "alike": sum(row["spearman"] > 0 for row in sure),
        "against": sum(row["spearman"] < 0 for row in sure),
        "neither": len(rows) - len(sure),
        "least_error_has_least_regret": sum(
            row["regret_at_least_error"] <= row["least_regret"] + 1e-9 for row in rows
        ),
    }
