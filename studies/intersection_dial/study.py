"""The dial in the intersection, beside agents trained for one angle each.

Dials and agents differ only in their range of angles and in their number of updates; a dial with a
clock and its ablations differ in what `config.ABLATIONS` names. All are evaluated on the
intersection study's seeds.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.evaluation.episodes import policy_row
from socialiq.evaluation.front import hypervolume
from socialiq.plotting.style import band, figure, finish, line
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq_lab.intersection.driving import DIAL, EPISODES, angle_file, load_episodes
from socialiq_lab.intersection.rows import curves, known_policies, times, value_at
from socialiq_lab.intersection.training import train_dial, train_dial_by_iteration
from socialiq_lab.study import Context, Findings, Study, view_of
from socialiq_lab.tables import groups, matching, numeric_means, paired_differences
from studies.intersection_dial.plan import (
    ABLATIONS,
    AGENTS,
    CALIBRATED,
    DIALS,
    FORESIGHT,
    ITERATED,
    PLANNED,
    SHORT,
    TIMED,
    Config,
    folder_of,
    plan,
)

_LOOKS = {
    DIALS: ("#2166ac", "o", "one dial"),
    AGENTS: ("#c23b22", "^", "an agent each"),
    TIMED: ("#1b7837", "s", "one dial with a clock"),
    CALIBRATED: ("#762a83", "D", "the same, with settings"),
    ITERATED: ("#d6604d", "P", "the same, improved by policy iteration"),
    PLANNED: ("#b8860b", "v", "the same, with online planning"),
}
_RATES = {"arrival": "#1b7837", "collision": "#c23b22", "timeout": "#6e6e6e"}


def _looks(results: Results) -> dict[str, tuple[str, str, str]]:
    """Return the looks of the families that there are; ablations have their tables alone."""
    there = {row["family"] for row in results.tables["policies"]}
    return {family: look for family, look in _LOOKS.items() if family in there}


def draw(results: Results) -> dict[str, Figure]:
    """Draw all figures of the study."""
    return {
        "tradeoff": _tradeoff(results),
        "regret": _regret(results),
        "turning": _turning(results),
        "learning": _learning(results),
    }


def _tradeoff(results: Results) -> Figure:
    """Draw mean totals of every policy; a dial's are joined in the order in which it turns."""
    picture = figure(7.5, 5.2)
    axes = picture.subplots()
    for family, (color, mark, label) in _looks(results).items():
        style: dict[str, Any] = {"linestyle": "none" if family == AGENTS else "-"}
        style |= {"marker": mark, "color": color, "linewidth": 0.6, "markersize": 5, "alpha": 0.6}
        for number, seed in enumerate(results.config["seeds"]):
            rows = matching(results.tables["policies"], family=family, seed=seed)
            if not rows:
                continue
            line_label = label if number == 0 else None
            line(axes, rows, "r_env", "r_social", **style, label=line_label)
    labels = {"xlabel": "mean total r_env of an episode"}
    labels["ylabel"] = "mean total r_social of an episode"
    finish(axes, "Turning from 0° (right) to 90° (left), all seeds", 9, **labels)
    return picture


def _regret(results: Results) -> Figure:
    """Draw regret against the best policy of all at each key angle."""
    picture = figure(7.0, 4.2)
    axes = picture.subplots()
    for family, (color, mark, label) in _looks(results).items():
        rows = matching(results.tables["policies"], family=family)
        band(axes, rows, "asked", "regret", color=color, marker=mark, label=label)
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "regret against the best of all"}
    finish(axes, "Mean over seeds, band from least to largest", 9, **labels)
    return picture


def _turning(results: Results) -> Figure:
    """Draw the endings of the dial's episodes at each angle."""
    picture = figure(7.0, 4.2)
    axes = picture.subplots()
    there = _looks(results)
    family = next(
        (candidate for candidate in (ITERATED, CALIBRATED, TIMED, DIALS) if candidate in there),
        AGENTS,
    )
    rows = matching(results.tables["policies"], family=family)
    for name, color in _RATES.items():
        band(axes, rows, "asked", name, 100.0, color=color, marker="o", label=name)
    title = "One dial, turned: mean over seeds, band from least to largest"
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "episodes, %"}
    finish(axes, title, 9, **labels, ylim=(0, 100))
    return picture


