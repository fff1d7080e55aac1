"""Tables of the comparison: the choice of settings, means over seeds, what each method is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from socialiq.types import Row
from socialiq_lab import comparison
from socialiq_lab.tables import column, groups, matching, mean, paired_row, with_holm
from studies.compare_methods.methods import BY_NAME, TOLD

KEYS = ("world", "method", "setting", "target_angle", "readout")

Chosen = Mapping[tuple[str, str], str]
"""Name of the setting by world and method."""

READOUT = "greedy"
"""Action selection by which settings are chosen and methods compared."""


def choose(rows: Sequence[Row]) -> dict[tuple[str, str], str]:
    """Return, for each world and method, the setting with the greatest mean J(α).

    The mean is over angles and seeds, of greedy policies; J*(α) is the same for all settings, so
    this is also the least mean regret. Of equal ones the first of the grid is chosen.
    """
    chosen: dict[tuple[str, str], str] = {}
    for (world, method), group in groups(
        matching(rows, readout=READOUT), "world", "method"
    ).items():
        values = {
            name: round(mean(of_setting, "value"), 9)
            for (name,), of_setting in groups(group, "setting").items()
        }
        chosen[world, method] = max(values, key=values.__getitem__)
    return chosen


def means(rows: Sequence[Row]) -> list[Row]:
    """Return means over seeds (`comparison.means`)."""
    return comparison.means(rows, KEYS)


def overall(pooled: Sequence[Row], speeds: Sequence[Row]) -> list[Row]:
    """Return a row for each method: regret over all angles, steering, endings, what it is told.

    `steering` is α̂ at the largest target angle less α̂ at the smallest, in degrees; `r_social_gain`
    is that difference of r_social. Collisions and arrivals are means over the angles.

    Args:
        pooled: Rows of `means`.
        speeds: Updates per second of each world and method, and the device.
    """
    keys = ("world", "method", "setting", "readout")
    measured = {(row["world"], row["method"]): row for row in speeds}
    rows = []
    whole = comparison.overall(pooled, keys)
    for row, group in zip(whole, groups(pooled, *keys).values(), strict=True):
        ends = sorted(group, key=lambda one: one["target_angle"])
        steering = ends[-1]["angle"] - ends[0]["angle"]
        told = BY_NAME[row["method"]].told
        speed = measured.get((row["world"], row["method"]), {})
        rows.append(
            row
            | {"steering": steering}
            | {"r_social_gain": ends[-1]["r_social"] - ends[0]["r_social"]}
            | {"collision": mean(group, "collision"), "arrival": mean(group, "arrival")}
            | {name: int(name in told) for name in TOLD}
            | {name: speed.get(name, "") for name in ("updates_per_second", "device")}
        )
    return rows


def paired(policies: Sequence[Row]) -> list[Row]:
    """Return paired tests of each method's mean J(α) over angles against the best method's.

    Pairs are training seeds, which share their data sets; Holm's adjustment is over all rows of a
    world. The best method is that of the greatest mean.
    """
    rows: list[Row] = []
    for (world,), group in groups(matching(policies, readout=READOUT), "world").items():
        scores = {
            method: [mean(of_seed, "value") for of_seed in groups(own, "seed").values()]
            for (method,), own in groups(group, "method").items()
        }
        best = max(scores, key=lambda name: sum(scores[name]))
        if len(scores[best]) < 2:
            continue
        tests = [
            paired_row({"world": world, "best": best, "method": name}, scores[best], own)
            for name, own in scores.items()
            if name != best
        ]
        rows += with_holm(tests)
    return rows


def summarise(whole: Sequence[Row]) -> dict[str, Any]:
    """Return mean and worst regret, J(α), steering and setting by world and method."""
    names = ("setting", "value", "regret", "worst_regret", "steering", "collision", "arrival")
    summary: dict[str, Any] = {}
    for row in matching(whole, readout=READOUT):
        summary.setdefault(row["world"], {})[row["method"]] = {name: row[name] for name in names}
    return summary


def told(row: Row) -> str:
    """Return what a method is told, in one cell."""
    return ", ".join(name for name in TOLD if row[name]) or "nothing"


def in_order(rows: Sequence[Row]) -> list[Row]:
    """Return rows of one world by their regret, or by falling J(α) where it is unknown."""
    known = "" not in column(rows, "regret")
    return sorted(rows, key=lambda row: row["regret"] if known else -row["value"])
