"""Audits of the thesis' printed tables, as far as they go, and of this project's own policies.

The thesis says that the recovered angle lets somebody else verify a declared one (7.1, 9.2). Here
that somebody is the audit: it hears what is declared and what was printed, or lets drive.
"""

from __future__ import annotations

import datetime
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialiq.audit.conduct import Request, conduct
from socialiq.audit.evidence.outcomes import check_episodes
from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.report.views import arcs
from socialiq.experiments.study import Context, Findings, StageCallback, counter, silent
from socialiq.studies.audits.policies import (
    GRIDWORLD,
    AuditedPolicy,
    at_intersection,
    exact_in_gridworld,
    of_gridworld,
    trained_in_gridworld,
)
from socialiq.studies.audits.published import floor_rows, learner_angle_rows, return_rows
from socialiq.types import Row

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
    """Audit, and compute_tables."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
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
    """Results of the printed numbers.

    Args:
        episodes: As if so many had been played, where the thesis doesn't say.
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
        policies: What is audited.
        config: Episodes and seed.
        folder: For the declarations.
        on_stage: Shows progress.
    """
    all_policies = list(policies)
    if not all_policies:
        return []
    count = counter(on_stage, f"audits, {all_policies[0].world}", len(all_policies), "audits")
    rows = []
    for done, one in enumerate(all_policies, start=1):
        rows.append(_audited(one, config, folder))
        count(done)
    return rows


def _audited(one: AuditedPolicy, config: Config, folder: Path) -> Row:
    """One audit, from its declaration to its row."""
    profile = folder / "profile.toml"
    margin = MARGINS[one.world]
    owner = "the study of audits"
    declared = declare(one.declared, owner, one.world, margin, DAY, competence=one.floor)
    # Without the template's comments, whose wording would otherwise decide the episodes.
    lines = [line for line in declared.source.splitlines() if line and not line.startswith(b"#")]
    profile.write_bytes(b"\n".join(lines))
    asked = Request(one.spec, profile, config.episodes, config.seed)
    return _row(one, conduct(asked, lambda _: None).report)


def _row(one: AuditedPolicy, report: dict[str, Any]) -> Row:
    tests, means = report["tests"], report["policy"]["means"]
    regret, shown, calibrated = tests["regret"], tests["alpha_hat"], tests["calibration"]
    return {
        "world": one.world,
        "policy": one.name,
        "made_for": "" if one.made_for is None else one.made_for,
        "declared": one.declared,
        "truthful": int(one.truthful),
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
        "min_arrival": one.floor.min_arrival,
        "explained": arcs(tests["rationalised"]["arcs"]),
        "alpha_hat": shown["angle"] if shown else "",
        "alpha_low": shown["low"] if shown else "",
        "alpha_high": shown["high"] if shown else "",
        "calibrated_low": _or_blank(calibrated["low"]),
        "calibrated_high": _or_blank(calibrated["high"]),
        "calibration": calibrated["decision"] if calibrated["low"] is not None else "none",
        "policy_sha256": report["hashes"]["policy"],
    }


def _decided_by(report: dict[str, Any]) -> str:
    """The tests that failed; of an open verdict those that are open; nothing of a pass."""
    tests, decision = report["tests"], report["verdict"]["decision"]
    found = [("regret", tests["regret"]["decision"])]
    found += [(one["name"], one["decision"]) for one in tests["competence"]]
    return (
        ""
        if decision == "pass"
        else ", ".join(name for name, result in found if result == decision)
    )


def _or_blank(value: float | None) -> float | str:
    return "" if value is None else value


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Every audit by world, policy and declared angle; and how the verdicts came out."""
    rows = tables["audits"]
    verdicts: dict[str, Any] = {}
    for row in rows:
        entry = verdicts.setdefault(row["world"], {}).setdefault(row["policy"], {})
        entry[f"{row['declared']:g}"] = row
    made = {
        kind: [row for row in rows if row["made_for"] != "" and row["truthful"] == truth]
        for kind, truth in (("truthful", 1), ("false", 0))
    }
    floor: dict[str, Any] = {}
    for row in tables["published_floor"]:
        floor.setdefault(row["policy"], {})[row["criterion"]] = row
    failing = {
        name: sum(any(one[name] == "fail" for one in rows.values()) for rows in floor.values())
        for name in ("of_seeds", "of_episodes")
    }
    return {
        "audits": verdicts,
        "counts": {kind: _counts(some, "verdict") for kind, some in made.items()},
        "angle_test": {kind: _counts(some, "calibration") for kind, some in made.items()},
        "published": {
            "returns": {row["policy"]: row for row in tables["published_returns"]},
            "angles": {row["policy"]: row for row in tables["published_angles"]},
            "floor": floor,
            "floor_failing": failing,
            "policies": len(floor),
        },
    }


def _counts(rows: list[Row], column: str) -> dict[str, int]:
    found = [row[column] for row in rows]
    kinds = ("pass", "fail", "inconclusive")
    return {"audits": len(rows), **{kind: found.count(kind) for kind in kinds}}
