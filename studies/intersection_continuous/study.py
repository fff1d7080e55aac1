"""The intersection with continuous actions: the main table, and a dial beside a discrete one.

The ego drives straight on and chooses its acceleration. Learners have a mixture of the experts;
dials of discrete actions, of the same steps and updates, drive the same episodes.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from socialiq.evaluation.episodes import policy_row
from socialiq.evaluation.front import hypervolume
from socialiq.evaluation.rollout import MODES
from socialiq.types import Row
from socialiq_lab.intersection import rows as intersection
from socialiq_lab.intersection.driving import episodes_at, load_episodes
from socialiq_lab.intersection.thesis_values import METRICS
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import (
    groups,
    matching,
    nested,
    numeric_means,
    paired_differences,
    with_holm,
)
from studies.intersection_continuous import plan
from studies.intersection_continuous.plan import Config, jobs

__all__ = ["Config", "compute_tables", "jobs"]
_PERCENT = ("collision", "arrival", "timeout", "stopped")
_PAIRS = (
    (plan.CONTINUOUS, plan.DISCRETE),
    (plan.HIGH_ANGLES, plan.DISCRETE),
    (plan.HIGH_ANGLES, plan.CONTINUOUS),
)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the experts and the first dial."""
    work = context.work
    policies, dials = _policies(config, work), list[Row]()
    for kind, seed, angle in itertools.product(plan.KINDS, config.seeds, config.angles):
        file = episodes_at(work / "evaluation" / kind, plan.run_file(0.0, seed), angle)
        row = policy_row(kind, "greedy", load_episodes(file))
        label = {"kind": kind, "seed": seed, "asked": angle}
        label |= {"value": intersection.value_at(row, angle), "regret": 0.0}
        dials.append(label | row)
    for row in dials:
        best = max(intersection.value_at(other, row["asked"]) for other in dials + policies)
        row["regret"] = best - row["value"]
    families = _families(dials)
    tables = {
        "main": main_table(policies, dials),
        "policies": policies,
        "mixture": _of_mixture(policies),
        "dials": dials,
        "families": families,
        "differences": _differences(families),
        "times": intersection.times(context.jobs, work),
    }
    name = "intersection-continuous"
    experts = {
        f"expert_{mode}": (plan.EXPERTS, plan.run_file(angle, config.expert_seed))
        for mode, angle in MODES.items()
    }
    rows = {f"expert_{mode}": matching(policies, name=f"expert {mode}")[0] for mode in MODES}
    files = intersection.atlas_files(name, name, experts, work, rows)
    files["dial.safetensors"] = (
        work / plan.CONTINUOUS / plan.run_file(0.0, config.seeds[0])
    ).read_bytes()
    means = {
        _short(kind): {name: mean for name, mean in numeric_means(rows).items() if name != "seed"}
        for (kind,), rows in groups(families, "kind").items()
    }
    main = nested(tables["main"], "policy", "metric", keep=("mean", "low", "high"))
    return Findings(tables, {"families": means, "main": main}, files)


def _policies(config: Config, work: Path) -> list[Row]:
    """Return metrics of each expert and policy of a mixture, with J at its own angle, or 0."""
    rows: list[Row] = []
    for job, (name, of_angles) in plan.POLICIES.items():
        seeds = (config.expert_seed,) if job == plan.EXPERTS else config.learner_seeds
        for mode, angle in MODES.items() if of_angles else (("", 0.0),):
            for seed in seeds:
                file = plan.run_file(angle, seed)
                episodes = load_episodes(episodes_at(work / "evaluation" / job, file))
                row = policy_row(f"{job}/{file}", "greedy", episodes)
                label = {"name": f"{name} {mode}".strip(), "seed": seed}
                rows.append(label | {"value": intersection.value_at(row, angle)} | row)
    return rows


def _of_mixture(policies: Sequence[Row]) -> list[Row]:
    """Return J of each policy of a mixture at the angles of the modes, its own angle or not."""
    return [
        {"method": name or "IQ-Learn", "asked": angle, "seed": row["seed"]}
        | {"value": intersection.value_at(row, angle)}
        for job, (name, of_angles) in plan.POLICIES.items()
        if job != plan.EXPERTS
        for mode, angle in MODES.items()
        for row in matching(policies, name=f"{name} {mode}".strip() if of_angles else name)
    ]


def main_table(policies: Sequence[Row], dials: Sequence[Row]) -> list[Row]:
    """Return each metric of Tables 6.1 and 6.2 over seeds; of dials at the modes."""
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


def _families(dials: Sequence[Row]) -> list[Row]:
    """Return J and regret at each angle, means of both, and monotony, of each dial of a kind."""
    corner = intersection.points_of(dials).min(axis=0)
    return [
        {"kind": kind, "seed": seed}
        | {f"value_{row['asked']:g}": row["value"] for row in rows}
        | {f"mean_{n}": float(np.mean([r[n] for r in rows])) for n in ("value", "regret")}
        | {"hypervolume": hypervolume(intersection.points_of(rows), corner)}
        | intersection.backward_steps(rows)
        for (kind, seed), rows in groups(dials, "kind", "seed").items()
    ]


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
