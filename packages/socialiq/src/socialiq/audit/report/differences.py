"""Places where two reports differ."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Set
from typing import Any

from socialiq.audit.report.auditor_claims import ALWAYS, OF_CODE

OF_A_RERUN = frozenset(f"report.{path}" for path in (*ALWAYS, *OF_CODE)) | {
    # These follow from others, of which a rerun compares the decision.
    "report.caveats",
    "report.consistency",
    "report.references[].record.isolation",
    "report.left_out[].record.isolation",
    "report.episodes.median[].film",
    "report.episodes.worst[].film",
}
"""Places that may differ in a rerun: claims of the auditor, isolation, films."""


def differences(
    old: Any,
    new: Any,
    ignored: Set[str] = OF_A_RERUN,
    relative: float = 0.0,
) -> list[str]:
    """Return the places where two reports differ, those of the verdict and its tests first.

    Args:
        old: Content of a `report.json`.
        new: The same of another.
        ignored: Places that are not compared, with [] for every row of a list.
        relative: Largest difference of two numbers that are not both integers, as a share of the
            larger, or of 1 if both are smaller. By default numbers must agree to the last digit,
            as they do on the same machine with the same versions.
    """
    return sorted(_differences(old, new, ignored, relative, "report"), key=_rank)


_FIRST = ("report.verdict", "report.tests.regret", "report.tests.competence", "report.tests")


def _rank(place: str) -> int:
    """Return a number that is smaller for a place that matters more."""
    found = (number for number, above in enumerate(_FIRST) if place.startswith(above))
    return next(found, len(_FIRST))


def _differences(old: Any, new: Any, ignored: Set[str], relative: float, place: str) -> list[str]:
    """Return the places below one place, in the order of the fields' names."""
    if _ROW.sub("[]", place) in ignored:
        return []
    if isinstance(old, dict) and isinstance(new, dict):
        missing = object()
        pairs = [
            (old.get(name, missing), new.get(name, missing), f"{place}.{name}")
            for name in sorted(old.keys() | new.keys())
        ]
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = [(*pair, f"{place}[{row}]") for row, pair in enumerate(zip(old, new, strict=True))]
    else:
        return [] if _same(old, new, relative) else [place]
    return [
        found
        for one, other, below in pairs
        for found in _differences(one, other, ignored, relative, below)
    ]


_ROW = re.compile(r"\[\d+\]")


def _same(old: Any, new: Any, relative: float) -> bool:
    if relative and {type(old), type(new)} in ({float}, {float, int}):
        return math.isclose(old, new, rel_tol=relative, abs_tol=relative)
    return _text(old) == _text(new)


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=str)
