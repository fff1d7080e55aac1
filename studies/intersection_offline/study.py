"""Offline learning in the intersection: demonstrations and their reward pairs, no step in a world.

One offline dial beside the demonstrators, clones and IQ-Learn, all with the network that reads the
vehicles as a set, from the same mixtures, on the same episodes. IQ-Learn is also trained online.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.evaluation.episodes import policy_row
from socialiq.evaluation.rollout import MODES
from socialiq.plotting.style import band, figure, finish
from socialiq.results_folder import Results
from socialiq.social.angle import exact_weights
from socialiq.types import Row
from socialiq_lab.intersection.driving import angle_file, load_episodes
from socialiq_lab.intersection.offline_training import run_file
from socialiq_lab.intersection.rows import times
from socialiq_lab.study import Context, Findings, Study, view_of
from socialiq_lab.tables import groups, matching, paired_row, spread, with_holm
from studies.intersection_offline.plan import (
    Config,
    demonstrator_episodes,
    dial_episodes,
    method_episodes,
    plan,
)

OWN = "offline dial"
DEMONSTRATOR = "demonstrator"
KEPT = "dial.safetensors"
"""File of the first seed's dial beside the tables."""
_GREEDY = "greedy.safetensors"


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the dial of the first seed."""
    policies = _policies(config, context.work)
    trained = [job for job in context.jobs if job.stage in ("dials", "learners")]
    tables = {
        "policies": policies,
        "angles": _by_angle(policies),
        **compared(config, policies),
        "times": times(trained, context.work),
    }
    first = config.seeds[0]
    dial = (context.work / f"dials/{first}" / run_file(first)).read_bytes()
    return Findings(tables, summarised(tables), {KEPT: dial})


def compared(config: Config, policies: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the tests between methods that the table of policies allows."""
    return {"differences": _differences(config, policies), "forms": _forms(config, policies)}


def _policies(config: Config, work: Path) -> list[Row]:
    """Return metrics of each policy, and J(α) at each angle that it is made for.

    A demonstrator is made for no angle and valued at all; it has no training seed.
    """
    rows: list[Row] = []

    def add(method: str, seed: int | str, angle: float, file: Path) -> None:
        row = policy_row(method, "greedy", load_episodes(file))
        direction = exact_weights(angle)
        value = direction.env * row["r_env"] + direction.social * row["r_social"]
        metrics = {name: row[name] for name in row if name not in ("policy", "readout")}
        rows.append({"method": method, "seed": seed, "asked": angle, "value": value} | metrics)

    for angle in config.angles:
        for mode in MODES:
            file = work / demonstrator_episodes(mode) / _GREEDY
            add(f"{DEMONSTRATOR} {mode}", "", angle, file)
        for seed in config.seeds:
            add(OWN, seed, angle, work / dial_episodes(seed) / angle_file(angle))
            for method in config.methods if angle in config.method_angles else ():
                trained = config.method_angles[0] if method == "clone of all" else angle
                add(method, seed, angle, work / method_episodes(method, seed, trained) / _GREEDY)
    return rows


def _by_angle(policies: Sequence[Row]) -> list[Row]:
    """Return mean, least and largest J(α) of each method at each angle, and mean outcomes."""
    pooled: list[Row] = []
    for (method, angle), rows in groups(policies, "method", "asked").items():
        value = spread(rows, "value")
        outcomes = {
            name: float(np.mean([row[name] for row in rows]))
            for name in ("r_env", "r_social", "arrival", "collision", "timeout")
        }
        label = {"method": method, "asked": angle, "seeds": len(rows)}
        pooled.append(label | {"value": value["mean"]} | {k: value[k] for k in ("low", "high")})
        pooled[-1] |= outcomes
    return pooled


