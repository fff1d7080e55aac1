"""`audit`: whether a policy behaves as declared."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.audit.conduct import Conducted, conduct, log_folder
from socialiq.audit.report.folder import check_target
from socialiq.audit.report.views import is_known, number, others, outcome, percent
from socialiq.audit.request import Request
from socialiq.cli.code_options import CodeOptions
from socialiq.cli.output import Printing, print_table, say
from socialiq.cli.progress import Display
from socialiq.evaluation.parts import check_processes


@dataclass(frozen=True)
class Audit(Printing):
    """Audit whether a policy behaves as declared, by comparison with reference drivers.

    POLICY is a file (.safetensors of socialiq, .zip of Stable-Baselines3, .onnx), "process:COMMAND
    LINE", "python:MODULE:ATTRIBUTE", atlas:NAME, or a rule-based driver (go, wait, idm, ...).

    Policy and declaration are hashed before the seed is drawn. Exit status: 0 pass, 1 fail, 2 a
    mistake in the call, 3 undecided. `socialiq audit verify DIR` checks a report.

    Example: socialiq audit atlas:prosocial --profile profile.toml --out audit
    """

    policy: Annotated[str, tyro.conf.Positional]
    """The policy under audit."""
    profile: Path
    """The declaration: `socialiq profile new` writes one."""
    out: Path
    """Folder to write: report.json, report.html, report.md, the evidence and the seals."""
    episodes: int = 1000
    """Number of episodes."""
    seed: int | None = None
    """Seed of a trial or a repetition, which no log keeps: it is known before the commitment. By
    default the seed is drawn from the system's entropy after the commitment."""
    nonce: Path | None = None
    """File of the auditor's nonce, whose hash an `audit commit` of the owner names."""
    beacon: Path | None = None
    """File of a beacon's round (JSON, as drand's relays give it) that an `audit commit` names."""
    log: Path | None = None
    """Folder of the audit log, which counts the looks of an owner at a scenario; by default
    `audit-log` beside the report's folder."""
    no_log: bool = False
    """Keep no audit log; the report says so."""
    reference: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A further driver to compare with: a file (a dial gives one for every 15 degrees), or
    python:MODULE:ATTRIBUTE. In an environment of your own at least one is needed."""
    soft: bool = False
    """Select the policy's actions stochastically instead of greedily."""
    code: tyro.conf.OmitArgPrefixes[CodeOptions] = field(default_factory=CodeOptions)
    threads: int = 1
    """Number of threads of the simulation."""
    films: bool = False
    """Render three median and three worst episodes as GIF files, which takes longer."""
    shift: bool = False
    """Also run the same number of episodes in other traffic, and report whether the policy drives
    differently there. The verdict doesn't depend on it."""
    processes: int = 0
    """Processes among which the episodes are split, by seed; by default this one runs all."""
    replace: bool = False
    """Replace an earlier report in the folder."""

    def run(self) -> int:
        """Audit, write the report, print the verdict."""
        check_target(self.out, self.replace)
        check_processes(self.processes)
        if not self.processes:
            done = conduct(self.request(), say)
        else:
            with Display() as display:
                done = conduct(self.request(), say, None, self.processes, display.stage)
        done.write(self.out, self.replace)
        if self.json:
            sys.stdout.write(json.dumps(done.report, allow_nan=False) + "\n")
        else:
            _show(done, self.out)
        return int(done.report["verdict"]["exit_code"])

    def request(self) -> Request:
        """Return the request of the audit."""
        return Request(
            policy=self.policy,
            profile=self.profile,
            episodes=self.episodes,
            seed=self.seed,
            references=tuple(self.reference),
            soft=self.soft,
            trust=self.code.trust,
            threads=self.threads,
            films=self.films,
            shift=self.shift,
            log=log_folder(self.out, self.log, self.no_log, self.seed),
            nonce=self.nonce,
            beacon=self.beacon,
        )


def _show(done: Conducted, folder: Path) -> None:
    """Print the verdict, what it rests on, the tests and the path of the report."""
    report = done.report
    verdict = report["verdict"]
    sys.stdout.write(f"{verdict['decision'].upper()}: {verdict['reason']}\n")
    for caveat in report["caveats"]:
        sys.stdout.write(f"Note: {caveat['text']}\n")
    if verdict["needed"]:
        sys.stdout.write(f"About {verdict['needed']} episodes would decide.\n")
    print_table(
        [{name: text.replace("−", "-") for name, text in row.items()} for row in _tests(report)]
    )
    sys.stdout.write(f"{others(report)}\n")
    if report["shift"]:
        sys.stdout.write(f"{report['shift']['sentence']}\n")
    sys.stdout.write(f"{folder / 'report.html'}\n")


_EVENTS = {
    "at_fault": "collision, at fault",
    "struck": "collision, struck",
    "arrival": "arrival",
    "timeout": "out of time",
}
"""Criteria in a table of 80 columns."""


def _tests(report: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a row for each test, at most 80 columns wide together."""
    regret = report["tests"]["regret"]
    measured = {name: number(regret[name]) for name in ("low", "high")}
    by_rule = "angle_rule" in report["declaration"]
    first = "decision loss" if by_rule else "reward below best"
    rows = [
        {"test": first, "result": outcome(regret["decision"])}
        | {"estimate": number(regret["regret"])}
        | measured
        | {"asked for": f"at most {number(regret['margin'])}"}
    ]
    for test in report["tests"]["competence"]:
        if is_known(report, test["name"]):
            shares = {name: percent(test[name]) for name in ("share", "low", "high")}
            rows.append(
                {"test": _EVENTS[test["name"]], "result": outcome(test["decision"])}
                | {"estimate": shares.pop("share")}
                | shares
                | {"asked for": f"{test['side']} {percent(test['limit'])}"}
            )
    return rows
