"""`audit` and `audit verify`: whether a policy behaves as declared, and integrity of a report."""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.audit.conduct import Conducted, Request, conduct
from socialiq.audit.profile.reader import parse
from socialiq.audit.report.episodes import evidence_csv
from socialiq.audit.report.folder import (
    EVIDENCE,
    PROFILE,
    REPORT,
    check_target,
    files_of,
    write_folder,
)
from socialiq.audit.report.verify import content_of, differences, faults, not_checked, read_report
from socialiq.audit.report.views import is_known
from socialiq.audit.resolve_policy import Trust
from socialiq.cli.output import complain, print_json, print_table
from socialiq.cli.progress import Display
from socialiq.errors import UserError
from socialiq.experiments.engine import Engine, work_folder
from socialiq.foreign import one_line
from socialiq.policies.process.load import limits_of
from socialiq.provenance import package_sha256


@dataclass(frozen=True)
class Audit:
    """Audit whether a policy behaves as declared, by comparison with reference drivers.

    POLICY is a file (.safetensors of socialiq, .zip of Stable-Baselines3, .onnx), "process:COMMAND
    LINE", "python:MODULE:ATTRIBUTE", atlas:NAME, or a rule-based driver (go, wait, idm, ...).

    Policy and declaration are hashed before the seed is drawn. Exit status: 0 pass, 1 fail, 2 a
    mistake in the call, 3 undecided. `socialiq audit verify DIR` checks a report.

    Example: socialiq audit atlas:prosocial --profile profile.toml --episodes 500 --out audit
    """

    policy: Annotated[str, tyro.conf.Positional]
    """The policy under audit."""
    profile: Path
    """The declaration: `socialiq profile new` writes one."""
    out: Path
    """Folder to write: report.json, report.html, report.md, the evidence and the seals."""
    episodes: int = 500
    """Number of episodes."""
    seed: int | None = None
    """Seed of the episodes; by default drawn from the system's entropy after the commitment."""
    reference: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A further driver to compare with: a file (a dial gives one for every 15 degrees), or
    python:MODULE:ATTRIBUTE. In an environment of your own at least one is needed."""
    soft: bool = False
    """Select the policy's actions stochastically instead of greedily."""
    allow_code: bool = False
    """Import the Python modules of policy, references and the declaration's environment: their
    authors' code runs with your rights."""
    step_seconds: float = 5.0
    """Seconds within which a process must answer."""
    memory_gib: float = 8.0
    """Limit of the address space of each process of a policy, GiB; 0 for no limit."""
    threads: int = 1
    """Number of threads of the simulation."""
    films: bool = False
    """Render three median and three worst episodes as GIF files, which takes longer."""
    shift: bool = False
    """Also run the same number of episodes in other traffic, and report whether the policy drives
    differently there. The verdict doesn't depend on it."""
    engine: tyro.conf.OmitArgPrefixes[Engine] = field(default_factory=Engine)
    work: Path | None = None
    """Folder of the parts that are finished, with --processes or --cluster; it is kept, so that
    the same command with --seed goes on from it. By default a temporary folder."""
    replace: bool = False
    """Replace an earlier report in the folder."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Audit, write the report, print the verdict."""
        check_target(self.out, self.replace)
        done = self.conducted()
        files = files_of(done.report, done.profile, done.evidence, done.films)
        write_folder(self.out, files, self.replace)
        if self.json:
            sys.stdout.write(json.dumps(done.report, allow_nan=False) + "\n")
        else:
            _show(done, self.out)
        return int(done.report["verdict"]["exit_code"])

    def conducted(self) -> Conducted:
        """Play in this process, or in parts where the engine says."""
        if not self.engine.given:
            if self.work is not None:
                raise UserError("--work is of --processes or --cluster: add one, or leave it out")
            return conduct(self.request(), _say)
        if self.engine.cluster is not None and self.work is None:
            raise UserError("a cluster needs a folder that all its workers see: add --work FOLDER")
        from socialiq.experiments.audit_parts import collector

        with work_folder(self.work) as work, Display() as display:
            return conduct(
                self.request(), _say, collect=collector(self.engine, work, display.stage)
            )

    def request(self) -> Request:
        """Return the request of the audit."""
        return Request(
            policy=self.policy,
            profile=self.profile,
            episodes=self.episodes,
            seed=self.seed,
            references=tuple(self.reference),
            soft=self.soft,
            trust=Trust(self.allow_code, limits_of(self.step_seconds, self.memory_gib)),
            threads=self.threads,
            films=self.films,
            shift=self.shift,
        )


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def _show(done: Conducted, folder: Path) -> None:
    """Print the verdict, the tests and the path of the report."""
    verdict, tests = done.report["verdict"], done.report["tests"]
    regret = tests["regret"]
    rows = [
        {
            "test": "regret",
            "result": regret["decision"],
            "estimate": regret["regret"],
            "low": regret["low"],
            "high": regret["high"],
            "asked for": f"at most {regret['margin']:g}",
        }
    ]
    for one in (one for one in tests["competence"] if is_known(done.report, one["name"])):
        bounds = {"estimate": one["share"], "low": one["low"], "high": one["high"]}
        wanted = f"{one['side']} {one['limit']:g}"
        result = {"test": one["name"].replace("_", " "), "result": one["decision"]}
        rows.append({**result, **bounds, "asked for": wanted})
    sys.stdout.write(f"{verdict['decision'].upper()}: {verdict['reason']}\n")
    for one in done.report["caveats"]:
        sys.stdout.write(f"Note: {one['text']}\n")
    if verdict["needed"]:
        sys.stdout.write(f"About {verdict['needed']} episodes would decide.\n")
    print_table(rows)
    if done.report["shift"]:
        sys.stdout.write(f"{done.report['shift']['sentence']}\n")
    sys.stdout.write(f"{folder / 'report.html'}\n")


