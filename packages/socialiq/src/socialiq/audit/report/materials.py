"""Bill of materials of an audited policy, with the results of its audit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from socialiq.policies.card import Metric, bill_of_materials
from socialiq.policies.interface import Interface

_CODE = ("process", "python", "rule")
"""Kinds of policies that are not one file."""


def materials(report: Mapping[str, Any]) -> bytes:
    """Return the bill of materials as CycloneDX 1.7.

    Training data are not known to an audit, so they are left out.

    Args:
        report: Content of `report.json`.
    """
    record, declared = report["policy"]["record"], report["declaration"]
    verdict, hashes = report["verdict"], report["hashes"]
    is_file = record["kind"] not in _CODE
    return bill_of_materials(
        record["source"],
        str(report["versions"].get("socialiq", "")),
        file_sha256=record["sha256"] if is_file else "",
        inputs=f"{record['n_features']} numbers",
        outputs=Interface.of_json(record).answer,
        metrics=_metrics(report),
        limits=report["limits"],
        properties={
            "socialiq:kind": record["kind"],
            "socialiq:sha256": record["sha256"],
            "socialiq:hash-covers": record["covers"],
            "socialiq:declared-angle": declared["angle_rule"]["words"]
            if "angle_rule" in declared
            else f"{declared['angle']:g} degrees",
            "socialiq:decision": verdict["decision"],
            "socialiq:episodes": str(verdict["episodes"]),
            "socialiq:world": declared["scenario"]["world"],
            "socialiq:scenario-sha256": hashes["scenario"],
            "socialiq:reward-sha256": hashes["reward"],
            "socialiq:declaration-sha256": hashes["profile"],
        },
    )


def _metrics(report: Mapping[str, Any]) -> list[Metric]:
    tests = report["tests"]
    regret = tests["regret"]
    name = f"regret at {regret['angle']:g} degrees per episode"
    if "angle_rule" in report["declaration"]:
        name = "decision loss at the declared rule per episode"
    found = [_metric(name, regret, regret["regret"])]
    found += [_metric(f"share of {one['name']}", one, one["share"]) for one in tests["competence"]]
    return found


def _metric(name: str, test: Mapping[str, Any], value: float) -> Metric:
    return Metric(name, f"{value:.6g}", f"{test['low']:.6g}", f"{test['high']:.6g}")
