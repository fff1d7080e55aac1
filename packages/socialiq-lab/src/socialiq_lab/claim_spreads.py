"""Printed standard deviations of the thesis beside ours, by ratios of variances.

A claim of `claims.toml` with `spreads_of`, a pattern of ids, is judged by the spreads of the claims
with these ids. Its verdict is "not" if the interval of no ratio contains 1, "reproduced" if every
one does and is narrow enough to say so, else "partly".
"""

import re
from collections.abc import Callable, Mapping
from typing import Any

from socialiq.statistics.intervals import variance_ratio

PRINTED = {"seeds": 5, "episodes": 100}
"""Values behind a printed standard deviation. The thesis names five evaluation seeds, and for Table
A.1 no number of episodes: 100 is taken, with which the interval is wider than with more."""
CONFIDENCE = 0.95
"""Of all intervals of a claim together, by Bonferroni."""

WIDEST = 16.0
"""Ratio of the ends of an interval from which on it decides nothing: a deviation of four times the
other one lies within it."""

Claim = Mapping[str, Any]
At = Callable[[str, str], Any]
"""Value of a study's results at a path."""


def compared(claim: Claim, claims: Mapping[str, Claim], at: At) -> dict[str, str]:
    """Return our spreads beside the printed ones, with our experts and with matched ones.

    Args:
        claim: Claim with `spreads_of`.
        claims: Every claim by its id.
        at: Reads the results.

    Returns:
        `ours` and `from_numbers`, `matched` and `verdict_matched`.
    """
    pattern = claim["spreads_of"]
    cells = [cell for name, cell in claims.items() if re.fullmatch(pattern, name)]
    cells = [cell for cell in cells if cell.get("spread")]
    ours, result = _judged(cells, "intersection", at)
    matched, verdict_matched = _judged(cells, "expert-strength", at)
    judged = {"matched": matched, "verdict_matched": verdict_matched}
    return {"ours": ours, "from_numbers": result} | judged


def _judged(cells: list[Claim], study: str, at: At) -> tuple[str, str]:
    """Return the ratios of the cells as text, and the verdict."""
    confidence = 1.0 - (1.0 - CONFIDENCE) / len(cells)
    words = []
    ratios = []
    for cell in cells:
        deviation, degrees = spread_in(study, cell, at)
        of_thesis = PRINTED[cell["spread_of"]] - 1
        ratio = variance_ratio((deviation, degrees), (cell["spread"], of_thesis), confidence)
        ratios.append(ratio)
        ends = f"{ratio.low:.2f} to {ratio.high:.2f}, F({degrees}, {of_thesis})"
        words.append(f"{deviation:.2f} for {cell['spread']:g}: {ratio.value:.2f} ({ends})")
    equal = [ratio for ratio in ratios if ratio.low <= 1.0 <= ratio.high]
    decide = all(ratio.high <= WIDEST * ratio.low for ratio in equal)
    every = len(equal) == len(ratios) and decide
    verdict = "reproduced" if every else "partly" if equal else "not"
    counts = f"{len(equal)} of {len(ratios)} intervals contain 1"
    return f"ours for the thesis', ratio of variances: {', '.join(words)}; {counts}", verdict


def spread_in(study: str, cell: Claim, at: At) -> tuple[float, int]:
    """Return our deviation of a cell of Table 6.2 or A.1, with its degrees of freedom.

    Args:
        study: "intersection", or "expert-strength" with experts like the thesis'.
        cell: Claim of a printed mean with a spread, whose `our_value` is a place of the first.
        at: Reads the results.
    """
    path = cell["our_value"].strip("{}").partition(":")[2].split(".")
    matched = study == "expert-strength"
    policies = len(at(study, "config.trios")) if matched else 1
    if cell["spread_of"] == "episodes":
        path[-1] = "ours_sd" if matched else "sd"
        values = at(study, "config.pool_episodes")
    else:
        path[-1] = "over_evaluation"
        values = at(study, "config.evaluation_seeds")
        if not path[2].startswith("expert"):
            policies *= len(at(study, "config.seeds"))
        if matched:
            del path[1]  # the preset
    return float(at(study, ".".join(path))), policies * (values - 1)
