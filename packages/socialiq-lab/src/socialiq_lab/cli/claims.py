"""`claims`: verdicts on the thesis' claims."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

from socialiq.cli.output import Printing, print_json
from socialiq.errors import one_of
from socialiq.storage import packaged_results
from socialiq.types import Row
from socialiq_lab import claims


@dataclass(frozen=True)
class Claims(Printing):
    """Print each checkable claim of the thesis, the value found, and the verdict.

    Example: socialiq claims --verdict not
    """

    results: Path | None = None
    """Folder that holds results/STUDY; by default the packaged results."""
    verdict: str = ""
    """Only this verdict: reproduced, partly, not or untested."""
    study: str = ""
    """Only claims tested by this study."""

    def run(self) -> int:
        """Resolve the values and print."""
        rows = claims.ledger(self.results or packaged_results())
        if self.verdict:
            one_of("verdict", self.verdict, claims.VERDICTS)
            rows = [row for row in rows if row["verdict"] == self.verdict]
        if self.study:
            one_of("study", self.study, claims.STUDIES)
            rows = [row for row in rows if row["study"] == self.study]
        counts = claims.count(rows)
        if self.json:
            print_json({"counts": counts, "claims": rows})
            return 0
        for row in rows:
            print(described(row))
        print(", ".join(f"{number} {verdict}" for verdict, number in counts.items()))
        return 0


def described(row: Row) -> str:
    """Return a claim as a short paragraph."""
    lines = [f"[{row['verdict']}] {row['id']} ({row['place']})", row["statement"]]
    lines += [f"thesis: {row['thesis']}"]
    lines += [f"ours: {row['ours']}"] if row["ours"] else []
    lines += [f"under: {row['conditions']}"] if row["conditions"] else []
    lines += [f"because: {row['reason']}"] if row["reason"] else []
    lines += [f"command: {row['command']}{_where(row['command'])}"] if row["command"] else []
    wrapped = [lines[0], *(textwrap.fill(line, 96) for line in lines[1:])]
    return textwrap.indent("\n".join(wrapped), "  ")[2:] + "\n"


def _where(command: str) -> str:
    """Return the requirements of a command beside the package."""
    return " (in a checkout, after `make test`)" if command.startswith("pytest ") else ""
