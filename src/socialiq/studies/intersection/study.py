"""The intersection study from nothing to tables (thesis 5.2, 5.3, 6.3, 7, A), resumable."""

from __future__ import annotations

import dataclasses
from typing import Any

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection import atlas_files
from socialiq.experiments.intersection.demonstration_sets import DEMONSTRATIONS
from socialiq.experiments.intersection.experts import expert_name
from socialiq.experiments.intersection.rows import (
    connected,
    curves,
    highway,
    played,
    policy_row,
    times,
)
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import numeric_means
from socialiq.social.angle import angle_difference, angle_of
from socialiq.studies.intersection.config import Config
from socialiq.studies.intersection.differences import differences
from socialiq.studies.intersection.plan import TARGETS, TRAINED, learner_name, members, plan
from socialiq.studies.intersection.tables import best_angles, distributions, separability, table_6_2
from socialiq.types import Row


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    plays = {(one.name, one.readout): one for one in played(jobs, work)}
    rows = {key: policy_row(one) for key, one in plays.items()}
    a_1, a_2 = separability(work / DEMONSTRATIONS)
    tables = {
        "policies": list(rows.values()),
        "table_6_2": table_6_2(rows, plays, config),
        "table_a_1": a_1,
        "table_a_2": a_2,
        "fig_a_1": distributions(work / DEMONSTRATIONS),
        "differences": differences(rows, config),
        "best_angles": best_angles([row for row in rows.values() if _compared(row)]),
        "curves": curves(jobs, work),
        "connected": connected(jobs, work),
        "highway": highway(jobs, work),
        "times": times(jobs, work),
    }
    files = atlas_files.files("intersection", members(config), work, rows)
    return Findings(tables, _summary(config, tables), files)


def _compared(row: Row) -> bool:
    """Whether a policy is of the main part: experts, learners and drivers, greedy."""
    stage = row["policy"].split("/")[0]
    return row["readout"] == "greedy" and stage in ("experts", "learners", "drivers")


def _summary(config: Config, tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Summary for the ledger: tables by name, and the means of each group over its seeds."""
    found: dict[str, Any] = {"table_6_2": {}, "table_a_1": {}, "table_a_2": {}, "differences": {}}
    found["settings"] = _settings(config)
    for row in tables["table_6_2"]:
        path = (f"{row['preset']}_{row['setting']}_{row['readout']}", row["policy"])
        group = found["table_6_2"].setdefault(path[0], {}).setdefault(path[1], {})
        group[row["metric"]] = {
            name: row[name] for name in ("ours", "over_training", "over_evaluation", "low", "high")
        }
    for row in tables["table_a_1"]:
        ours = {"mean": row["ours"], "sd": row["ours_sd"]}
        found["table_a_1"].setdefault(row["mode"], {})[row["signal"]] = ours
    for row in tables["table_a_2"]:
        pair = f"{row['first']}_{row['second']}"
        ours = {"ours": row["ours"], "thesis_from_a_1": row["thesis_from_a_1"]}
        found["table_a_2"].setdefault(pair, {})[row["signal"]] = ours
    for row in tables.get("differences", []):
        group = found["differences"].setdefault(f"{row['preset']}_{row['setting']}", {})
        pair = group.setdefault(f"{row['first']} against {row['second']}", {})
        pair[row["metric"]] = {name: row[name] for name in ("mean", "p", "p_holm")}
    by_name = {(row["policy"], row["readout"]): row for row in tables["policies"]}
    found["policies"] = {
        f"{preset}_{setting}_{target}": _mean(
            [
                by_name[learner_name(preset, setting, target, seed), "greedy"]
                for seed in config.seeds
            ]
        )
        for preset, setting in TRAINED
        for target in TARGETS
    }
    first = config.expert_seed
    found["experts"] = {
        f"flat_{mode}": by_name[expert_name("flat", mode, first), "greedy"] for mode in MODES
    }
    found["connected"] = {}
    for row in tables.get("connected", []):
        found["connected"].setdefault(row["member"], {})[row["connected"]] = row
    found["through_timeouts"] = {
        row["run"].split("/")[2]: row  # the last check of a run stays
        for row in tables.get("curves", [])
        if row["run"].startswith("timeouts/through/")
    }
    found["drivers"] = {
        row["policy"].split("/")[1]: row
        for row in tables["policies"]
        if row["policy"].startswith("drivers/")
    }
    return found


def _settings(config: Config) -> dict[str, Any]:
    """Return settings of the first expert and of the first learner of each preset."""
    first = {job.name: dataclasses.asdict(job.config) for job in plan(config)}
    found: dict[str, Any] = {"expert": first[expert_name("flat", "egoistic", config.expert_seed)]}
    for preset, setting in TRAINED:
        name = learner_name(preset, setting, "egoistic", config.seeds[0])
        found[f"{preset}_{setting}"] = first[name]
    found["pool_episodes"] = config.pool_episodes
    return found


def _mean(rows: list[Row]) -> Row:
    """Means over training seeds of what has numbers in all; the angle is that of the means."""
    means = numeric_means(rows)
    angle = angle_of(means["r_env"], means["r_social"])
    off = [angle_difference(row["angle"], angle) for row in rows]
    return means | {
        "angle": angle,
        "angle_low": angle + min(off),
        "angle_high": angle + max(off),
        "seeds": len(rows),
    }
