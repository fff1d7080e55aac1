"""Experts, demonstrations and learners of the intersection (thesis 5.2-6.3, 7, A)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from socialiq.evaluation.front import support_intervals
from socialiq.evaluation.rollout import MODES
from socialiq.plotting.style import COLORS, Mark, ring
from socialiq.results_folder import Results
from socialiq.social.angle import angle_difference, angle_of
from socialiq.types import Row
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.demonstration_sets import DEMONSTRATIONS
from socialiq_lab.intersection.experts import atlas_files
from socialiq_lab.intersection.rows import (
    connected,
    curves,
    evaluated,
    highway,
    policy_rows,
    times,
)
from socialiq_lab.study import Context, Findings, View
from socialiq_lab.tables import (
    groups,
    matching,
    nested,
    numeric_means,
    paired_row,
    with_holm,
)
from studies.intersection.plan import SHIPPED, TRAINED, Config, columns, jobs, members
from studies.intersection.tables import distributions, separability, table_6_2

PolicyRows = Mapping[tuple[str, str], Row]
"""Rows of policies by (policy, readout)."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    work = context.work
    episodes = evaluated(context.jobs, work)
    rows = policy_rows(episodes)
    a_1, a_2 = separability(work / DEMONSTRATIONS)
    tables = {
        "policies": list(rows.values()),
        "table_6_2": table_6_2(rows, episodes, config),
        "table_a_1": a_1,
        "table_a_2": a_2,
        "fig_a_1": distributions(work / DEMONSTRATIONS),
        "differences": differences(rows, config),
        "best_angles": best_angles([row for row in rows.values() if _is_compared(row)]),
        "curves": curves(context.jobs, work),
        "connected": connected(context.jobs, work),
        "highway": highway(context.jobs, work),
        "times": times(context.jobs, work),
    }
    files = atlas_files("intersection", members(config), work, rows)
    return Findings(tables, _summary(config, tables), files)


def _is_compared(row: Row) -> bool:
    """Whether a policy is of the main part: experts, learners and drivers, greedy."""
    stage = row["policy"].split("/")[0]
    return row["readout"] == "greedy" and stage in ("experts", "learners", "drivers")


def best_angles(rows: Sequence[Row]) -> list[Row]:
    """Return for each policy the angles at which it is the best of all given ones."""
    points = {f"{r['policy']} {r['readout']}": (r["r_env"], r["r_social"]) for r in rows}
    ranges: list[Row] = []
    for row, interval in zip(rows, support_intervals(points).values(), strict=True):
        low, high = interval or ("", "")
        names = ("policy", "readout", "r_env", "r_social", "angle")
        ranges.append({name: row[name] for name in names} | {"best_from": low, "best_to": high})
    return ranges


class Comparison(NamedTuple):
    """Two policies and a metric that the thesis compares.

    Attributes:
        place: Section of the thesis.
        first: A learner's target.
        second: Another learner's target, or "expert MODE".
        metric: Column of the policies' table.
    """

    place: str
    first: str
    second: str
    metric: str


_EGO = ("collision", "arrival", "timeout", "speed_kmh", "stopped")
_EXPOSED = ("at_fault_per_entry", "at_fault_per_conflict")

COMPARISONS = (
    *(Comparison("6.3, 7.2", "egoistic", "expert egoistic", metric) for metric in _EGO),
    *(Comparison("6.3, 7.2", "prosocial", "expert prosocial", metric) for metric in _EGO),
    Comparison("6.3", "altruistic", "expert altruistic", "collision"),
    *(Comparison("7.1", "prosocial", "egoistic", m) for m in ("collision", "arrival", "stopped")),
    *(Comparison("7.1", "altruistic", "prosocial", m) for m in ("collision", "arrival", "stopped")),
    *(Comparison("7.2", "prosocial", "expert prosocial", metric) for metric in _EXPOSED),
    *(Comparison("7.2", "egoistic", "expert egoistic", metric) for metric in _EXPOSED),
)


def differences(rows: PolicyRows, config: Config) -> list[Row]:
    """Test every difference that the thesis claims, in every group of learners, Holm in a group.

    A replicate is a training seed; an expert, trained once, is the same in all of them, so these
    tests cover the variation of learners and not that of experts. A rate over nothing (no entry
    into the junction) leaves a comparison out.

    Args:
        rows: Rows of policies.
        config: Configuration of the study.
    """
    experts = columns(config)["experts", "flat"]
    tests: list[Row] = []
    for preset, setting in TRAINED:
        names = columns(config)[preset, setting]
        names |= {name: single * len(config.seeds) for name, single in experts.items()}
        family: list[Row] = []
        for comparison in COMPARISONS:
            first, second = (
                [rows[name, "greedy"][comparison.metric] for name in names[policy]]
                for policy in (comparison.first, comparison.second)
            )
            if "" not in (*first, *second) and len(first) > 1:
                label = {"preset": preset, "setting": setting} | comparison._asdict()
                family.append(paired_row(label, first, second))
        tests += with_holm(family)
    return tests


