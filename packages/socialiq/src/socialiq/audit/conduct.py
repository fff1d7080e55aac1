"""Conduct one audit from its request to its report, in the order of commitment."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from socialiq.audit.evidence.consistency import joined
from socialiq.audit.evidence.outcomes import Evidence, episode_seeds
from socialiq.audit.looks.log import Subject
from socialiq.audit.looks.look import Look, Opened, Plan, commit, open_look, record
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.reader import load
from socialiq.audit.report.content import Audited, content
from socialiq.audit.report.episodes import check_filmed, films_of, selected, traces_of
from socialiq.audit.report.folder import REPORT, check_target, files_of, write_folder
from socialiq.audit.request import Collection, Request, command_of
from socialiq.audit.resolve_policy import References, Trust, resolve_policy
from socialiq.audit.seeds import Commitment, Nonce, Round
from socialiq.audit.verdict.shift import other_traffic
from socialiq.errors import UserError
from socialiq.policies.isolation import IsolationMode


@dataclasses.dataclass(frozen=True)
class Conducted:
    """A finished audit.

    Attributes:
        report: Content of `report.json`.
        evidence: Evidence of the verdict, then that of each other traffic; of all references.
        profile: The declaration.
        films: Films by path in the report's folder.
        log: Folder of the audit log; None if there is none.
        look: The look; None without a log.
    """

    report: dict[str, Any]
    evidence: tuple[Evidence, ...]
    profile: Profile
    films: dict[str, bytes]
    log: Path | None
    look: Look | None

    def write(self, out: Path, replace: bool) -> None:
        """Write the report's folder, and record the verdict in the log.

        Raises:
            UserError: If one of them can't be written.
        """
        files = files_of(self.report, self.profile, self.evidence, self.films)
        write_folder(out, files, replace)
        if self.log is not None and self.look is not None:
            decision = self.report["verdict"]["decision"]
            sha256 = hashlib.sha256(files[REPORT]).hexdigest()
            subject = Subject.of(self.profile)
            record(self.log, subject, self.look, decision, sha256)


def commit_to(request: Request, source: Mapping[str, Any]) -> Look:
    """Commit to a policy and a declaration before the seed can be known, without an audit.

    Args:
        request: Request of the later audit, with its log.
        source: Origin of the seed: `looks.look.of_nonce` or `of_beacon`.

    Raises:
        UserError: If the request is invalid, or the log is damaged or can't be written.
    """
    assert request.log is not None
    request.check()
    profile = load(request.profile)
    world = profile.world(request.trust.allow_code)
    with contextlib.ExitStack() as closing:
        loaded = resolve_policy(request.policy, world, profile.angle, request.trust)
        closing.enter_context(loaded)
        collection = Collection.of(request, profile, None, world, loaded, closing)
        plan = plan_of(request, profile, loaded.record.sha256, collection.references)
    return commit(request.log, plan, source)


def conduct(
    request: Request,
    print_line: Callable[[str], None],
    repeated: Opened | None = None,
    collect: Callable[[Collection], Evidence] = Collection.collect,
) -> Conducted:
    """Load declaration and policy, commit to both, learn the seed, run all drivers, judge.

    Args:
        request: Request of the audit.
        print_line: Prints commitment and seed.
        repeated: Seed and look of an earlier audit to repeat, which is no look of its own.
        collect: Collects the evidence, by default in this process.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    request.check()
    clock, profile = time.monotonic(), load(request.profile)
    audited = _audited(request, profile, print_line, repeated, collect)
    report = content(audited)
    report["timing"]["seconds"] = round(time.monotonic() - clock, 3)
    evidence = (audited.evidence, *audited.elsewhere)
    films = dict(audited.films)
    return Conducted(report, evidence, profile, films, request.log, audited.look)


