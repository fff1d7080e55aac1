"""Tables of the comparison: the choice of λ, means over seeds, and angle error against regret."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from socialiq.social.angle import angle_difference
from socialiq.types import Row
from socialiq_lab import comparison
from socialiq_lab.tables import column, groups, mean, with_holm

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
    """Return means over seeds (`comparison.means`)."""
    return comparison.means(rows, KEYS, ("effective_share",))


def overall(pooled: Sequence[Row]) -> list[Row]:
    """Return means over all target angles (`comparison.overall`)."""
    return comparison.overall(pooled, ("world", "method", "strength", "readout"))


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