@dataclass(frozen=True)
class Verify:
    """Check the hashes of a report's files; with --rerun repeat the audit and compare.

    Exit status: 0 unchanged, 1 different, 2 a mistake in the call, 3 unchanged by its hashes, but
    pages of another version of socialiq were not checked.

    Example: socialiq audit verify audit --rerun
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Report folder, of `socialiq audit --out`."""
    rerun: bool = False
    """Run all episodes again, which needs policy and references with the same hashes."""
    policy: str = ""
    """Path of the policy, if not that of the report."""
    world: str = ""
    """The environment, if that of the declaration runs code: a report may come from
    an untrusted source, so you name it yourself."""
    reference: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Paths of the user's references."""
    allow_code: bool = False
    """Import the Python modules that were named, for the rerun."""
    step_seconds: float = 5.0
    """Seconds within which a process must answer in the rerun."""
    memory_gib: float = 8.0
    """Limit of the address space of each process of a policy in the rerun, GiB."""
    threads: int = 1
    """Number of threads of the simulation."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Check, optionally rerun, and print the differences."""
        found = faults(self.folder)
        if self.rerun and not found:
            found = self._again()
        open_pages = [] if found else not_checked(self.folder)
        if self.json:
            row = {"folder": str(self.folder), "rerun": self.rerun, "faults": found}
            print_json(row | {"not_checked": open_pages})
        elif open_pages:
            sys.stdout.write(
                f"{self.folder} is not checked as a whole: another version of socialiq wrote "
                f"{', '.join(open_pages)}, which may say anything; verify with that version\n"
            )
        elif not found:
            what = "and repeats" if self.rerun else f"by its manifest; --rerun plays {REPORT} again"
            sys.stdout.write(f"{self.folder} is as it was written, {what}\n")
        for line in found if not self.json else ():
            complain(line)
        return 1 if found else 3 if open_pages else 0

    def _again(self) -> list[str]:
        files = content_of(self.folder)
        report = read_report(self.folder / REPORT)
        if report["hashes"]["package"] != package_sha256():
            complain("this package's code is not that of the report: numbers may differ")
        self._check_world(files[PROFILE])
        with tempfile.TemporaryDirectory() as place:
            profile = Path(place) / PROFILE
            profile.write_bytes(files[PROFILE])
            done = conduct(self._request(report, profile), _say, report["hashes"]["policy"])
        fresh = json.loads(json.dumps(done.report))
        found = [f"{one} differs in the rerun" for one in differences(report, fresh)]
        if evidence_csv(done.evidence).encode() != files[EVIDENCE]:
            found.append(f"{EVIDENCE} differs in the rerun")
        return found

    def _source(self, report: dict[str, Any]) -> str:
        """Return the policy. A report may be untrusted, so it doesn't decide which code runs."""
        source = str(report["policy"]["record"]["source"])
        if not self.policy and source.startswith(_RUNS):
            raise _asks_to_run(source, "--policy")
        return self.policy or source

    def _references(self, report: dict[str, Any]) -> tuple[str, ...]:
        """Return the user's references, by the same rule."""
        for one in () if self.reference else report["reference_files"]:
            if one.startswith(_RUNS):
                raise _asks_to_run(one, "--reference")
        return tuple(self.reference or report["reference_files"])

    def _check_world(self, profile: bytes) -> None:
        """Check the environment of the declaration, by the same rule."""
        world = parse(profile, PROFILE).scenario.world
        if ":" in world and self.world != world:
            raise _asks_to_run(world, "--world")

    def _request(self, report: dict[str, Any], profile: Path) -> Request:
        return Request(
            policy=self._source(report),
            profile=profile,
            episodes=report["seeds"]["episodes"],
            seed=report["seeds"]["seed"],
            references=self._references(report),
            soft=not report["policy"]["deterministic"],
            trust=Trust(self.allow_code, limits_of(self.step_seconds, self.memory_gib)),
            threads=self.threads,
            shift=report["shift"] is not None,
        )


_RUNS = ("process:", "python:")


def _asks_to_run(what: str, option: str) -> UserError:
    return UserError(
        f"this report asks to run '{one_line(what)}': if you trust that, give it as {option} "
        "yourself"
    )
