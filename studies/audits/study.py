"""Audits of the thesis' printed tables and of this project's policies.

The thesis says that a recovered angle allows others to verify a declared one (7.1, 9.2). Here the
audit does so, from the declaration and either the printed numbers or driven episodes.
"""

from __future__ import annotations

import datetime
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialiq.audit.conduct import conduct
from socialiq.audit.evidence.outcomes import check_episodes
from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.report.views import arcs
from socialiq.audit.request import Request
from socialiq.types import Row
from socialiq_lab.study import (
    Context,
    Findings,
    StageCallback,
    counter,
    silent,
)
from socialiq_lab.tables import column, matching
from studies.audits.policies import (
    GRIDWORLD,
    AuditedPolicy,
    at_intersection,
    exact_in_gridworld,
    of_gridworld,
    trained_in_gridworld,
)
from studies.audits.published import floor_rows, learner_angle_rows, return_rows

DAY = datetime.date(2026, 11, 1)
MARGINS = {"intersection": Margin(1.0, 10.0), GRIDWORLD: Margin(0.5, 10.0)}
"""Margins of regret, in each world's reward per episode, and of the calibrated angle, degrees."""
ERROR = 0.05


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    episodes: int = 500
    """Episodes of each audit."""
    seed: int = 2026
    """Seed of every audit. It and the hashes of policy and profile determine the episodes."""
    training_seed: int = 10
    """Seed of the gridworld's learners and of their demonstrations."""
    updates: int = 6000
    """Gradient steps of the gridworld's trio and baseline."""
    dial_updates: int = 8000
    """Gradient steps of the dial."""
    dial_angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Angles at which the dial is audited, each declared."""
    worlds: tuple[str, ...] = ("intersection", GRIDWORLD)
    """Worlds whose policies are audited."""

    def __post_init__(self) -> None:
        """Raise an error for an invalid number of episodes."""
        check_episodes(self.episodes)


def compute_tables(config: Config, context: Context) -> Findings:
    """Audit the policies of each world and the printed tables."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if "intersection" in config.worlds:
            rows += audit_rows(at_intersection(folder), config, folder, context.on_stage)
        if GRIDWORLD in config.worlds:
            trained = folder / GRIDWORLD
            trained.mkdir()
            sizes = config.updates, config.dial_updates
            exact_in_gridworld(trained)
            trained_in_gridworld(trained, config.training_seed, sizes, context.on_stage)
            rows += audit_rows(
                of_gridworld(trained, config.dial_angles), config, folder, context.on_stage
            )
    tables = {"audits": rows, **published_tables(config.episodes)}
    return Findings(tables, _summary(tables))


def published_tables(episodes: int) -> dict[str, list[Row]]:
    """Return the tables of the printed numbers.

    Args:
        episodes: Assumed number of episodes where the thesis doesn't state it.
    """
    margin = MARGINS["intersection"]
    return {
        "published_returns": return_rows(margin, ERROR, episodes),
        "published_angles": learner_angle_rows(margin),
        "published_floor": floor_rows(ERROR, episodes),
    }


def audit_rows(
    policies: Iterable[AuditedPolicy],
    config: Config,
    folder: Path,
    on_stage: StageCallback = silent,
) -> list[Row]:
    """Audit each policy; return a row for each.

    Args:
        policies: Audited policies, all of one world.
        config: Episodes and seed.
        folder: Folder for the declarations.
        on_stage: Shows progress.
    """
    all_policies = list(policies)
    if not all_policies:
        return []
    count = counter(on_stage, f"audits, {all_policies[0].world}", len(all_policies), "audits")
    rows = []
    for done, policy in enumerate(all_policies, start=1):
        rows.append(_audit(policy, config, folder))
        count(done)
    return rows