def _learning(results: Results) -> Figure:
    """Draw J(α) of each run while it trains: the mean over the angles of its checks."""
    picture = figure(8.0, 4.2)
    axes = picture.subplots()
    for (run,), rows in groups(results.tables["curves"], "run").items():
        family = run.partition("/")[0].replace("dials", DIALS)
        color, *_ = _LOOKS.get(family, ("#999999",))
        line(axes, rows, "updates", "total", color=color, linewidth=0.9, alpha=0.6)
    title = "Blue: dials. Red: agents, each at its own angle. Green: with a clock. Grey: ablations"
    finish(axes, title, xlabel="updates", ylabel="J(α): a dial's mean over 0°, 45°, 90°")
    return picture


_COMPARED = ((DIALS, AGENTS), (TIMED, DIALS), (CALIBRATED, TIMED), (PLANNED, TIMED))
_COMPARED += ((ITERATED, TIMED), (PLANNED, ITERATED))
_COMPARED += tuple((SHORT, ablation) for ablation in ABLATIONS if ablation != SHORT)
"""Pairs of families whose differences are tested, by training seed."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the dial of the first seed."""
    work = context.work
    known_rows = known_policies() if config.episodes == EPISODES else []
    driven = _policies(config, work, known_rows)
    policies = [row for row in driven if row["family"] != FORESIGHT]
    families = _families(config, policies)
    trained = [job for job in context.jobs if job.work in (train_dial, train_dial_by_iteration)]
    tables = {
        "policies": policies,
        "families": families,
        "differences": _differences(config, families),
        "known": _best_known(config, known_rows),
        "foresight": [row for row in driven if row["family"] == FORESIGHT],
        "curves": curves(trained, work, ("updates", "loss", "total")),
        "times": times(trained, work),
    }
    files = {
        f"{family}.safetensors": (work / folder_of(family, config.seeds[0]) / DIAL).read_bytes()
        for family in (DIALS, TIMED, CALIBRATED, ITERATED)
        if family in config.families
    }
    return Findings(tables, _summary(config, tables), files)


def _policies(config: Config, work: Path, known_rows: Sequence[Row]) -> list[Row]:
    """Return metrics of each policy, its J(α) at the requested angle, and its regrets there.

    The regret is against the best policy here, `known_regret` against the best of these and of all
    known ones, `others_regret` against the best of other families and of all known ones; the last
    one may be negative. A dial with foresight is no policy: it is not among the best.
    """
    rows: list[Row] = []
    for seed, family in itertools.product(config.seeds, config.families):
        for angle in config.angles_of(family) if seed in config.seeds_of(family) else ():
            name = folder_of(family, seed, angle)
            episodes = load_episodes(work / "evaluation" / name / angle_file(angle))
            row = {"family": family, "seed": seed, "asked": angle, "value": 0.0, "regret": 0.0}
            row |= policy_row(name, "greedy", episodes)
            rows.append({key: row[key] for key in row if key not in ("policy", "readout")})
    real = [row for row in rows if row["family"] != FORESIGHT]
    by_family = {family: matching(real, family=family) for family in config.families}
    best = {
        (angle, family): max((value_at(row, angle) for row in group), default=-np.inf)
        for angle in config.turned
        for family, group in by_family.items()
    }
    before = {
        angle: max(value_at(entry, angle) for entry in known_rows)
        for angle in config.turned
        if known_rows
    }
    for row in rows:
        angle, family = row["asked"], row["family"]
        row["value"] = value_at(row, angle)
        row["regret"] = max(best[angle, rival] for rival in by_family) - row["value"]
        if known_rows:
            rivals = (best[angle, rival] for rival in by_family if rival != family)
            row["known_regret"] = max(row["regret"], before[angle] - row["value"])
            row["others_regret"] = max(before[angle], *rivals) - row["value"]
    return rows


