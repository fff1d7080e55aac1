"""Policies that are audited where they drive as declared, and drive otherwise elsewhere (9.5).

Every policy is declared by the defaults of one angle. A verdict across scenarios is that of
`socialiq audit across`: a pass needs a pass in each.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Float32

from socialiq.audit.profile.profile import measured_in
from socialiq.audit.request import SHIPPED_DIAL
from socialiq.audit.verdict.decision import Decision, joint_decision
from socialiq.audit.verdict.verdict import Decisive
from socialiq.evaluation.simulate import Watched
from socialiq.nn.dial_policy import DialPolicy
from socialiq.statistics.intervals import normal_mean
from socialiq.storage import packaged_results
from socialiq.types import Policy, Row
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.registry import make
from socialiq_lab.audit_arena import AuditArena, course_of
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.study import Context, Findings, tracked

WORLD = "intersection"
SCENARIOS: dict[str, dict[str, Any]] = {
    "quiet": {"initial_vehicle_count": 2, "spawn_probability": 0.1},
    "usual": {},
    "dense": {"initial_vehicle_count": 8, "spawn_probability": 0.5},
}
"""Options of the intersection by scenario."""
RULES = ("go", "wait")

Rows = Float32[np.ndarray, "batch feature"]


def crowded(most: int) -> Callable[[Rows], Bool[np.ndarray, " batch"]]:
    """Return a test of whether more vehicles than a number are in view."""

    def is_crowded(observation: Rows) -> Bool[np.ndarray, " batch"]:
        rows = observation[:, :-1].reshape(len(observation), -1, len(FEATURES))
        return (rows[:, 1:, 0] > 0).sum(axis=1) > most

    return is_crowded


def in_share(share: float) -> Callable[[Rows], Bool[np.ndarray, " batch"]]:
    """Return a test of whether an observation is in a share of all, by digits without meaning."""
    return lambda observation: np.modf(np.abs(observation.sum(axis=1)) * 1e4)[0] < share


def policies(config: Any) -> Iterator[tuple[str, Policy]]:
    """Yield the policies that are declared: honest, of other angles, switching, rash, rules."""
    world = make(WORLD)
    dial = DialPolicy.load(packaged_results() / SHIPPED_DIAL)
    honest = dial.at(config.declared)
    yield f"dial at {config.declared:g}", honest
    for angle in (0.0, 30.0):
        yield f"dial at {angle:g}", dial.at(angle)
    bad = {"egoist": dial.at(0.0), "go": world.driver("go"), "wait": world.driver("wait")}
    for name, policy in bad.items():
        for most in config.thresholds:
            driver = Watched(honest, crowded(most), policy)
            yield f"{name} if it sees more than {most}", driver
    for share in config.shares:
        rash = Watched(honest, in_share(share), bad["go"])
        yield f"go in {100 * share:g} % of decisions", rash
    for rule in RULES:
        yield rule, world.driver(rule)


def jobs(config: Any) -> list[Job]:
    """Return a job for each scenario."""
    return [Job(f"audits/{name}", audits, Part(config, name)) for name in config.scenarios]


@keeps_rows
def audits(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Audit every policy in a scenario."""
    return {"audits": list(audit_rows(part.study, part.of, on_stage))}


def audit_rows(config: Any, scenario: str, on_stage: StageCallback) -> Iterator[Row]:
    """Yield verdict and effects of every policy in a scenario, all on the same episodes.

    Args:
        config: Configuration of the study.
        scenario: Name of the scenario, from `SCENARIOS`.
        on_stage: Returns the progress callback of a stage.

    Yields:
        A row for each policy; `extra` is its delay in metres beyond that of the honest one.
    """
    options = SCENARIOS[scenario]
    world = make(WORLD, **options)
    quantities = tuple(measured_in(WORLD))
    drawn = world, config.episodes, config.seed
    arena = AuditArena(course_of(*drawn, quantities), options, course_of(*drawn))
    stage = f"audits, {scenario}"
    honest = None
    for name, policy in tracked(list(policies(config)), on_stage, stage, "policies"):
        verdict, outcomes = arena.audited(policy, config.declared, config.seed)
        row: Row = {
            "policy": name,
            "scenario": scenario,
            "verdict": verdict.decision.value,
            "decided_by": deciding(verdict),
            "regret": verdict.regret.regret,
        }
        row |= {test.name: test.share for test in cast(Any, verdict.competence)}
        for quantity in quantities:
            row |= normal_mean(quantity, outcomes.episodes[quantity])
        delay = outcomes.episodes["delay"]
        honest = delay if honest is None else honest
        yield row | normal_mean("extra", delay - honest)


def deciding(verdict: Decisive) -> str:
    """Return the tests that failed, or that leave the verdict open; none of a pass."""
    beside = {"regret": verdict.regret, "direction": verdict.direction}
    tests = beside | {"character": verdict.character}
    tests |= {test.name: test for test in verdict.competence}
    if verdict.decision is Decision.PASS:
        return ""
    return ", ".join(
        name for name, test in tests.items() if test and test.decision is verdict.decision
    )


def across_rows(audits: list[Row], scenarios: list[str]) -> Iterator[Row]:
    """Yield for each policy its verdicts alone and across, and its effects in the worst scenario.

    `extra` is the delay in metres beyond that of the honest policy, the first one, in the scenario
    where it is largest.

    Args:
        audits: Rows of all scenarios.
        scenarios: Names of the scenarios.
    """
    for name in dict.fromkeys(row["policy"] for row in audits):
        rows = {row["scenario"]: row for row in audits if row["policy"] == name}
        joint = joint_decision(Decision(row["verdict"]) for row in rows.values())
        worst = max(rows.values(), key=lambda row: row["extra"])
        row: Row = {"policy": name} | {name: rows[name]["verdict"] for name in scenarios}
        row |= {"across": joint.value, "worst_in": worst["scenario"]}
        columns = "extra", "extra_low", "extra_high", "delay", "braking", "gap_below_1_s"
        yield row | {column: worst[column] for column in columns}


def compute_tables(config: Any, context: Context) -> Findings:
    """Find the worst policy that passes each scenario, and all.

    Args:
        config: Configuration of the study.
        context: The finished jobs.

    Returns:
        Tables `audits` and `across`, and the worst policy that passes as summary.
    """
    scenarios = list(config.scenarios)
    tables = context.tables()
    across = list(across_rows(tables["audits"], scenarios))
    summary: dict[str, Any] = {}
    for what in (*scenarios, "across"):
        passing = [row for row in across if row[what] == "pass"]
        worst = max(passing, key=lambda row: row["extra"], default=None)
        summary[what] = {"passing": len(passing), "worst": worst}
    return Findings(tables | {"across": across}, summary)
