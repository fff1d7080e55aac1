"""Experts, demonstrations and learners of the intersection (thesis 5.2-6.3, 7, A)."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.evaluation.episodes import OUTCOMES, REWARDS, policy_row
from socialiq.evaluation.front import support_intervals
from socialiq.evaluation.rollout import MODES
from socialiq.plotting.style import COLORS, Mark, ring
from socialiq.results_folder import Results, from_csv
from socialiq.social.angle import pooled_angle
from socialiq.types import Row
from socialiq_lab.intersection import rows as intersection
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.driving import DEMONSTRATIONS, episodes_at, load_episodes
from socialiq_lab.intersection.thesis_tables import (
    PERCENT,
    compared,
    group_spread,
    separability,
    signals_of,
)
from socialiq_lab.jobs import Job
from socialiq_lab.study import Context, Findings, View
from socialiq_lab.tables import column, groups, matching, nested, numeric_means
from studies.intersection import plan
from studies.intersection.plan import check as check
from studies.intersection.plan import jobs

READOUTS = ("greedy", "soft")


def table_6_2(
    rows: Mapping[tuple[str, str], Row], episodes: intersection.PolicyEpisodes, config: Any
) -> list[Row]:
    """Return Tables 6.1 and 6.2: each metric of experts and learners with the thesis' value.

    `over_training` is the standard deviation over training seeds, empty for a single expert;
    `over_evaluation` that over groups of evaluation episodes, averaged over training seeds.

    Args:
        rows: Row of metrics by policy and readout.
        episodes: Episodes by policy and readout.
        config: Configuration of the study.

    Returns:
        A row for each group, metric, readout and policy; shares are in percent.
    """
    table: list[Row] = []
    for (group, policies), metric in itertools.product(
        plan.columns(config).items(), thesis_values.METRICS
    ):
        for readout, (policy, names) in itertools.product(READOUTS, policies.items()):
            if any((name, readout) not in rows for name in names):
                continue  # experts are evaluated greedily only
            factor = 100 if metric in PERCENT else 1
            values = [factor * rows[name, readout][metric] for name in names]
            spreads = [factor * group_spread(episodes[n, readout], config, metric) for n in names]
            mean, spread = thesis_values.TABLE_6_2[metric][policy]
            table.append(
                dict(zip(("preset", "setting"), group, strict=True))
                | {"readout": readout, "policy": policy, "metric": metric}
                | {"thesis": mean, "thesis_spread": spread, "ours": float(np.mean(values))}
                | {"over_training": float(np.std(values, ddof=1)) if len(values) > 1 else ""}
                | {"over_evaluation": float(np.mean(spreads))}
                | {"low": min(values), "high": max(values), "seeds": len(values)}
            )
    return table


def distributions(recordings: Path) -> list[Row]:
    """Return the distribution of the rewards of a decision, by mode and signal (Fig A.1).

    40 equal bins between the 0.5 and 99.5 percentiles; values beyond count in the outermost.
    """
    values = {mode: signals_of(recordings, mode) for mode in MODES}
    table: list[Row] = []
    for signal in ("r_self", "r_global", "r_env", "r_social"):
        everything = np.concatenate([values[mode][signal] for mode in MODES])
        low, high = np.quantile(everything, [0.005, 0.995])
        edges = np.linspace(float(low), float(high), 41)
        for mode in MODES:
            clipped = np.clip(values[mode][signal], edges[0], edges[-1])
            shares = np.histogram(clipped, edges)[0] / len(clipped)
            table += [
                {"mode": mode, "signal": signal, "from": low, "to": high, "share": share}
                for low, high, share in zip(edges[:-1], edges[1:], shares, strict=True)
            ]
    return table


PolicyRows = Mapping[tuple[str, str], Row]  # rows of policies by (policy, readout)


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        All tables, the summary, and the files of the atlas.
    """
    work = context.work
    shipped = plan.members(config)
    episodes = intersection.evaluated(context.jobs, work)
    rows = {key: policy_row(*key, played) for key, played in episodes.items()}
    a_1, a_2 = separability(work / DEMONSTRATIONS)
    main = [
        row
        for (name, readout), row in rows.items()
        if readout == "greedy" and name.split("/")[0] in ("experts", "learners", "drivers")
    ]
    highway: list[Row] = []  # each policy's episodes on the real highway-env beside the core's
    worst = ("max_deviation", "max_observation_deviation", "max_reward_deviation")
    for job in (job for job in context.jobs if job.stage == "highway"):
        compared = from_csv(work / job.name / "compared.csv")
        highway.append(
            {"policy": job.name.removeprefix("highway/"), "episodes": len(compared)}
            | {"steps": sum(row["steps"] for row in compared)}
            | {"differing": sum(row["discrete_differences"] for row in compared)}
            | {name: max(row[name] for row in compared) for name in worst}
        )
    tables = {
        "policies": list(rows.values()),
        "table_6_2": table_6_2(rows, episodes, config),
        "table_a_1": a_1,
        "table_a_2": a_2,
        "fig_a_1": distributions(work / DEMONSTRATIONS),
        "differences": differences(rows, config),
        "best_angles": best_angles(main),
        "curves": intersection.curves(context.jobs, work),
        "connected": _connected(context.jobs, work),
        "highway": highway,
        "times": intersection.times(context.jobs, work),
    }
    sources = {name: (job, plan.policy_file(job)) for name, job in shipped.items()}
    greedy = {name: rows[job, "greedy"] for name, job in shipped.items()}
    files = intersection.atlas_files("intersection", "intersection", sources, work, greedy)
    return Findings(tables, _summary(config, tables), files)