def _best_known(config: Config, known_rows: Sequence[Row]) -> list[Row]:
    """Return the best of the known policies at each key angle, without those of this study."""
    rows: list[Row] = []
    for angle in config.key_angles if known_rows else ():
        best = max(known_rows, key=lambda row: value_at(row, angle))
        rows.append({"angle": angle, "value": value_at(best, angle), **best})
    return rows


def _differences(config: Config, families: Sequence[Row]) -> list[Row]:
    """Return paired differences of each pair of families, adjusted by Holm within the pair."""
    rows: list[Row] = []
    for first, second in _COMPARED:
        if first in config.families and second in config.families:
            first_rows, second_rows = (matching(families, family=name) for name in (first, second))
            seeds = [row["seed"] for row in first_rows]  # online planning: of the first seeds alone
            second_rows = [row for row in second_rows if row["seed"] in seeds]
            measures = [name for name in first_rows[0] if name == "hypervolume" or "regret" in name]
            differences = paired_differences(first_rows, second_rows, *measures, label="measure")
            rows += [{"first": first, "second": second, **row} for row in differences]
    return rows


def _points(rows: Sequence[Row]) -> np.ndarray:
    """Return the mean totals of policies, (policy, 2)."""
    return np.array([(row["r_env"], row["r_social"]) for row in rows])


def _families(config: Config, policies: Sequence[Row]) -> list[Row]:
    """Return hypervolume, regrets at the key angles and monotony of each family and seed."""
    corner = _points(policies).min(axis=0)
    compared: list[Row] = []
    for family, seed in itertools.product(config.families, config.seeds):
        if family == FORESIGHT or seed not in config.seeds_of(family):
            continue
        rows = matching(policies, family=family, seed=seed)
        rows.sort(key=lambda row: row["asked"])
        key = [row for row in rows if row["asked"] in config.key_angles]
        regrets = {f"regret_{row['asked']:g}": row["regret"] for row in key}
        of_known = {
            f"mean_{name}": float(np.mean([row[name] for row in key]))
            for name in ("known_regret", "others_regret")
            if name in key[0]
        }
        turns = np.diff(_points(rows), axis=0)
        compared.append(
            {
                "family": family,
                "seed": seed,
                "hypervolume": hypervolume(_points(key), corner),
                "mean_regret": float(np.mean(list(regrets.values()))),
                "worst_regret": max(regrets.values()),
                **regrets,
                **of_known,
                "angles": len(rows),
                "rise_r_env": float(max(turns[:, 0].max(), 0.0)),
                "drop_r_social": float(max(-turns[:, 1].min(), 0.0)),
                "most_arrivals": max(row["arrival"] for row in rows),
            }
        )
    return compared


def _summary(config: Config, tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return means over seeds of each family, and of each policy by family and angle."""
    families = groups(tables["families"], "family")
    policies: dict[str, Any] = {family: {} for family in config.families}
    for (family, angle), rows in groups(tables["policies"], "family", "asked").items():
        policies[family][f"{angle:g}"] = _mean(rows)
    differences: dict[str, Any] = {}
    for row in tables["differences"]:
        differences.setdefault(f"{row['first']} - {row['second']}", {})[row["measure"]] = row
    return {
        "families": {family: _mean(rows) for (family,), rows in families.items()},
        "policies": policies,
        "differences": differences,
    }


def _mean(rows: list[Row]) -> Row:
    """Return the means of columns with numbers in all rows."""
    means = {name: value for name, value in numeric_means(rows).items() if name != "seed"}
    return means | {"seeds": len({row["seed"] for row in rows})}


STUDY = Study(
    name="intersection-dial",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "families",
        "family",
        "seed",
        "hypervolume",
        "mean_regret",
        "worst_regret",
        "rise_r_env",
        "drop_r_social",
        "most_arrivals",
        title="regret against the best policy of all, over the key angles",
    ),
)
