"""The ledger of the thesis' claims: `claims.toml` joined with the committed results.

A claim's `ours` is text with places such as {grid:policies.baseline_greedy.angle:.1f}, that is
{study:path in results/STUDY/summary.json:format}. Our numbers therefore come from results files and
are never typed. A claim with `value` and `tolerance` also names the place of `our_value`, and a
test compares its verdict with the two.
"""

from __future__ import annotations

import importlib.resources
import re
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.storage import read_json

VERDICTS = ("reproduced", "partly", "not", "untested")
STUDIES = (
    "poc",
    "grid",
    "lambda-sweep",
    "worlds",
    "alternatives",
    "penalties",
    "theory",
    "intersection-world",
    "intersection",
    "compare-priors",
    "audits",
    "competence",
    "none",
)

_PLACE = re.compile(r"\{([a-z-]+):([^:}]+)(?::([^}]*))?\}")

_COMMANDS = {
    "poc": "socialiq reproduce poc",
    "grid": "socialiq reproduce grid",
    "lambda-sweep": "socialiq reproduce lambda-sweep",
    "worlds": "socialiq reproduce worlds",
    "alternatives": "socialiq reproduce alternatives",
    "penalties": "socialiq reproduce penalties",
    "theory": "pytest tests/identities",
    "intersection-world": "socialiq reproduce intersection-world",
    "intersection": "socialiq reproduce intersection --parts main",
    "compare-priors": "socialiq compare priors",
    "audits": "socialiq reproduce audits",
    "competence": "socialiq reproduce competence",
    "none": "",
}


def ledger(results: Path) -> list[dict[str, Any]]:
    """Return every claim with our value, in the order of the thesis.

    Args:
        results: Folder with a results folder for each study.

    Returns:
        Rows with `id`, `place`, `study`, `statement`, `thesis`, `ours`, `our_value` (a number or
        None), `value`, `tolerance`, `command`, `verdict`, `reason`.

    Raises:
        UserError: If the results are missing, or a place is not in them.
    """
    text = importlib.resources.files("socialiq.experiments").joinpath("claims.toml").read_text()
    summaries = _Summaries(results)
    return [_row(claim, summaries) for claim in tomllib.loads(text)["claim"]]


def count(rows: list[dict[str, Any]]) -> dict[str, int]:
    """Return the number of claims by verdict."""
    counts = Counter(row["verdict"] for row in rows)
    return {verdict: counts[verdict] for verdict in VERDICTS}


def resolve(text: str, summaries: _Summaries) -> str:
    """Return a text with its places filled from the results."""

    def fill(match: re.Match[str]) -> str:
        study, path, form = match.groups()
        return format(summaries.at(study, path), form or "")

    return _PLACE.sub(fill, text)


class _Summaries:
    """Summaries of the studies, each read at its first use."""

    def __init__(self, results: Path) -> None:
        self.results = results
        self.read: dict[str, Any] = {}

    def at(self, study: str, path: str) -> Any:
        """Return the value at a dotted path; a dot inside a key is written as a comma."""
        if study not in self.read:
            self.read[study] = read_json(self.results / study / "summary.json")
        value = self.read[study]
        for key in path.split("."):
            try:
                value = value[int(key)] if isinstance(value, list) else _item(value, key)
            except (KeyError, IndexError, ValueError, TypeError) as error:
                raise UserError(
                    f"claims.toml points at {study}:{path}, which "
                    f"{self.results / study / 'summary.json'} does not have"
                ) from error
        return value


def _item(mapping: dict[str, Any], key: str) -> Any:
    return mapping[key] if key in mapping else mapping[key.replace(",", ".")]


def _row(claim: dict[str, Any], summaries: _Summaries) -> dict[str, Any]:
    one_of("verdict", claim["verdict"], VERDICTS)
    one_of("study", claim["study"], STUDIES)
    place = _PLACE.fullmatch(claim.get("our_value", ""))
    return {
        "id": claim["id"],
        "place": claim["place"],
        "study": claim["study"],
        "statement": claim["statement"],
        "thesis": claim["thesis"],
        "ours": resolve(claim.get("ours", ""), summaries),
        "our_value": float(summaries.at(*place.groups()[:2])) if place else None,
        "value": claim.get("value"),
        "tolerance": claim.get("tolerance"),
        "command": claim.get("command", _COMMANDS[claim["study"]]),
        "verdict": claim["verdict"],
        "reason": resolve(claim["reason"], summaries),
    }