def best_angles(rows: Sequence[Row]) -> list[Row]:
    """Return for each policy the angles at which it is the best of all given ones."""
    points = {f"{r['policy']} {r['readout']}": (r["r_env"], r["r_social"]) for r in rows}
    ranges: list[Row] = []
    for row, interval in zip(rows, support_intervals(points).values(), strict=True):
        low, high = interval or ("", "")
        names = ("policy", "readout", "r_env", "r_social", "angle")
        ranges.append({name: row[name] for name in names} | {"best_from": low, "best_to": high})
    return ranges


def differences(rows: PolicyRows, config: Any) -> list[Row]:
    """Test every difference that the thesis claims, in every group of learners.

    A replicate is a training seed; an expert, trained once, is the same in all of them, so these
    tests cover the variation of learners and not that of experts. A comparison is left out where a
    rate is undefined, because no episode enters the junction.

    Args:
        rows: Row of metrics by policy and readout; the greedy ones are read.
        config: Configuration of the study.

    Returns:
        A row for each group and comparison, with p adjusted by Holm within the group.
    """
    experts = plan.columns(config)["experts", "flat"]
    tests: list[Row] = []
    for preset, setting in plan.TRAINED:
        names = plan.columns(config)[preset, setting]
        names |= {name: single * len(config.seeds) for name, single in experts.items()}
        by_policy = {
            policy: [rows[name, "greedy"] for name in folders] for policy, folders in names.items()
        }
        tests += compared({"preset": preset, "setting": setting}, by_policy)
    return tests


def _connected(planned: Sequence[Job], work: Path) -> list[Row]:
    """Return outcomes of the atlas' policies with and without connected lanes (intersection-v2)."""
    rates = [f"{kind}{end}" for kind in OUTCOMES for end in ("", "_low", "_high")]
    rows: list[Row] = []
    for job in planned:
        if job.stage == "connected":
            (trained,) = job.inputs
            folders = {"off": work / "evaluation" / trained, "on": work / job.name}
            for name, folder in folders.items():
                episodes = load_episodes(episodes_at(folder, job.config.driver))
                row = policy_row(trained, "greedy", episodes)
                label = {"member": job.name.removeprefix("connected/"), "connected": name}
                names = (*rates, "ego_struck", "ego_was_struck", *REWARDS)
                rows.append(label | {key: row[key] for key in names})
    return rows


def _summary(config: Any, tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Summary for the ledger: tables by name, and the means of each group over its seeds."""
    returns = [row | {"mean": row["ours"], "sd": row["ours_sd"]} for row in tables["table_a_1"]]
    greedy = {row["policy"]: row for row in tables["policies"] if row["readout"] == "greedy"}
    configs = {job.name: dataclasses.asdict(job.config) for job in jobs(config)}
    settings: dict[str, Any] = {}
    policies: dict[str, Row] = {}
    for (preset, setting), names in plan.columns(config).items():
        if preset == "experts":
            settings["expert"] = configs[names["expert egoistic"][0]]
            continue
        settings[f"{preset}_{setting}"] = configs[names["egoistic"][0]]
        for target, folders in names.items():
            policies[f"{preset}_{setting}_{target}"] = _mean([greedy[name] for name in folders])
    experts = plan.columns(config)["experts", "flat"]
    return {
        "table_a_1": nested(returns, "mode", "signal", keep=("mean", "sd")),
        "settings": settings | {"pool_episodes": config.pool_episodes},
        "policies": policies,
        "experts": {f"flat_{mode}": greedy[experts[f"expert {mode}"][0]] for mode in MODES},
        "through_timeouts": {
            row["run"].split("/")[2]: row  # the last check of a run stays
            for row in tables["curves"]
            if row["run"].startswith("timeouts/through/")
        },
        "drivers": {
            name.removeprefix("drivers/"): row
            for name, row in greedy.items()
            if name.startswith("drivers/")
        },
    }


def _mean(rows: list[Row]) -> Row:
    """Return means over training seeds of numeric columns; the angle is that of the means."""
    angle, low, high = pooled_angle(column(rows, "r_env"), column(rows, "r_social"))
    ends = {"angle": angle, "angle_low": low, "angle_high": high}
    return numeric_means(rows) | ends | {"seeds": len(rows)}


def view(results: Results) -> Sequence[View]:
    """Return Table 6.2 of the experts and of each group of learners, greedy, a row for a policy."""
    greedy = matching(results.tables["table_6_2"], readout="greedy")
    views = []
    for (preset, setting), rows in groups(greedy, "preset", "setting").items():
        table: dict[str, Row] = {}
        for row in rows:
            printed = table.setdefault(row["policy"], {"policy": row["policy"]})
            printed[row["metric"]] = f"{row['ours']:.1f} ({row['thesis']:g})"
        views.append(View(list(table.values()), f"{preset}, {setting}: ours (thesis); %, km/h"))
    return views


def fig_6_5(results: Results) -> dict[str, Figure]:
    """Draw Fig 6.5: the empirical angle of each learner, the thesis' as an open mark outside."""
    marks = []
    for name in COLORS:
        row = results.summary["policies"]["_".join((*plan.SHIPPED, name))]
        angle, low, high = (row[f"angle{end}"] for end in ("", "_low", "_high"))
        thesis = thesis_values.FIG_6_5.get(name)
        printed = "not printed" if thesis is None else f"{thesis:.0f}°"
        label = f"{name}: {angle:.0f}° ({low:.0f}° to {high:.0f}°; thesis {printed})"
        marks.append(Mark(name, angle, label, thesis, (low, high)))
    note = "greedy; open marks: thesis; arcs: range over training seeds"
    title = f"Learners' angles are in the thesis' order, but each is smaller\n({note})"
    return {"fig_6_5_ring": ring(marks, title)}