def _audited(
    request: Request,
    profile: Profile,
    print_line: Callable[[str], None],
    repeated: Opened | None,
    collect: Callable[[Collection], Evidence],
) -> Audited:
    """Load the policy, commit, learn the seed, and run all drivers, before any test."""
    started = datetime.datetime.now(datetime.UTC)
    seed, world = request.given(), profile.world(request.trust.allow_code)
    if request.films:
        check_filmed(world)
    traffic = other_traffic(profile) if request.shift else ()
    with contextlib.ExitStack() as closing:
        loaded = resolve_policy(request.policy, world, profile.angle, request.trust)
        policy = closing.enter_context(loaded).record
        worlds = (None, world), *enumerate(variant.world for variant in traffic)
        declared, *shifted = (
            Collection.of(request, profile, number, scenario, loaded, closing)
            for number, scenario in worlds
        )
        if request.in_parts:
            declared.check_parts()
        plan = plan_of(request, profile, policy.sha256, declared.references)
        draw, look = repeated or _open(request, plan, seed, print_line)
        if draw.commitment != plan.commitment:
            raise UserError(
                f"{request.policy} is not the policy that was audited: its hash differs"
            )
        purposes = ["episodes", *(f"shift {number}" for number in range(len(shifted)))]
        complete, *elsewhere = (
            collect(collection.on(episode_seeds(draw.derived(purpose), request.episodes)))
            for collection, purpose in zip((declared, *shifted), purposes, strict=True)
        )
        episodes = selected(complete, profile.angle)
        films = films_of(world, loaded.policy, episodes) if request.films else {}
        traces = traces_of(world, loaded.policy, episodes, not request.soft)
    return Audited(
        profile=profile,
        policy=policy.as_json(),
        deterministic=not request.soft,
        drawn=draw,
        look=look,
        records=declared.references.records,
        reference_files=list(request.references),
        left_out=declared.references.itself,
        consistency=joined([evidence.consistency for evidence in (complete, *elsewhere)]),
        evidence=complete,
        elsewhere=elsewhere,
        traffic=traffic,
        films=films,
        traces=traces,
        command=command_of(request, draw.seed),
        started=started,
        seconds=0.0,
    )


def plan_of(request: Request, profile: Profile, policy_sha256: str, references: References) -> Plan:
    """Return what a request commits to."""
    return Plan(
        Commitment(policy_sha256, profile.sha256),
        profile,
        request.episodes,
        request.soft,
        tuple(driver["sha256"] for driver in references.records.values()),
    )


def _open(
    request: Request,
    plan: Plan,
    seed: int | Nonce | Round | None,
    print_line: Callable[[str], None],
) -> Opened:
    """Commit, learn the seed, and print both."""
    print_line(f"committed to policy and declaration: {plan.commitment.sha256}")
    opened = open_look(request.log, plan, seed)
    if opened.look is not None:
        print_line(f"look {opened.look.number} of {opened.look.log}")
    print_line(f"seed {opened.drawn.seed}, from {opened.drawn.source}")
    return opened


def audit_policy(
    policy: str | Path,
    profile: Path,
    out: Path,
    episodes: int = 1000,
    seed: int | None = None,
    references: Sequence[str | Path] = (),
    allow_code: bool = False,
    replace: bool = False,
    log: Path | None = None,
    no_log: bool = False,
    isolation: IsolationMode = "auto",
    files: Sequence[str | Path] = (),
) -> dict[str, Any]:
    """Audit a policy against its declaration and write the report, as `socialiq audit` does.

    Args:
        policy: A file, "python:MODULE:ATTRIBUTE", "process:COMMAND LINE", atlas:NAME, or at the
            intersection a rule-based driver.
        profile: File of the declaration: the `source` of the result of `declare`.
        out: Folder to write.
        episodes: Number of episodes of every driver.
        seed: Seed of a trial or a repetition, which no log keeps; by default drawn after policy
            and declaration were hashed.
        references: Further drivers to compare with; in an environment at least one.
        allow_code: Whether named Python modules may run without isolation, and an environment's
            module may be imported.
        replace: Whether an earlier report in the folder is replaced.
        log: Folder of the audit log; by default `audit-log` beside `out`, none with a seed.
        no_log: Whether to keep no log.
        isolation: Isolation of processes and Python modules: where bubblewrap works, always, never.
        files: Further files and folders of these, which their hash covers.

    Returns:
        Content of `report.json`: `["verdict"]["decision"]` is pass, fail or inconclusive.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    check_target(out, replace)
    request = Request(
        str(policy),
        profile,
        episodes,
        seed,
        tuple(map(str, references)),
        trust=Trust(allow_code, isolation=isolation, files=tuple(map(str, files))),
        log=log_folder(out, log, no_log, seed),
    )
    done = conduct(request, lambda _line: None)
    done.write(out, replace)
    return done.report


def log_folder(out: Path, log: Path | None, no_log: bool, seed: int | None) -> Path | None:
    """Return the folder of the audit log: by default `audit-log` beside the report's folder.

    An audit with a seed known beforehand is a trial or a repetition: by default it has no log.

    Raises:
        UserError: If a log is named and refused at once.
    """
    if no_log and log is not None:
        raise UserError("an audit keeps a log or none: leave out --log or --no-log")
    if no_log or (seed is not None and log is None):
        return None
    return log or out.parent / "audit-log"
