"""The ledger of the thesis' claims: `claims.toml` joined with the committed results.

A claim's `ours` is text with places such as {grid:policies.baseline_greedy.angle:.1f}, that is
{study:path in results/STUDY/summary.json:format}. Our numbers therefore come from results files and
are never typed. A path that begins with `config` is one of the study's configuration. A claim with
a `value` also names the place of `our_value`, and a test compares its verdict with the two
(`claim_numbers`).
"""

from __future__ import annotations

import importlib.resources
import math
import re
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.storage import read_json
from socialiq_lab.claim_numbers import Ours, printed, tolerance, verdict

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
    "intersection": "socialiq reproduce intersection --set parts=main",
    "compare-priors": "socialiq reproduce compare-priors",
    "audits": "socialiq reproduce audits",
    "none": "",
}


def ledger(results: Path) -> list[dict[str, Any]]:
    """Return every claim with our value, in the order of the thesis.

    Args:
        results: Folder with a results folder for each study.

    Returns:
        Rows with `id`, `place`, `study`, `statement`, `thesis`, `ours`, `our_value` (a number or
        None), `value`, `tolerance` (of a printed mean with a spread: what standard errors explain),
        `from_numbers` (the verdict that the numbers give, None without), `command`, `verdict`,
        `conditions`, `reason`.

    Raises:
        UserError: If the results are missing, a place is not in them, or a tolerance is one that
            can't fail.
    """
    text = importlib.resources.files("socialiq_lab").joinpath("claims.toml").read_text()
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
        self.read: dict[Path, Any] = {}

    def at(self, study: str, path: str) -> Any:
        """Return the value at a dotted path; a dot inside a key is written as a comma."""
        file = self.results / study / ("config.json" if _of_config(path) else "summary.json")
        if file not in self.read:
            self.read[file] = read_json(file)
        value = self.read[file]
        for key in path.split("."):
            try:
                value = value[int(key)] if isinstance(value, list) else _item(value, key)
            except (KeyError, IndexError, ValueError, TypeError) as error:
                raise UserError(
                    f"claims.toml points at {study}:{path}, which {file} does not have"
                ) from error
        return value

    def number(self, claim: dict[str, Any], name: str, otherwise: float) -> float:
        """Return the number at the place that a field of a claim names; of a list its length."""
        reference = _PLACE.fullmatch(claim.get(name, ""))
        if reference is None:
            return otherwise
        value = self.at(*reference.groups()[:2])
        try:
            return float(len(value) if isinstance(value, list) else value)
        except (TypeError, ValueError) as error:
            raise UserError(f"{claim['id']}: {claim[name]} must be a number") from error


def _of_config(path: str) -> bool:
    return path.startswith("config.")


def _item(mapping: dict[str, Any], key: str) -> Any:
    return mapping[key] if key in mapping else mapping[key.replace(",", ".")]


def _row(claim: dict[str, Any], summaries: _Summaries) -> dict[str, Any]:
    one_of("verdict", claim["verdict"], VERDICTS)
    one_of("study", claim["study"], STUDIES)
    return {
        "id": claim["id"],
        "place": claim["place"],
        "study": claim["study"],
        "statement": claim["statement"],
        "thesis": claim["thesis"],
        "ours": resolve(claim.get("ours", ""), summaries),
        **_compared(claim, summaries),
        "command": claim.get("command", _COMMANDS[claim["study"]]),
        "verdict": claim["verdict"],
        "conditions": claim.get("conditions", ""),
        "reason": resolve(claim["reason"], summaries),
    }


def _compared(claim: dict[str, Any], summaries: _Summaries) -> dict[str, Any]:
    """Return the numbers of a claim of one number, and the verdict that follows from them."""
    value = claim.get("value")
    numbers = {"our_value": None, "value": value, "tolerance": None, "from_numbers": None}
    if value is None:
        return numbers
    thesis = printed(claim)
    if "our_value" not in claim:
        return numbers | {"tolerance": claim.get("tolerance")}
    ours = Ours(
        summaries.number(claim, "our_value", math.nan),
        summaries.number(claim, "our_spread", 0.0),
        summaries.number(claim, "our_count", 1.0) / summaries.number(claim, "our_group", 1.0),
    )
    allowed = claim["tolerance"] if thesis.spread is None else tolerance(thesis, ours)
    if thesis.spread is None:
        result = "reproduced" if abs(ours.value - value) <= allowed else "not"
    else:
        result = verdict(thesis, ours)
    return numbers | {"our_value": ours.value, "tolerance": allowed, "from_numbers": result}
