"""Audits of the thesis' printed tables and of this project's policies.

The thesis says that a recovered angle allows others to verify a declared one (7.1, 9.2).
"""

import datetime
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from socialiq import Margin, declare
from socialiq.audit.conduct import conduct
from socialiq.audit.profile.template import USUAL
from socialiq.audit.report.views import arcs
from socialiq.audit.request import Request
from socialiq.audit.seeds import check_episodes
from socialiq.types import Row
from socialiq_lab.study import Context, Findings, StageCallback, silent, tracked
from socialiq_lab.tables import column, matching
from studies.audits import policies as audited
from studies.audits import published
from studies.audits.policies import GRIDWORLD, AuditedPolicy

DAY = datetime.date(2026, 11, 1)
PUBLISHED = Margin(1.0, 10.0)
"""Margins of the printed numbers: of regret, reward per episode, and of the angle, degrees."""
ERROR = 0.05


def compute_tables(config: Any, context: Context) -> Findings:
    """Audit the policies of each world and the printed tables."""
    check_episodes(config.episodes)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        how = config.episodes, config.seed, folder, context.on_stage
        if "intersection" in config.worlds:
            rows += audit_rows(list(audited.at_intersection(folder)), *how)
        if GRIDWORLD in config.worlds:
            trained = folder / GRIDWORLD
            trained.mkdir()
            updates = config.updates, config.dial_updates
            audited.exact_in_gridworld(trained)
            audited.trained_in_gridworld(trained, config.training_seed, updates, context.on_stage)
            rows += audit_rows(list(audited.of_gridworld(trained, config.dial_angles)), *how)
    tables = {"audits": rows, **published_tables(config.published_episodes)}
    return Findings(tables, _summary(tables))


def published_tables(episodes: int) -> dict[str, list[Row]]:
    """Return the tables of the printed numbers, for this many episodes where none are stated."""
    return {
        "published_returns": published.return_rows(PUBLISHED, ERROR, episodes),
        "published_angles": published.learner_angle_rows(PUBLISHED),
        "published_floor": published.floor_rows(ERROR, episodes),
    }


def audit_rows(
    policies: Sequence[AuditedPolicy],
    episodes: int,
    seed: int,
    folder: Path,
    on_stage: StageCallback = silent,
) -> list[Row]:
    """Declare and audit each policy, all of one world, in a folder; return a row for each."""
    rows, profile = [], folder / "profile.toml"
    for policy in tracked(policies, on_stage, f"audits, {policies[0].world}", "audits"):
        usual, floor = USUAL[policy.world], policy.floor
        margin = Margin(usual.margin, None, None, usual.width, usual.beyond)
        who = "the study of audits", policy.world
        declared = declare(policy.declared, *who, margin, DAY, competence=floor, clip=usual.clip)
        # Without the template's comments, whose wording would otherwise determine the episodes.
        lines = [line for line in declared.source.splitlines() if line and line[:1] != b"#"]
        profile.write_bytes(b"\n".join(lines))
        request = Request(policy.spec, profile, episodes, seed)
        report = conduct(request, lambda _: None).report
        tests, means, decision = report["tests"], report["policy"]["means"], report["verdict"]
        regret, angle, direction = tests["regret"], tests["alpha_hat"], tests["direction"]
        decisions = {name: tests[name]["decision"] for name in ("regret", "direction", "character")}
        decisions |= {test["name"]: test["decision"] for test in tests["competence"]}
        # The failed tests, or the open ones of an inconclusive verdict; none of a pass.
        deciding = [name for name, result in decisions.items() if result == decision["decision"]]
        row = {
            "world": policy.world,
            "policy": policy.name,
            "made_for": policy.made_for,
            "declared": policy.declared,
            "truthful": int(policy.truthful),
            "verdict": decision["decision"],
            "decided_by": "" if decision["decision"] == "pass" else ", ".join(deciding),
            "needed": decision["needed"] or "",
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
            "direction_above": direction["above"],
            "direction_below": direction["below"],
            "direction": direction["decision"],
            "character": tests["character"]["decision"],
            "policy_sha256": report["hashes"]["policy"],
        }
        rows.append({name: "" if value is None else value for name, value in row.items()})
    return rows


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Audits by world, policy and declared angle; counts of verdicts; the printed tables."""
    audits: dict[str, Any] = {}
    for row in tables["audits"]:
        by_angle = audits.setdefault(row["world"], {}).setdefault(row["policy"], {})
        by_angle[f"{row['declared']:g}"] = row
    floor: dict[str, Any] = {}
    for row in tables["published_floor"]:
        floor.setdefault(row["policy"], {})[row["criterion"]] = row
    failing = {
        name: sum("fail" in column([*tests.values()], name) for tests in floor.values())
        for name in ("of_seeds", "of_episodes")
    }

    def counts(name: str) -> dict[str, dict[str, int]]:
        """Count decisions on policies with a target, by whether they are rightly declared."""
        result = {}
        for kind, truth in (("truthful", 1), ("false", 0)):
            rows = [row for row in tables["audits"] if row["made_for"] != ""]
            decisions = column(matching(rows, truthful=truth), name)
            kinds = {kind: decisions.count(kind) for kind in ("pass", "fail", "inconclusive")}
            result[kind] = {"audits": len(decisions), **kinds}
        return result

    return {
        "audits": audits,
        "counts": counts("verdict"),
        "angle_test": counts("direction"),
        "published": {
            "returns": {row["policy"]: row for row in tables["published_returns"]},
            "angles": {row["policy"]: row for row in tables["published_angles"]},
            "floor": floor,
            "floor_failing": failing,
            "policies": len(floor),
        },
    }
