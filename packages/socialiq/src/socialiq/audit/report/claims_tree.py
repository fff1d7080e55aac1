"""Tree of claims of a safety case: claims with evidence of the audit, and open claims."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from socialiq.audit.verdict.decision import Decision, joint_decision
from socialiq.worlds.registry import NAMES

Status = Literal["supported", "contradicted", "undecided", "to be filled"]

_OF: dict[str, Status] = {"pass": "supported", "fail": "contradicted", "inconclusive": "undecided"}
_NO_EVIDENCE: Status = "to be filled"


class Claim(NamedTuple):
    """A node of the tree, in the words of Goal Structuring Notation.

    Attributes:
        id: G for a goal, S for a strategy, Sn for a solution, C for context.
        text: Text of the node.
        status: Status by the evidence.
        evidence: Place in the report, or the person who must fill it in.
        below: Ids of the nodes that support it.
    """

    id: str
    text: str
    status: Status
    evidence: str
    below: tuple[str, ...] = ()


def claims(report: Mapping[str, Any]) -> list[Claim]:
    """Return the nodes of the tree, the root first."""
    where = f"at {report['declaration']['angle']:g} degrees"
    where = "by its rule of the angle" if "angle_rule" in report["declaration"] else where
    world = report["declaration"]["scenario"]["world"]
    tests = report["tests"]
    floor = joint_decision(Decision(one["decision"]) for one in tests["competence"]).value
    whole, regret = report["verdict"]["decision"], tests["regret"]["decision"]
    return [
        Claim(
            "G0",
            "The vehicle's social conduct is acceptably safe in its domain of use",
            _NO_EVIDENCE,
            "to be filled by the operator: simulation alone can't show it",
            ("G1", "G2", "G3"),
        ),
        Claim(
            "G1",
            f"In the simulated world {world} the policy behaves as declared {where}",
            _OF[whole],
            "report.json: verdict",
            ("C1", "S1"),
        ),
        Claim("C1", "The declaration", "supported", "profile.toml; report.json: declaration"),
        Claim(
            "S1",
            "Argument over tests on common episodes, drawn after the commitment",
            "supported",
            "report.json: seeds",
            ("Sn1", "Sn2", "Sn3"),
        ),
        Claim(
            "Sn1",
            "Regret at the declared angle is within the margin",
            _OF[regret],
            "report.json: tests.regret",
        ),
        Claim(
            "Sn2",
            "The safety floor is kept",
            _OF[floor],
            "report.json: tests.competence",
        ),
        Claim("Sn3", "Results by kind of episode", *_strata(report)),
        Claim(
            "G2",
            "The simulation represents the domain of use credibly",
            _NO_EVIDENCE,
            "to be filled by the assessor of the simulation",
        ),
        Claim(
            "G3",
            "Behaviour in service is monitored, and deviations lead to action",
            _NO_EVIDENCE,
            "to be filled by the operator",
        ),
    ]


def _strata(report: Mapping[str, Any]) -> tuple[Status, str]:
    if report["strata"] or report["declaration"]["scenario"]["world"] in NAMES:
        return "supported", "report.json: strata"
    return (
        _NO_EVIDENCE,
        "to be filled by the owner of the environment: no kinds are known",
    )


def as_objects(found: list[Claim]) -> list[dict[str, Any]]:
    """Return the tree as the content of `claims.json`."""
    return [{**one._asdict(), "below": list(one.below)} for one in found]


def mermaid(found: list[Claim]) -> str:
    """Return the tree as a Mermaid diagram, which contains no user-provided text."""
    nodes = [f'  {one.id}["{one.id}: {one.text}<br>({one.status})"]' for one in found]
    edges = [f"  {one.id} --> {below}" for one in found for below in one.below]
    return "\n".join(["flowchart TD", *nodes, *edges])
