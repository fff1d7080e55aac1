"""The intersection with continuous actions: the main table, and a dial beside a discrete one.

The ego drives straight on and chooses its acceleration. Experts are trained by soft actor-critic,
learners from an equal mixture of them, and beside these clones and TD3+BC. Dials are trained by
soft actor-critic at every angle, with two shares of high angles. Dials of discrete actions, of the
same steps and updates, drive the same episodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.evaluation.episodes import policy_row
from socialiq.evaluation.front import hypervolume
from socialiq.evaluation.rollout import MODES
from socialiq.plotting.style import figure, finish
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq_lab.intersection.driving import load_episodes
from socialiq_lab.intersection.experts import atlas_entries
from socialiq_lab.intersection.rows import times, value_at
from socialiq_lab.intersection.thesis_values import METRICS
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import (
    groups,
    matching,
    numeric_means,
    paired_differences,
    with_holm,
)
from studies.intersection_continuous.config import Config
from studies.intersection_continuous.work import (
    BASELINE,
    CLONES,
    CONTINUOUS,
    DISCRETE,
    EVALUATION,
    EXPERTS,
    HIGH_ANGLES,
    KINDS,
    LEARNERS,
    LONGER,
    OF_MIXTURE,
    TD3_BC,
    WEIGHTED,
    dial_file,
    plan,
)

_PERCENT = ("collision", "arrival", "timeout", "stopped")
_LOOKS = {
    CONTINUOUS: ("#2166ac", "o", "acceleration"),
    HIGH_ANGLES: ("#3c8d40", "v", "acceleration, more high angles"),
    DISCRETE: ("#c23b22", "^", "three actions"),
}
_NAMES = {
    EXPERTS: "expert",
    LEARNERS: "",
    BASELINE: "baseline",
    LONGER: "longer IQ-Learn",
    CLONES: "cloning",
    WEIGHTED: "weighted cloning",
    TD3_BC: "TD3+BC",
}
"""Beginning of a policy's name, by job."""
_PAIRS = ((CONTINUOUS, DISCRETE), (HIGH_ANGLES, DISCRETE), (HIGH_ANGLES, CONTINUOUS))


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the experts and the first dial."""
    work = context.work
    dials = [row for kind in KINDS for row in _dial_rows(kind, config, work)]
    policies = _single_rows(config, work)
    best = {angle: _best(dials + policies, angle) for angle in config.angles}
    for row in dials:
        row["regret"] = best[row["asked"]] - row["value"]
    families = [family for kind in KINDS for family in _families(kind, config, dials)]
    tables = {
        "main": main_table(policies, dials),
        "policies": policies,
        "mixture": _of_mixture(config, work),
        "dials": dials,
        "families": families,
        "differences": _differences(families),
        "times": times(context.jobs, work),
    }
    name = "intersection-continuous"
    files = atlas_entries(name, name, _atlas(config), work, _of_atlas(policies))
    first = work / CONTINUOUS / f"0_{config.seeds[0]}.safetensors"
    summary = {"families": _means(families), "main": _printed(tables["main"])}
    return Findings(tables, summary, files | {"dial.safetensors": first.read_bytes()})


def _single_rows(config: Config, work: Path) -> list[Row]:
    """Return metrics of each expert and policy of a mixture, with J at its own angle, or 0."""
    rows: list[Row] = []
    names = {f"{angle:g}": mode for mode, angle in MODES.items()}
    for job in (EXPERTS, *OF_MIXTURE):
        seeds = (config.expert_seed,) if job == EXPERTS else config.learner_seeds
        of_angles = OF_MIXTURE.get(job, True)
        for angle, mode in names.items() if of_angles else {"0": ""}.items():
            for seed in seeds:
                file = f"{angle}_{seed}.safetensors"
                episodes = load_episodes(work / EVALUATION / job / file)
                row = policy_row(f"{job}/{file}", "greedy", episodes)
                label = f"{_NAMES[job]} {mode}".strip()
                value = value_at(row, float(angle))
                rows.append({"name": label, "seed": seed, "value": value} | row)
    return rows


def _of_mixture(config: Config, work: Path) -> list[Row]:
    """Return J of each policy of a mixture at the angles of the modes, its own angle or not."""
    rows: list[Row] = []
    for job, of_angles in OF_MIXTURE.items():
        for mode_angle in MODES.values():
            for seed in config.learner_seeds:
                file = f"{mode_angle if of_angles else 0.0:g}_{seed}.safetensors"
                row = policy_row(job, "greedy", load_episodes(work / EVALUATION / job / file))
                label = {"method": _NAMES[job] or "IQ-Learn", "asked": mode_angle, "seed": seed}
                rows.append(label | {"value": value_at(row, mode_angle)})
    return rows


def _dial_rows(kind: str, config: Config, work: Path) -> list[Row]:
    """Return metrics of each dial at each angle, with J there; the regret is added later."""
    rows: list[Row] = []
    for seed in config.seeds:
        for angle in config.angles:
            file = dial_file(f"0_{seed}", angle)
            row = policy_row(kind, "greedy", load_episodes(work / EVALUATION / kind / file))
            label = {"kind": kind, "seed": seed, "asked": angle}
            rows.append(label | {"value": value_at(row, angle), "regret": 0.0} | row)
    return rows


def _best(rows: Sequence[Row], angle: float) -> float:
    """Return the largest J at an angle of all policies, of every kind."""
    return max(value_at(row, angle) for row in rows)


def main_table(policies: Sequence[Row], dials: Sequence[Row]) -> list[Row]:
    """Return the study's main table: each metric of Tables 6.1 and 6.2, mean and spread over seeds.

    Args:
        policies: Experts and policies of a mixture.
        dials: Dials, of which the angles of the three modes are shown.
    """
    by_name = {name: rows for (name,), rows in groups(policies, "name").items()}
    modes = {angle: mode for mode, angle in MODES.items()}
    for (kind, angle), rows in groups(dials, "kind", "asked").items():
        if angle in modes:
            by_name[f"{_short(kind)} dial {modes[angle]}"] = rows
    result: list[Row] = []
    for metric in METRICS:
        factor = 100 if metric in _PERCENT else 1
        for name, rows in by_name.items():
            values = [factor * row[metric] for row in rows]
            sd = float(np.std(values, ddof=1)) if len(values) > 1 else ""
            result.append(
                {"policy": name, "metric": metric, "mean": float(np.mean(values)), "sd": sd}
                | {"low": min(values), "high": max(values), "seeds": len(values)}
            )
    return result


def _families(kind: str, config: Config, dials: Sequence[Row]) -> list[Row]:
    """Return J and regret at each angle, means of both, and monotony, of each dial of a kind."""
    corner = np.array([(row["r_env"], row["r_social"]) for row in dials]).min(axis=0)
    ranked: list[Row] = []
    for seed in config.seeds:
        rows = matching(dials, kind=kind, seed=seed)
        points = np.array([(row["r_env"], row["r_social"]) for row in rows])
        turns = np.diff(points, axis=0)
        ranked.append(
            {"kind": kind, "seed": seed}
            | {f"value_{row['asked']:g}": row["value"] for row in rows}
            | {"mean_value": float(np.mean([row["value"] for row in rows]))}
            | {"mean_regret": float(np.mean([row["regret"] for row in rows]))}
            | {"hypervolume": hypervolume(points, corner)}
            | {"rise_r_env": float(max(turns[:, 0].max(initial=0.0), 0.0))}
            | {"drop_r_social": float(max((-turns[:, 1]).max(initial=0.0), 0.0))}
        )
    return ranked


def _differences(families: Sequence[Row]) -> list[Row]:
    """Return the differences of each pair of kinds, paired by training seed, corrected together."""
    measures = [name for name in families[0] if name.startswith("value_")]
    measures += ["mean_value", "hypervolume"]
    compared = []
    for pair in _PAIRS:
        first_rows, second_rows = (matching(families, kind=kind) for kind in pair)
        label = {"kinds": " less ".join(_short(kind) for kind in pair)}
        rows = paired_differences(first_rows, second_rows, *measures, label="measure")
        compared += [label | row for row in rows]
    return with_holm(compared)


def _short(kind: str) -> str:
    return kind.removeprefix("dials/")


def _means(families: Sequence[Row]) -> dict[str, Row]:
    """Return means over training seeds by kind of dial."""
    summary = {}
    for (kind,), rows in groups(families, "kind").items():
        means = numeric_means(rows)
        summary[_short(kind)] = {k: v for k, v in means.items() if k != "seed"}
    return summary


def _printed(table: Sequence[Row]) -> dict[str, Any]:
    """Return the main table by policy and metric."""
    summary: dict[str, Any] = {}
    for row in table:
        ends = {name: row[name] for name in ("mean", "low", "high")}
        summary.setdefault(row["policy"], {})[row["metric"]] = ends
    return summary


def _atlas(config: Config) -> Mapping[str, tuple[str, str]]:
    """Return the job and the file of each policy of the atlas, by name."""
    return {
        f"expert_{mode}": (EXPERTS, f"{angle:g}_{config.expert_seed}.safetensors")
        for mode, angle in MODES.items()
    }


def _of_atlas(policies: Sequence[Row]) -> Mapping[str, Row]:
    """Return the metrics of each policy of the atlas, by name."""
    return {f"expert_{mode}": matching(policies, name=f"expert {mode}")[0] for mode in MODES}


def draw(results: Results) -> dict[str, Figure]:
    """Draw the trade-off of the dials, and J over the angle."""
    return {"tradeoff": _tradeoff(results), "values": _values(results)}


def _tradeoff(results: Results) -> Figure:
    """Draw mean totals of every dial, joined in the order in which it turns, and of the experts."""
    picture = figure(6.4, 4.6)
    axes = picture.subplots()
    for kind, (ink, mark, label) in _LOOKS.items():
        for number, seed in enumerate(results.config["seeds"]):
            rows = matching(results.tables["dials"], kind=kind, seed=seed)
            x, y = ([row[side] for row in rows] for side in ("r_env", "r_social"))
            line_label = f"dial, {label}" if number == 0 else None
            axes.plot(x, y, color=ink, marker=mark, markersize=4, linewidth=0.7, alpha=0.7,
                      label=line_label)  # fmt: skip
    for row in results.tables["policies"]:
        if row["name"].startswith("expert"):
            axes.plot(row["r_env"], row["r_social"], marker="s", color="#1b1b1b", markersize=5)
            axes.annotate(row["name"], (row["r_env"], row["r_social"]), fontsize=6,
                          textcoords="offset points", xytext=(5, -7))  # fmt: skip
    finish(axes, "", 7, xlabel="mean r_env of an episode", ylabel="mean r_social of an episode")
    return picture


def _values(results: Results) -> Figure:
    """Draw J(α) of every dial less the best of all policies."""
    picture = figure(6.0, 3.6)
    axes = picture.subplots()
    for kind, (ink, mark, label) in _LOOKS.items():
        rows = matching(results.tables["dials"], kind=kind)
        axes.plot([row["asked"] for row in rows], [row["regret"] for row in rows], mark, color=ink,
                  markersize=4, alpha=0.6, label=f"dial, {label}")  # fmt: skip
    finish(axes, "", 7, xlabel="social angle, degrees", ylabel="regret")
    return picture


def view(results: Results) -> Sequence[View]:
    """Return the tables to print."""
    table: dict[str, Row] = {}
    for row in results.tables["main"]:
        table.setdefault(row["policy"], {"policy": row["policy"]})[row["metric"]] = row["mean"]
    columns = ("kind", "seed", "mean_value", "mean_regret", "hypervolume")
    families = [{name: row[name] for name in columns} for row in results.tables["families"]]
    return [
        View(list(table.values()), "Means over training seeds; %, km/h"),
        View(_of_methods(results), "Policies of one mixture: J, means over training seeds"),
        View(families, "Dials: J and regret, means over the angles"),
        View(results.tables.get("differences", []), "Differences of the dials, corrected together"),
    ]


def _of_methods(results: Results) -> list[Row]:
    """Return mean J of each method at each angle, a row for each method."""
    rows: dict[str, Row] = {}
    for (method, angle), group in groups(results.tables["mixture"], "method", "asked").items():
        mean = float(np.mean([row["value"] for row in group]))
        rows.setdefault(method, {"method": method})[f"{angle:g} degrees"] = mean
    return list(rows.values())


STUDY = Study(
    name="intersection-continuous",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view,
)
