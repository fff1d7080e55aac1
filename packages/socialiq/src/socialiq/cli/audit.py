"""`audit`: whether a policy behaves as declared; `audit nonce`, `audit commit`: its seeds."""

import datetime
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.audit import conduct, log, look, seeds
from socialiq.audit.report import folder, views, words
from socialiq.audit.request import Request, Trust
from socialiq.audit.verdict.decision import Decision
from socialiq.cli.output import Display, Printing, Result, is_number, print_json, print_table, say
from socialiq.errors import UserError
from socialiq.evaluation.parts import check_processes
from socialiq.isolation import IsolationMode
from socialiq.outputs import check_ending
from socialiq.policies.process import limits_of
from socialiq.types import Json

Several = tyro.conf.UseAppendAction[tuple[str, ...]]
"""Values of an option that may be given several times."""

_AHEAD = datetime.timedelta(minutes=10)  # of the round that is named by default


@dataclass(frozen=True)
class CodeOptions:
    """Permissions and limits of a policy that is a process or a Python module."""

    allow_code: bool = False
    """Import the Python module of the declaration's environment, and run named Python modules that
    can't be isolated: their authors' code runs with your rights."""
    isolation: IsolationMode = "auto"
    """Isolation of processes and Python modules by bubblewrap: where it works, always, or never."""
    files: Several = ()
    """A further file or folder of a policy that is a process or a Python module: its hash covers
    it, and only what is covered is visible to an isolated one."""
    step_seconds: float = 5.0
    """Seconds within which a process must answer."""
    memory_gib: float = 8.0
    """Limit of the address space of each process of a policy, GiB; 0 for no limit."""

    @property
    def trust(self) -> Trust:
        """Permissions for `resolve_policy`."""
        limits = limits_of(self.step_seconds, self.memory_gib)
        return Trust(self.allow_code, limits, self.isolation, tuple(self.files))


Code = tyro.conf.OmitArgPrefixes[CodeOptions]
"""The options of code, without a word before them."""


@dataclass(frozen=True)
class Audit(Printing):
    """Audit whether a policy behaves as declared, by comparison with reference drivers.

    POLICY is a file (.safetensors of socialiq, .zip of Stable-Baselines3, .onnx), "process:COMMAND
    LINE", "python:FILE.py:NAME", atlas:NAME, or a rule-based driver (go, wait, idm, ...).

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
    reference: Several = ()
    """A further driver to compare with: a file (a dial gives one for every 15 degrees, and for
    every 5 near the declared angle), or python:FILE.py:NAME. In an environment of your own at
    least one is needed."""
    soft: bool = False
    """Select the policy's actions stochastically instead of greedily."""
    code: Code = field(default_factory=CodeOptions)
    threads: int = 1
    """Number of threads of the simulation."""
    films: bool = False
    """Render three median and three worst episodes as GIF files, which takes longer."""
    shift: tuple[str, ...] | None = None
    """Also run the same number of episodes in other traffic, or in each of some shifts (late,
    unseen=.3, ...; as of `socialiq evaluate`), and report whether the policy drives differently
    there. The verdict doesn't depend on it."""
    processes: int = 0
    """Processes among which the episodes are split, by seed; by default this one runs all."""
    replace: bool = False
    """Replace an earlier report in the folder."""

    def result(self) -> Result:
        """Audit, write the report."""
        out: Path | None = self.out  # a function may have none
        if out:
            folder.check_target(out, self.replace)
        check_processes(self.processes)
        request = Request(
            policy=self.policy,
            profile=self.profile,
            episodes=self.episodes,
            seed=seeds.origin_of(self.seed, self.nonce, self.beacon),
            references=tuple(self.reference),
            soft=self.soft,
            trust=self.code.trust,
            threads=self.threads,
            films=self.films,
            shift=self.shift,
            log=conduct.log_folder(out or Path("audit"), self.log, self.no_log, self.seed),
        )
        if self.processes:
            with Display() as display:
                done = conduct.conduct(request, say, None, self.processes, display.stage)
        else:
            done = conduct.conduct(request, say)
        if out:
            done.write(out, self.replace)
        verdict = done.report["verdict"]
        headline = f"{Decision(verdict['decision']).headline}: {verdict['reason']}"
        tests = views.tested(done.report)
        columns = [name for name in tests[0] if name != "name"]  # at most 80 characters wide
        rows = [{name: row[name].replace("−", "-") for name in columns} for row in tests]
        policy = done.report["policy"]
        outcome = {"policy": policy["record"]["source"], "decision": verdict["decision"]}
        outcome |= {"regret": done.report["tests"]["regret"]["regret"]}
        outcome |= {name: value for name, value in policy["means"].items() if is_number(value)}
        return Result(done.report, rows, headline, [outcome], ("policy",))

    def show(self, result: Json, rows: Sequence[Json], title: str = "") -> int:
        """Print the verdict; return its exit status.

        Args:
            result: Content of `report.json`.
            rows: The tests.
            title: The verdict in a line.
        """
        report: Any = result
        verdict = report["verdict"]
        if self.json:
            sys.stdout.write(json.dumps(report, allow_nan=False) + "\n")
            return int(verdict["exit_code"])
        lines = [title]
        notes = [caveat["text"] for caveat in report["caveats"]]
        lines += [f"Note: {text}" for text in notes[:1]]
        if notes[1:]:
            plural = "s" if notes[2:] else ""
            lines.append(f"{len(notes) - 1} more note{plural}: {self.out / 'report.md'}")
        if report["look"]:
            lines.append(words.price(report["look"]["number"], report["look"]["error"]))
        if verdict["needed"]:
            lines.append(f"About {verdict['needed']} episodes would decide.")
        if sentence := views.not_excluded(report):
            lines.append(sentence.replace("°", " degrees"))
        sys.stdout.write("".join(f"{line}\n" for line in lines))
        print_table(rows)
        sys.stdout.write(f"{views.other_passes(report)}\n")
        if report["shift"]:
            sys.stdout.write(f"{report['shift']['sentence']}\n")
        sys.stdout.write(f"{self.out / 'report.html'}\n")
        return int(verdict["exit_code"])