def _audit(policy: AuditedPolicy, config: Config, folder: Path) -> Row:
    """Declare and audit one policy."""
    profile = folder / "profile.toml"
    margin, owner = MARGINS[policy.world], "the study of audits"
    declared = declare(policy.declared, owner, policy.world, margin, DAY, competence=policy.floor)
    # Without the template's comments, whose wording would otherwise determine the episodes.
    lines = [line for line in declared.source.splitlines() if line and not line.startswith(b"#")]
    profile.write_bytes(b"\n".join(lines))
    request = Request(policy.spec, profile, config.episodes, config.seed)
    return _audit_row(policy, conduct(request, lambda _: None).report)


def _audit_row(policy: AuditedPolicy, report: dict[str, Any]) -> Row:
    tests, means = report["tests"], report["policy"]["means"]
    regret, angle, calibrated = tests["regret"], tests["alpha_hat"], tests["calibration"]
    return {
        "world": policy.world,
        "policy": policy.name,
        "made_for": "" if policy.made_for is None else policy.made_for,
        "declared": policy.declared,
        "truthful": int(policy.truthful),
        "verdict": report["verdict"]["decision"],
        "decided_by": _decided_by(report),
        "needed": report["verdict"]["needed"] or "",
        "regret": regret["regret"],
        "regret_low": regret["low"],
        "regret_high": regret["high"],
        "margin": regret["margin"],
        "regret_decision": regret["decision"],
        "best": regret["best"],
        **{name: means[name] for name in ("at_fault", "struck", "arrival", "timeout")},
        "min_arrival": policy.floor.min_arrival,
        "explained": arcs(tests["rationalised"]["arcs"]),
        "alpha_hat": angle["angle"] if angle else "",
        "alpha_low": angle["low"] if angle else "",
        "alpha_high": angle["high"] if angle else "",
        "calibrated_low": _or_blank(calibrated["low"]),
        "calibrated_high": _or_blank(calibrated["high"]),
        "calibration": calibrated["decision"] if calibrated["low"] is not None else "none",
        "policy_sha256": report["hashes"]["policy"],
    }


def _decided_by(report: dict[str, Any]) -> str:
    """Return the failed tests, or the open ones of an inconclusive verdict; none of a pass."""
    tests, decision = report["tests"], report["verdict"]["decision"]
    if decision == "pass":
        return ""
    decisions = {"regret": tests["regret"]["decision"]}
    decisions |= {test["name"]: test["decision"] for test in tests["competence"]}
    return ", ".join(name for name, result in decisions.items() if result == decision)


def _or_blank(value: float | None) -> float | str:
    return "" if value is None else value


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Audits by world, policy and declared angle; counts of verdicts; the printed tables."""
    rows = tables["audits"]
    audits: dict[str, Any] = {}
    for row in rows:
        by_angle = audits.setdefault(row["world"], {}).setdefault(row["policy"], {})
        by_angle[f"{row['declared']:g}"] = row
    with_target = [row for row in rows if row["made_for"] != ""]
    by_truth = {
        kind: matching(with_target, truthful=truth)
        for kind, truth in (("truthful", 1), ("false", 0))
    }
    floor: dict[str, Any] = {}
    for row in tables["published_floor"]:
        floor.setdefault(row["policy"], {})[row["criterion"]] = row
    failing = {
        name: sum("fail" in column([*tests.values()], name) for tests in floor.values())
        for name in ("of_seeds", "of_episodes")
    }
    return {
        "audits": audits,
        "counts": {kind: _counts(group, "verdict") for kind, group in by_truth.items()},
        "angle_test": {kind: _counts(group, "calibration") for kind, group in by_truth.items()},
        "published": {
            "returns": {row["policy"]: row for row in tables["published_returns"]},
            "angles": {row["policy"]: row for row in tables["published_angles"]},
            "floor": floor,
            "floor_failing": failing,
            "policies": len(floor),
        },
    }


def _counts(rows: list[Row], name: str) -> dict[str, int]:
    decisions = column(rows, name)
    kinds = ("pass", "fail", "inconclusive")
    return {"audits": len(rows), **{kind: decisions.count(kind) for kind in kinds}}
