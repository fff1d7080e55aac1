"""`audit across`: one verdict on a policy that was audited in several scenarios (9.5)."""

import sys
from dataclasses import dataclass
from pathlib import Path

from socialiq.audit.report import verify
from socialiq.audit.report.content import EXIT_CODES
from socialiq.audit.report.documents import shows_angle
from socialiq.audit.report.views import VERDICTS
from socialiq.audit.verdict.decision import Decision, joint_decision
from socialiq.cli.output import Printing, print_json, print_table
from socialiq.cli.parser import Paths
from socialiq.errors import UserError
from socialiq.types import Json, Row


@dataclass(frozen=True)
class Across(Printing):
    """Give one verdict on a policy that was audited in several scenarios by one declaration.

    Owner, policy, angle, margins, limits of rewards, floor and bounds are the same in all. It
    passes if every audit passes, and fails if one fails. A policy that is not as declared in one of
    the scenarios passes with at most the error of the audit there, so no error is divided; an
    honest one fails with at most the sum of the errors. Exit status as of `socialiq audit`.

    Example: socialiq audit across audit-usual audit-dense
    """

    folders: Paths
    """Report folders, of `socialiq audit --out`: one for each scenario."""

    def run(self) -> int:
        """Check the folders, print a row for each and the verdict."""
        if len(self.folders) < 2:
            raise UserError("one verdict needs two or more folders: name one for each scenario")
        checked = [verify.check_folder(folder) for folder in self.folders]
        for folder, findings in zip(self.folders, checked, strict=True):
            if wrong := [*findings.faults, *findings.not_checked]:
                raise UserError(f"{folder}: {wrong[0]}: see `socialiq audit verify {folder}`")
        folders = zip(self.folders, checked, strict=True)
        reports = [verify.report_of(findings.files, folder) for folder, findings in folders]
        for what, identity in _IDENTITIES.items():
            for folder, report in zip(self.folders[1:], reports[1:], strict=True):
                if identity(report) != identity(reports[0]):
                    raise UserError(f"{folder} and {self.folders[0]} have not the same {what}")
        scenarios = [report["hashes"]["scenario"] for report in reports]
        for number, folder in enumerate(self.folders):
            if scenarios[number] in scenarios[:number]:
                first = self.folders[scenarios.index(scenarios[number])]
                raise UserError(f"{folder} and {first} are of one scenario: name each once")
        rows = [_row(folder, report) for folder, report in zip(self.folders, reports, strict=True)]
        decision = joint_decision(Decision(row["verdict"]) for row in rows)
        error = max(1.0 - report["declaration"]["confidence"] for report in reports)
        unlogged = [str(row["folder"]) for row in rows if row["look"] == ""]
        result = {"decision": decision.value, "error": round(error, 9), "scenarios": rows}
        notes: dict[str, list[str]] = {}  # folders by text
        for folder, report in zip(self.folders, reports, strict=True):
            for caveat in report["caveats"]:
                notes.setdefault(caveat["text"], []).append(str(folder))
        if self.json:
            caveats = [{"text": text, "folders": names} for text, names in notes.items()]
            print_json(result | {"without_log": unlogged, "caveats": caveats})
            return EXIT_CODES[decision]
        print_table(rows)
        sys.stdout.write(
            f"{decision.headline} across {len(rows)} scenarios; who is not as declared in one of "
            f"them passes with a chance of at most {100 * error:g} %.\n"
        )
        if decision is Decision.PASS and not all(map(shows_angle, reports)):
            sys.stdout.write(f"{VERDICTS['kept']}.\n")
        for text, names in notes.items():
            sys.stdout.write(f"Note ({', '.join(names)}): {text}\n")
        if unlogged:
            sys.stdout.write(f"Without a log earlier tries aren't counted: {', '.join(unlogged)}\n")
        return EXIT_CODES[decision]


def _margins(report: Json) -> Json:
    """Return the margins but the largest loss, which follows from the rewards of a scenario."""
    return {**report["declaration"]["margin"], "largest_loss": None}


_IDENTITIES: Json = {
    "owner": lambda report: report["declaration"]["owner"],
    "policy": lambda report: (report["hashes"]["policy"], report["policy"]["deterministic"]),
    "declared angle": lambda report: [
        report["declaration"].get(name) for name in ("angle", "angle_rule")
    ],
    "confidence": lambda report: report["declaration"]["confidence"],
    "margins and width": _margins,
    "clip": lambda report: report["declaration"]["clip"],
    "safety floor": lambda report: report["declaration"]["competence"],
    "bounds of effects": lambda report: report["declaration"].get("caused"),
    "version of socialiq": lambda report: report["hashes"]["package"],
}
"""Parts of a report, by name, that all reports must share."""


def _row(folder: Path, report: Json) -> Row:
    scenario = report["declaration"]["scenario"]
    look = report["look"]
    options = ", ".join(f"{name} {value}" for name, value in scenario["options"].items())
    return {
        "folder": str(folder),
        "scenario": f"{scenario['world']}{' ' if options else ''}{options}",
        "episodes": report["verdict"]["episodes"],
        "margin": report["declaration"]["margin"]["regret"],
        "look": "" if look is None else look["number"],
        "verdict": report["verdict"]["decision"],
    }
