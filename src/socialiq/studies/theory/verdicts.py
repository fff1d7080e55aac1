"""Predictions counted: what was hit, what was missed, and by how much."""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.types import Row

CLOSE = 0.15
"""The relative error that counts as a hit."""


def hit(row: Row) -> bool:
    """Whether a flip was predicted and found, within 15 % of the λ found."""
    if row["predicted"] == "" or row["found"] == "":
        return False
    return abs(row["predicted"] / row["found"] - 1.0) <= CLOSE


def flip_counts(rows: list[Row], next_value: str) -> dict[str, Any]:
    """Hits and misses of one gradient, over all states and over the earliest flip of each case.

    Ties in the data, which flip at λ = 0, are counted apart.
    """
    here = [row for row in rows if row["next_value"] == next_value and not row["tie"]]
    told = [row for row in here if row["predicted"] != ""]
    within = [row for row in told if row["within_reach"]]
    firsts = earliest(here)
    grid = [row for row in firsts if not row["world"].startswith("random")]
    return {
        "states": len(here),
        "predicted": len(told),
        "hits": sum(map(hit, told)),
        "not_found": sum(row["found"] == "" for row in told),
        "found_unpredicted": sum(row["predicted"] == "" and row["found"] != "" for row in here),
        "neither": sum(row["predicted"] == "" and row["found"] == "" for row in here),
        "within_reach": len(within),
        "within_reach_hits": sum(map(hit, within)),
        "first": len(firsts),
        "first_hits": sum(map(hit, firsts)),
        "first_in_grids": len(grid),
        "first_in_grids_hits": sum(map(hit, grid)),
        "first_in_grids_worst": max((_error(row) for row in grid), default=0.0),
        "ties": sum(row["tie"] for row in rows if row["next_value"] == next_value),
    }


def earliest(rows: list[Row]) -> list[Row]:
    """The first flip of each case: the least λ predicted, beside the least found."""
    groups: dict[tuple, list[Row]] = {}
    for row in rows:
        key = (row["next_value"], row["world"], row["angle"], row["target_kind"])
        groups.setdefault(key, []).append(row)
    found = []
    for group in groups.values():
        told = [row for row in group if row["predicted"] != ""]
        seen = [row["found"] for row in group if row["found"] != ""]
        if told:
            first = min(told, key=lambda row: row["predicted"])
            found.append(first | {"found": min(seen, default="")})
    return found


def _error(row: Row) -> float:
    return abs(row["predicted"] / row["found"] - 1.0) if row["found"] != "" else float("inf")


def growth(rows: list[Row]) -> dict[str, Any]:
    """By temperature, target and angle: the lengths along λ, and whether they ever fall."""
    found: dict[str, Any] = {}
    for row in rows:
        by_kind = found.setdefault(f"{row['temperature']:g}", {})
        by_angle = by_kind.setdefault(row["target_kind"], {})
        entry = by_angle.setdefault(
            f"{row['angle']:g}", {"optimum": row["optimum_length"], "soft": [], "greedy": []}
        )
        entry["soft"].append(row["soft_length"])
        entry["greedy"].append(row["greedy_length"])
    for by_kind in found.values():
        for by_angle in by_kind.values():
            for entry in by_angle.values():
                entry["soft_grows"] = bool((np.diff(entry["soft"]) >= -1e-6).all())
                entry["first"], entry["last"] = entry["soft"][0], entry["soft"][-1]
    return found


def trained_summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """By gradient and target: the predicted λ, and the seeds' least λ of the grid that differed."""
    found: dict[str, Any] = {}
    for told in tables["predicted"]:
        key = (told["next_value"], told["target_kind"])
        seen = [r for r in tables["first_flips"] if (r["next_value"], r["target_kind"]) == key]
        if not seen:
            continue
        firsts = sorted(row["first"] for row in seen if row["first"] != "")
        here = [r for r in tables["trained"] if (r["next_value"], r["target_kind"]) == key]
        entry = {name: told[name] for name in ("norm", "occupancy", "rows", "solved", "replay")}
        entry |= {
            "seeds": len(seen),
            "left": len(firsts),
            "least": firsts[0] if firsts else None,
            "median": firsts[len(firsts) // 2] if len(firsts) == len(seen) else None,
            "greatest": firsts[-1] if firsts else None,
            "bracketed": {
                name: sum(_bracketed(row, told[name]) for row in seen)
                for name in ("occupancy", "rows", "solved", "replay")
            },
            "median_over_replay": _ratio(firsts, len(seen), told["replay"]),
            "median_over_solved": _ratio(firsts, len(seen), told["solved"]),
            "zero_leaves": sum(row["zero_leaves"] for row in seen),
            "zero_from_baseline": _zero_gap(here),
            "lengths": _lengths(here),
        }
        found.setdefault(key[0], {})[key[1]] = entry
    return found


def _bracketed(row: Row, strength: float) -> bool:
    """Whether a λ lies between the last of the grid with the baseline's choices and the next."""
    return row["first"] != "" and row["below"] != "" and row["below"] < strength <= row["first"]


def _ratio(firsts: list[float], seeds: int, strength: float) -> float | None:
    """The middle seed's λ over the predicted one; None where a seed never left."""
    return firsts[seeds // 2] / strength if len(firsts) == seeds else None


def _zero_gap(rows: list[Row]) -> float:
    """Mean over seeds of |Δ| of the mean probability of going, λ = 0 less the baseline."""
    gaps = []
    for seed in {row["seed"] for row in rows}:
        here = [row for row in rows if row["seed"] == seed]
        plain = next(row for row in here if row["prior_weight"] == 0.0)
        zero = next(row for row in here if row["prior_weight"] > 0.0 and row["strength"] == 0.0)
        gaps.append(abs(zero["mean_go"] - plain["mean_go"]))
    return float(np.mean(gaps))


def _lengths(rows: list[Row]) -> dict[str, Any]:
    """Mean soft and greedy length by λ."""
    strengths = sorted({row["strength"] for row in rows if row["prior_weight"] > 0.0})
    found: dict[str, Any] = {"strength": strengths}
    for readout in ("soft", "greedy"):
        found[readout] = [
            float(
                np.mean(
                    [
                        row[f"{readout}_length"]
                        for row in rows
                        if row["prior_weight"] > 0.0 and row["strength"] == strength
                    ]
                )
            )
            for strength in strengths
        ]
    return found