@dataclass(frozen=True)
class WriteNonce:
    """Draw the auditor's nonce, and print the hash for the owner.

    Keep the file to yourself until you have the hash of the owner's commitment. Use it once.

    Example: socialiq audit nonce --out nonce.json
    """

    out: Path
    """File to write; only you can read it."""

    def run(self) -> int:
        """Write the nonce, print its SHA-256."""
        check_ending(self.out, ".json")
        sys.stdout.write(f"{seeds.write_nonce(self.out).sha256}\n")
        return 0


@dataclass(frozen=True)
class Commit(Printing):
    """Commit to a policy and a declaration in the audit log, before their episodes can be known.

    The seed comes later: from the auditor's nonce, whose hash is named here, or from a round of the
    public beacon drand that is not yet published. The printed hash of the commitment belongs in
    the auditor's hands before that. Every commitment counts as a look.

    Example: socialiq audit commit atlas:prosocial --profile profile.toml --beacon-round 34200000
    """

    policy: Annotated[str, tyro.conf.Positional]
    """The policy under audit."""
    profile: Path
    """The declaration: `socialiq profile new` writes one."""
    nonce_sha256: str = ""
    """Hash of the auditor's nonce, as `socialiq audit nonce` printed it."""
    beacon_round: int | None = None
    """A round of drand's quicknet that is not yet published; without a nonce, by default the first
    in ten minutes."""
    log: Path = Path("audit-log")
    """Folder of the audit log."""
    episodes: int = 1000
    """Number of episodes of the audit."""
    reference: Several = ()
    """A further driver to compare with, as for `socialiq audit`."""
    soft: bool = False
    """Select the policy's actions stochastically instead of greedily."""
    code: Code = field(default_factory=CodeOptions)

    def run(self) -> int:
        """Commit, and print the hash and what comes next."""
        request = Request(
            policy=self.policy,
            profile=self.profile,
            episodes=self.episodes,
            references=tuple(self.reference),
            soft=self.soft,
            trust=self.code.trust,
            log=self.log,
        )
        number = self.beacon_round
        if self.nonce_sha256:
            if number is not None:
                raise UserError("an audit has one seed: give --nonce-sha256 or --beacon-round")
            source = look.of_nonce(self.nonce_sha256)
        else:
            number = seeds.round_after(log.now() + _AHEAD) if number is None else number
            source = look.of_beacon(number)
        entry = conduct.commit_to(request, source)
        if self.json:
            print_json({"look": entry.number, "log": entry.log, "entry": entry.entry, **source})
            return 0
        sys.stdout.write(f"{entry.entry}\n")
        say(f"look {entry.number} of {self.log / entry.log}, committed at {entry.committed}")
        if number is None:
            say("give this hash to the auditor, who then audits with --nonce")
        else:
            when = f"{seeds.time_of(number):%Y-%m-%d %H:%M:%S} UTC"
            say(f"give this hash to the auditor before round {number} is published, {when}")
            say(f"then fetch {seeds.address_of(number)} and audit with --beacon")
        return 0
