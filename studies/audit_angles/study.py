"""Passes of drivers of known angles at every declared angle, with the default declarations.

An audit is drawn from a pool of episodes that every driver has driven. Its tests are those of
`audit.verdict.decide`, of many audits at once.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from socialiq.audit.evidence.drive import Course
from socialiq.learners.settings import check_counts
from socialiq.types import Row
from socialiq.worlds.registry import GRIDWORLDS, make
from socialiq_lab.study import Context, Findings, StageCallback, tracked
from studies.audit_angles.audits import TESTS, Audits
from studies.audit_angles.drivers import (
    ANGLES,
    SHARES,
    WORLD,
    Driven,
    drive,
    drive_optima,
    mixtures,
)
from studies.audit_angles.fitted import fitted_rows


def compute_tables(config: Any, context: Context) -> Findings:
    """Run every driver on the pool of each world, draw audits from it, and count.

    The summary has the smallest share of passes at the drivers' angle, and the largest of wrong
    passes: of a driver whose values in the whole pool are not within the declaration.
    """
    check_counts(config, ("pool", "audits", "fitting"))
    drawn = (config.pool_seed, config.pool), (config.fitting_seed, config.fitting)
    course, fitting = (
        Course(make(WORLD), np.random.default_rng(seed).integers(2**62, size=size))
        for seed, size in drawn
    )
    on_stage = context.on_stage
    pools = {world: drive_optima(world, course.seeds) for world in GRIDWORLDS}
    pools[WORLD] = drive(course, on_stage)
    fitted = fitted_rows(course, pools[WORLD], fitting, config, on_stage)
    power = [row for world in pools for row in power_rows(world, pools[world], config, on_stage)]
    worst = worst_rows(pools[WORLD], config.pool_seed)
    summary: dict[str, Any] = {"worst": {}}
    for row in power:
        kinds = summary.setdefault(f"{row['episodes']} episodes", {})
        share = kinds.setdefault(f"{row['world']}, {row['kind']}", {"own_angle": {}, "wrong": 0.0})
        if row["true"] == row["declared"]:
            share["own_angle"].setdefault(row["policy"], row["passed"])
        if not row["inside"]:
            share["wrong"] = max(share["wrong"], row["passed"])
    for row in worst:
        summary["worst"].setdefault(f"{row['declared']:g}", {})[row["measure"]] = row["value"]
    return Findings({"power": power, "worst": worst, "fitted": fitted}, summary)


def power_rows(
    world: str, pool: Mapping[str, Driven], config: Any, on_stage: StageCallback
) -> list[Row]:
    """Return the shares of audits of each driver that pass, by declared angle and length.

    Of the mixtures of two drivers in equal shares, those have rows that would pass with many
    episodes, or but for the test of one character.
    """
    rows: list[Row] = []
    for declared in tracked(ANGLES, on_stage, f"audits, {world}", "angles"):
        audits = Audits.of(world, declared, pool)
        halves = mixtures(pool, config.pool_seed, (0.5,)) if world == WORLD else ()
        within = {name: row for name, row in halves if audits.holds(row.outcomes, TESTS[:2])}
        for name, driven in {**pool, **within}.items():
            if driven.kind == "reference":
                continue
            label: Row = {"world": world, "declared": declared, "policy": name, "kind": driven.kind}
            label["true"] = "" if driven.true_angle is None else driven.true_angle
            label["inside"] = int(audits.holds(driven.outcomes))
            for episodes in config.lengths:
                how = episodes, config.audits, config.first_seed
                rows.append({**label, "episodes": episodes, **audits.shares(driven.outcomes, *how)})
    return rows


MEASURES = ("at_fault", "collisions", "r_social", "distance")
"""Measures of the worst policy that passes: shares of episodes, the mean effect on others, and the
distance in degrees of the angle that it was made for."""


def worst_rows(pool: Mapping[str, Driven], seed: int) -> list[Row]:
    """Return the worst policy by each measure of the drivers and mixtures that pass the pool."""
    rows: list[Row] = []
    for declared in ANGLES:
        audits, passing = Audits.of(WORLD, declared, pool), dict[str, dict[str, float]]()
        tried = 0
        for name, driven in (*pool.items(), *mixtures(pool, seed, SHARES)):
            tried += 1
            if audits.holds(driven.outcomes):
                at_fault, struck = driven.outcomes.at_fault.mean(), driven.outcomes.struck.mean()
                far = 0.0 if driven.true_angle is None else abs(driven.true_angle - declared)
                values = at_fault, at_fault + struck, driven.outcomes.mean.social, far
                passing[name] = dict(zip(MEASURES, map(float, values), strict=True))
        for measure in MEASURES if passing else ():
            sign = -1.0 if measure == "r_social" else 1.0
            worst = max(passing, key=lambda name: sign * passing[name][measure])
            row: Row = {"declared": declared, "measure": measure, "value": passing[worst][measure]}
            rows.append(row | {"policy": worst, "tried": tried, "passing": len(passing)})
    return rows
