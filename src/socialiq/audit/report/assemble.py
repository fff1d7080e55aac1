"""Every file of a report's folder, from one audit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from socialiq.audit.outcomes import Evidence
from socialiq.audit.profile import Profile
from socialiq.audit.report.claims_tree import as_objects, claims, mermaid
from socialiq.audit.report.evidence_csv import evidence_csv
from socialiq.audit.report.folder import REPORT
from socialiq.audit.report.manifest import sealed
from socialiq.audit.report.views import Ready, html, markdown

EVIDENCE, PROFILE = "episodes.csv", "profile.toml"


def files_of(
    report: Mapping[str, Any],
    profile: Profile,
    evidence: Evidence,
    films: Mapping[str, bytes] | None = None,
) -> dict[str, bytes]:
    """Content by path in the folder, seals included.

    Args:
        report: Content of `report.json`.
        profile: The declaration, which comes along byte by byte.
        evidence: Every episode.
        films: Of single episodes, by path.
    """
    text = json.dumps(report, indent=2, allow_nan=False) + "\n"
    found = {
        REPORT: text.encode(),
        PROFILE: profile.source,
        EVIDENCE: evidence_csv(evidence).encode(),
        **(films or {}),
        **views_of(json.loads(text)),
    }
    return sealed(found, report)


def views_of(report: Mapping[str, Any]) -> dict[str, bytes]:
    """What is made from the report alone, and can be made again by anybody who has it."""
    tree = claims(report)
    diagram = Ready(mermaid(tree))
    return {
        "report.html": html(report).encode(),
        "report.md": markdown(report).encode(),
        "annex-iv.md": markdown(report, "annex-iv.md.j2").encode(),
        "nist-ai-rmf.md": markdown(report, "nist-ai-rmf.md.j2").encode(),
        "safety-case.md": markdown(
            report, "safety-case.md.j2", claims=tree, diagram=diagram
        ).encode(),
        "claims.json": (json.dumps(as_objects(tree), indent=2) + "\n").encode(),
    }