def _differences(config: Config, policies: Sequence[Row]) -> list[Row]:
    """Test the dial against the best demonstrator at each angle and against every method.

    Paired over training seeds; a demonstrator is the same for all. p is adjusted by Holm, over the
    demonstrators of all angles, and over the methods of all angles.
    """
    shown_best: list[Row] = []
    tests: list[Row] = []
    for angle in config.angles if len(config.seeds) > 1 else ():
        here = matching(policies, asked=angle)
        own_values = [row["value"] for row in matching(here, method=OWN)]
        demonstrators = [row for row in here if row["method"].startswith(DEMONSTRATOR)]
        best = max(demonstrators, key=lambda row: row["value"])
        label = {"asked": angle, "other": best["method"]}
        shown_best.append(paired_row(label, own_values, [best["value"]] * len(own_values)))
        for method in config.methods if angle in config.method_angles else ():
            values = [row["value"] for row in matching(here, method=method)]
            tests.append(paired_row({"asked": angle, "other": method}, own_values, values))
    return with_holm(shown_best) + with_holm(tests)


def _forms(config: Config, policies: Sequence[Row]) -> list[Row]:
    """Test each form of IQ-Learn against each weighted clone, paired over training seeds."""
    forms = [method for method in config.methods if method.startswith("IQ-Learn")]
    clones = [method for method in config.methods if method.startswith("clone weighted")]
    tests: list[Row] = []
    for angle in config.method_angles if len(config.seeds) > 1 else ():
        here = matching(policies, asked=angle)
        for form in forms:
            form_values = [row["value"] for row in matching(here, method=form)]
            for clone in clones:
                values = [row["value"] for row in matching(here, method=clone)]
                tests.append(
                    paired_row({"asked": angle, "form": form, "other": clone}, form_values, values)
                )
    return with_holm(tests)


def summarised(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return what is above, level or below.

    The dial beside the best demonstrator at each angle, and each form of IQ-Learn beside each
    weighted clone.
    """
    dial = {
        f"{row['asked']:g}": verdict(row)
        for row in tables["differences"]
        if row["other"].startswith(DEMONSTRATOR)
    }
    forms: dict[str, dict[str, dict[str, str]]] = {}
    for row in tables["forms"]:
        beside = forms.setdefault(row["form"], {}).setdefault(row["other"], {})
        beside[f"{row['asked']:g}"] = verdict(row)
    return {"against_best_demonstrator": dial, "iq_learn_against_clones": forms}


def verdict(row: Row) -> str:
    """Return "above", "level" or "below".

    "above" takes an adjusted p-value below 0.05, "below" an unadjusted one: adjusted for many
    tests, a loss would soon be called level.
    """
    if row["mean"] > 0:
        return "above" if row["p_holm"] < 0.05 else "level"
    return "below" if row["p"] < 0.05 else "level"


_COLORS = (
    "#c23b22",
    "#6e6e6e",
    "#a6a6a6",
    "#1b7837",
    "#7fbf7b",
    "#2166ac",
    "#92c5de",
    "#762a83",
    "#c2a5cf",
)


def draw(results: Results) -> dict[str, Figure]:
    """Draw J(α) of every method, above that of the best demonstrator."""
    picture = figure(7.5, 4.4)
    axes = picture.subplots()
    rows = results.tables["policies"]
    best = {
        angle: max(r["value"] for r in group if r["method"].startswith(DEMONSTRATOR))
        for (angle,), group in groups(rows, "asked").items()
    }
    above = [row | {"above": row["value"] - best[row["asked"]]} for row in rows]
    names = dict.fromkeys(row["method"] for row in above if row["seed"] != "")
    for color, name in zip(_COLORS, names, strict=False):
        style = {"color": color, "marker": "o", "label": name}
        band(axes, matching(above, method=name), "asked", "above", **style)
    axes.axhline(0.0, color="black", linewidth=0.8)
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "J(α) above the best demonstrator"}
    finish(axes, "Mean over seeds, band from least to largest", 9, **labels)
    return {"values": picture}


STUDY = Study(
    name="intersection-offline",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "angles",
        "method",
        "asked",
        "value",
        "low",
        "high",
        "arrival",
        "collision",
        title="J(α) at the angle asked for, mean and range over training seeds",
    ),
)