def _summary(config: Config, tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Summary for the ledger: tables by name, and the means of each group over its seeds."""
    returns = [row | {"mean": row["ours"], "sd": row["ours_sd"]} for row in tables["table_a_1"]]
    pairs = [row | {"pair": f"{row['first']}_{row['second']}"} for row in tables["table_a_2"]]
    compared = [
        row
        | {"group": f"{row['preset']}_{row['setting']}"}
        | {"pair": f"{row['first']} against {row['second']}"}
        for row in tables.get("differences", [])
    ]
    rows = {(row["policy"], row["readout"]): row for row in tables["policies"]}
    beside = tables.get("connected", [])
    return {
        "table_6_2": _printed(tables["table_6_2"]),
        "table_a_1": nested(returns, "mode", "signal", keep=("mean", "sd")),
        "table_a_2": nested(pairs, "pair", "signal", keep=("ours", "thesis_from_a_1")),
        "differences": nested(compared, "group", "pair", "metric", keep=("mean", "p", "p_holm")),
        "settings": _settings(config),
        "policies": dict(_means(rows, config)),
        "experts": {
            f"flat_{mode}": rows[columns(config)["experts", "flat"][f"expert {mode}"][0], "greedy"]
            for mode in MODES
        },
        "connected": nested(beside, "member", "connected", keep=list(beside[0]) if beside else ()),
        "through_timeouts": {
            row["run"].split("/")[2]: row  # the last check of a run stays
            for row in tables.get("curves", [])
            if row["run"].startswith("timeouts/through/")
        },
        "drivers": {
            row["policy"].split("/")[1]: row
            for row in tables["policies"]
            if row["policy"].startswith("drivers/")
        },
    }


def _printed(table_6_2: Sequence[Row]) -> dict[str, Any]:
    """Table 6.2 by group, policy and metric."""
    rows = [
        row | {"group": f"{row['preset']}_{row['setting']}_{row['readout']}"} for row in table_6_2
    ]
    fields = ("ours", "over_training", "over_evaluation", "low", "high")
    return nested(rows, "group", "policy", "metric", keep=fields)


def _settings(config: Config) -> dict[str, Any]:
    """Return settings of the first expert and of the first learner of each preset."""
    first = {job.name: dataclasses.asdict(job.config) for job in jobs(config)}
    settings: dict[str, Any] = {}
    for (preset, setting), policies in columns(config).items():
        name, target = f"{preset}_{setting}", "egoistic"
        if preset == "experts":
            name, target = "expert", "expert egoistic"
        settings[name] = first[policies[target][0]]
    return settings | {"pool_episodes": config.pool_episodes}


def _means(rows: PolicyRows, config: Config) -> Iterator[tuple[str, Row]]:
    """Give the mean over training seeds of each target in each group of learners."""
    for preset, setting in TRAINED:
        for target, names in columns(config)[preset, setting].items():
            yield f"{preset}_{setting}_{target}", _mean([rows[name, "greedy"] for name in names])


def _mean(rows: list[Row]) -> Row:
    """Return means over training seeds of numeric columns; the angle is that of the means."""
    means = numeric_means(rows)
    angle = angle_of(means["r_env"], means["r_social"])
    off = [angle_difference(row["angle"], angle) for row in rows]
    return means | {
        "angle": angle,
        "angle_low": angle + min(off),
        "angle_high": angle + max(off),
        "seeds": len(rows),
    }


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
    group = "/".join(SHIPPED)
    marks = []
    for name in COLORS:
        angle = results.summary["policies"]["_".join((*SHIPPED, name))]["angle"]
        runs = [
            row
            for row in matching(results.tables["policies"], readout="greedy")
            if row["policy"].startswith(f"learners/{group}/{name}/")
        ]
        # Around the mean, because the least and greatest number may span the gap at 180 degrees.
        away = [angle_difference(row["angle"], angle) for row in runs]
        spread = (angle + min(*away, 0.0), angle + max(*away, 0.0))
        thesis = thesis_values.FIG_6_5.get(name)
        printed = "not printed" if thesis is None else f"{thesis:.0f}°"
        label = f"{name}: {angle:.0f}° ({spread[0]:.0f}° to {spread[1]:.0f}°; thesis {printed})"
        marks.append(Mark(name, angle, label, thesis, spread))
    note = "open marks: thesis; arcs: range over training seeds"
    title = f"Intersection: empirical angle, greedy\n({note})"
    return {"fig_6_5_ring": ring(marks, title)}
