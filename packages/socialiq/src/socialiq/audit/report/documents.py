"""Further documents of a report: credibility of the simulation, tree of claims, bill of materials.

Simulation is evidence as far as its scope, its assumptions, its uncertainty and its validation are
known. This module has the facts about the package's own worlds; an environment's are its owner's.
"""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

from socialiq.audit.profile.profile import is_recorded, measured_in
from socialiq.audit.report.words import stated
from socialiq.audit.verdict.decision import Decision, joint_decision
from socialiq.policies.card import Metric, bill_of_materials
from socialiq.policies.interface import Interface
from socialiq.types import Json
from socialiq.worlds.catalogue import GRIDS, INTERSECTION, KNOWN, base

CONTINUOUS = "intersection with continuous actions"
JUNCTION = "recorded junction"


def losses_decide(report: Json) -> bool:
    """Whether decision losses decide (`Profile.losses_decide`)."""
    declared = report["declaration"]
    return "angle_rule" in declared and declared["margin"]["width"] is None


def shows_angle(report: Json) -> bool:
    """Whether a pass shows the declared angle, or rule: no trivial driver passes, nor a neighbour.

    Without a declared width drivers of other angles pass too, and by a rule whose angles no width
    holds those that never meet its conditions.
    """
    direction = report["tests"]["direction"]
    directed = direction is not None and direction["decision"] is not None
    return directed and not report["discrimination"]["trivial_passes"]


def credibility(report: Json) -> Json:
    """Return the facts for the page `credibility.md`.

    `kind` is `INTERSECTION`, `CONTINUOUS`, `JUNCTION`, "gridworld" or "environment"; `assumptions`
    are sentences; `conformance` is the comparison with highway-env, if the world is the
    intersection, and `beyond` has the declared options that were not part of it.
    """
    scenario = report["declaration"]["scenario"]
    world = scenario["world"]
    kind = "gridworld" if base(world) in GRIDS else "environment"
    if base(world) == INTERSECTION:
        kind = INTERSECTION if world == INTERSECTION else CONTINUOUS
    if is_recorded(world):
        kind = JUNCTION
    compared = stated()["conformance"]
    beyond = [name for name in scenario["options"] if name not in compared["compared"]]
    return {
        "kind": kind,
        "assumptions": stated()["assumptions"].get(kind, []),
        "conformance": compared if kind == INTERSECTION else None,
        "beyond": beyond if kind == INTERSECTION else [],
    }


Status = Literal["supported", "contradicted", "undecided", "to be filled"]
_OF: dict[str, Status] = {"pass": "supported", "fail": "contradicted", "inconclusive": "undecided"}
_NO_EVIDENCE: Status = "to be filled"


class Claim(NamedTuple):
    """A node of the tree, in the words of Goal Structuring Notation."""

    id: str  # G for a goal, S for a strategy, Sn for a solution, C for context
    text: str
    status: Status  # by the evidence
    evidence: str  # place in the report, or the person who must fill it in
    below: tuple[str, ...] = ()  # ids of the nodes that support it


def claims(report: Json) -> list[Claim]:
    """Return the nodes of the tree, the root first."""
    where = f"at {report['declaration']['angle']:g} degrees"
    where = "by its rule of the angle" if losses_decide(report) else where
    world = report["declaration"]["scenario"]["world"]
    tests = report["tests"]
    floor = joint_decision(Decision(test["decision"]) for test in tests["competence"]).value
    bounded = "caused" in report["declaration"]
    limits = f"The safety floor {'and the bounds of effects are' if bounded else 'is'} kept"
    verdict = report["verdict"]["decision"]
    regret = tests["regret"]["decision"]
    verdict = "inconclusive" if verdict == "pass" and not shows_angle(report) else verdict
    strata: tuple[Status, str] = ("supported", "report.json: strata")
    if not report["strata"] and base(world) not in KNOWN:
        strata = _NO_EVIDENCE, "to be filled by the owner of the environment: no kinds are known"
    return [
        Claim(
            "G0",
            "The policy's social conduct is acceptably safe in its domain of use",
            _NO_EVIDENCE,
            "to be filled by the operator: simulation alone can't show it",
            ("G1", "G2", "G3"),
        ),
        Claim(
            "G1",
            f"In the simulated world {world} the policy behaves as declared {where}",
            _OF[verdict],
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
        Claim("Sn2", limits, _OF[floor], "report.json: tests.competence"),
        Claim("Sn3", "Results by kind of episode", *strata),
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


def mermaid(tree: list[Claim]) -> str:
    """Return the tree as a Mermaid diagram; the world's name in it may be a user's."""
    texts = [
        re.sub(r"[^\w .,:/()'-]", lambda mark: f"#{ord(mark[0])};", claim.text) for claim in tree
    ]
    nodes = [
        f'  {claim.id}["{claim.id}: {text}<br>({claim.status})"]'
        for claim, text in zip(tree, texts, strict=True)
    ]
    edges = [f"  {claim.id} --> {below}" for claim in tree for below in claim.below]
    return "\n".join(["flowchart TD", *nodes, *edges])


_CODE = ("process", "python", "rule")  # kinds of policies that are not one file


def materials(report: Json) -> bytes:
    """Return the bill of materials as CycloneDX 1.7.

    Training data are not known to an audit, so they are left out.
    """
    record = report["policy"]["record"]
    declared = report["declaration"]
    verdict = report["verdict"]
    hashes = report["hashes"]
    is_file = record["kind"] not in _CODE
    regret = report["tests"]["regret"]
    competence = report["tests"]["competence"]
    angle = f"{declared['angle']:g} degrees"
    name = f"regret at {regret['angle']:g} degrees per episode"
    if losses_decide(report):
        angle = declared["angle_rule"]["words"]
        name = "decision loss at the declared rule per episode"
    measured = [(name, regret["regret"], regret)]
    units = measured_in(declared["scenario"]["world"])
    for test in competence:
        unit = units.get(test["name"])
        name = f"{test['name']} per episode, {unit}" if unit else f"share of {test['name']}"
        measured.append((name, test["share"], test))
    return bill_of_materials(
        record["source"],
        str(report["versions"].get("socialiq", "")),
        file_sha256=record["sha256"] if is_file else "",
        inputs=f"{record['n_features']} numbers",
        outputs=Interface.of_json(record).answer,
        metrics=[
            Metric(name, f"{value:.6g}", f"{test['low']:.6g}", f"{test['high']:.6g}")
            for name, value, test in measured
        ],
        limits=report["limits"],
        properties={
            "socialiq:kind": record["kind"],
            "socialiq:sha256": record["sha256"],
            "socialiq:hash-covers": record["covers"],
            "socialiq:declared-angle": angle,
            "socialiq:decision": verdict["decision"],
            "socialiq:episodes": str(verdict["episodes"]),
            "socialiq:world": declared["scenario"]["world"],
            "socialiq:scenario-sha256": hashes["scenario"],
            "socialiq:reward-sha256": hashes["reward"],
            "socialiq:declaration-sha256": hashes["profile"],
        },
    )
