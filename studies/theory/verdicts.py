"""Counts of predictions: hits, misses and their errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.types import Row
from socialiq_lab.tables import column, groups, matching, mean

CLOSE = 0.15
"""Largest relative error of a hit."""

_PREDICTIONS = ("occupancy", "rows", "solved", "replay")


def hit(row: Row) -> bool:
    """Whether a flip was predicted and found, within 15 % of the λ found."""
    return "" not in (row["predicted"], row["found"]) and _error(row) <= CLOSE


def _error(row: Row) -> float:
    return abs(row["predicted"] / row["found"] - 1.0) if row["found"] != "" else float("inf")


def flip_counts(rows: list[Row], next_value: str) -> dict[str, Any]:
    """Return hits and misses of a gradient, over all states and over each case's earliest flip.

    Ties in the data, which flip at λ = 0, are counted separately.
    """
    rows = matching(rows, next_value=next_value)
    flips = [row for row in rows if not row["tie"]]
    predicted = [row for row in flips if row["predicted"] != ""]
    unpredicted = matching(flips, predicted="")
    within = [row for row in predicted if row["within_reach"]]
    firsts = earliest(flips)
    grid = [row for row in firsts if not row["world"].startswith("random")]
    return {
        "states": len(flips),
        "predicted": len(predicted),
        "hits": sum(map(hit, predicted)),
        "not_found": len(matching(predicted, found="")),
        "found_unpredicted": sum(row["found"] != "" for row in unpredicted),
        "neither": len(matching(unpredicted, found="")),
        "within_reach": len(within),
        "within_reach_hits": sum(map(hit, within)),
        "first": len(firsts),
        "first_hits": sum(map(hit, firsts)),
        "first_in_grids": len(grid),
        "first_in_grids_hits": sum(map(hit, grid)),
        "first_in_grids_worst": max((_error(row) for row in grid), default=0.0),
        "ties": sum(column(rows, "tie")),
    }


def earliest(rows: list[Row]) -> list[Row]:
    """Return the first flip of each case: the least λ predicted, with the least found."""
    firsts = []
    for group in groups(rows, "next_value", "world", "angle", "target_kind").values():
        predicted = [row for row in group if row["predicted"] != ""]
        found = [row["found"] for row in group if row["found"] != ""]
        if predicted:
            first = min(predicted, key=lambda row: row["predicted"])
            firsts.append(first | {"found": min(found, default="")})
    return firsts


def growth(rows: list[Row]) -> dict[str, Any]:
    """Return lengths along λ by temperature, target and angle, and whether they never fall."""
    summary: dict[str, Any] = {}
    keys = ("temperature", "target_kind", "angle")
    for (temperature, kind, angle), path in groups(rows, *keys).items():
        soft = column(path, "soft_length")
        by_angle = summary.setdefault(f"{temperature:g}", {}).setdefault(kind, {})
        by_angle[f"{angle:g}"] = {
            "optimum": path[0]["optimum_length"],
            "soft": soft,
            "greedy": column(path, "greedy_length"),
            "soft_grows": bool((np.diff(soft) >= -1e-6).all()),
            "first": soft[0],
            "last": soft[-1],
        }
    return summary


def trained_summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Return predicted λ, and the seeds' first λ of the grid, by gradient and target."""
    summary: dict[str, Any] = {}
    for predicted in tables["predicted"]:
        key = {name: predicted[name] for name in ("next_value", "target_kind")}
        seeds = matching(tables["first_flips"], **key)
        if not seeds:
            continue
        firsts = sorted(row["first"] for row in seeds if row["first"] != "")
        median = firsts[len(seeds) // 2] if len(firsts) == len(seeds) else None
        runs = matching(tables["trained"], **key)
        summary.setdefault(predicted["next_value"], {})[predicted["target_kind"]] = {
            name: predicted[name] for name in ("norm", *_PREDICTIONS)
        } | {
            "seeds": len(seeds),
            "left": len(firsts),
            "least": firsts[0] if firsts else None,
            "median": median,
            "greatest": firsts[-1] if firsts else None,
            "bracketed": {
                name: sum(_bracketed(row, predicted[name]) for row in seeds)
                for name in _PREDICTIONS
            },
            "median_over_replay": None if median is None else median / predicted["replay"],
            "median_over_solved": None if median is None else median / predicted["solved"],
            "zero_leaves": sum(column(seeds, "zero_leaves")),
            "zero_from_baseline": _zero_gap(runs),
            "lengths": _lengths(runs),
        }
    return summary


def _bracketed(row: Row, strength: float) -> bool:
    """Whether λ is between the grid's last value with the baseline's choices and the next."""
    return row["first"] != "" and row["below"] != "" and row["below"] < strength <= row["first"]


def _zero_gap(rows: list[Row]) -> float:
    """Return the mean over seeds of |Δ| of the mean probability of going, λ = 0 less baseline."""
    gaps = []
    for seed in {row["seed"] for row in rows}:
        runs = matching(rows, seed=seed, strength=0.0)
        zero = next(row for row in runs if row["prior_weight"] > 0.0)
        baseline = next(row for row in rows if (row["seed"], row["prior_weight"]) == (seed, 0.0))
        gaps.append(abs(zero["mean_go"] - baseline["mean_go"]))
    return float(np.mean(gaps))


def _lengths(rows: list[Row]) -> dict[str, Any]:
    """Return mean soft and greedy length by λ."""
    runs = [row for row in rows if row["prior_weight"] > 0.0]
    strengths = sorted(set(column(runs, "strength")))
    return {"strength": strengths} | {
        readout: [
            mean(matching(runs, strength=strength), f"{readout}_length") for strength in strengths
        ]
        for readout in ("soft", "greedy")
    }
