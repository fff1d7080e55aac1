"""Rank correlation of angle error and regret over all trained policies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq.experiments.tables import with_holm
from socialiq.social.angle import angle_difference
from socialiq.types import Row

_GROUP = ("world", "readout", "target_angle")
_LEVEL = 0.05


def alignment(policies: Sequence[Row]) -> list[Row]:
    """For each world, readout and target angle, how |α̂ - α| goes with the regret.

    Each policy of each method and seed is one point. Spearman's ρ is of ranks; its p-value is of no
    association, two-sided, adjusted by Holm over all rows. Beside it stand the angle error of
    the policy of least regret, and the regret of the policy of least angle error.

    Args:
        policies: Rows with a target angle, the angle shown, and a regret; those of a world without
            a known optimum are left out.
    """
    from scipy.stats import spearmanr

    groups: dict[tuple, list[tuple[float, float]]] = {}
    for row in policies:
        if row["regret"] != "":
            error = abs(angle_difference(row["angle"], row["target_angle"]))
            key = tuple(row[name] for name in _GROUP)
            groups.setdefault(key, []).append((error, row["regret"]))
    rows: list[Row] = []
    for key, points in groups.items():
        error, regret = np.array(points).T
        if len(points) < 3 or np.ptp(error) == 0 or np.ptp(regret) == 0:
            continue  # nothing to rank
        found: Any = spearmanr(error, regret)
        rows.append(
            dict(zip(_GROUP, key, strict=True))
            | {"policies": len(points), "spearman": float(found.statistic)}
            | {"p": float(found.pvalue)}
            | {"error_at_least_regret": float(error[regret.argmin()])}
            | {"regret_at_least_error": float(regret[error.argmin()])}
            | {"least_regret": float(regret.min())}
        )
    return with_holm(rows)


def counts(rows: Sequence[Row]) -> dict[str, Any]:
    """Numbers of groups that rank alike, against one another, or neither."""
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
