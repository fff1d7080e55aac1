"""The evidence as a table: a row for each episode, all drivers side by side."""

from __future__ import annotations

import csv
import io

from socialiq.audit.outcomes import Evidence
from socialiq.audit.report.selected import kind_of_ending


def evidence_csv(evidence: Evidence) -> str:
    """CSV with the seed, the strata, and what the policy and each reference earned.

    Numbers are written so that they read back exactly.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_head(evidence))
    drivers = [one.totals.tolist() for one in (evidence.policy, *evidence.references)]
    strata = [labels.tolist() for labels in evidence.strata.values()]
    seeds, lengths = evidence.seeds.tolist(), evidence.policy.length.tolist()
    for place in range(evidence.episodes):
        writer.writerow(
            [
                place,
                seeds[place],
                *(labels[place] for labels in strata),
                kind_of_ending(evidence.policy, place),
                lengths[place],
                *(number for totals in drivers for number in totals[place]),
            ]
        )
    return text.getvalue()


def _head(evidence: Evidence) -> list[str]:
    names = [evidence.policy.name, *(_plain(one.name) for one in evidence.references)]
    earned = [f"{name}.{side}" for name in names for side in ("r_env", "r_social")]
    return ["episode", "seed", *evidence.strata, "ending", "decisions", *earned]


def _plain(name: str) -> str:
    """A name that no spreadsheet takes for a formula."""
    return f"'{name}" if name[:1] in "=+-@\t\r" else name
