"""Conduct one audit from its request to its report, in the order of commitment."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int64

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.consistency import Recorder, joined
from socialiq.audit.evidence.outcomes import Evidence, check_episodes, episode_seeds
from socialiq.audit.looks.log import Subject
from socialiq.audit.looks.look import Look, Opened, Plan, commit, open_look, record
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.reader import load
from socialiq.audit.profile.scenario import World
from socialiq.audit.report.content import Audited, content
from socialiq.audit.report.episodes import check_filmed, films_of, selected, traces_of
from socialiq.audit.report.folder import REPORT, check_target, files_of, write_folder
from socialiq.audit.resolve_policy import (
    References,
    Trust,
    is_code,
    resolve_policy,
    resolve_references,
)
from socialiq.audit.seeds.beacon import Round, read_round
from socialiq.audit.seeds.commitment import Commitment, check_seed
from socialiq.audit.seeds.nonce import Nonce, read_nonce
from socialiq.audit.verdict.dependence import dependence
from socialiq.audit.verdict.judged import judged
from socialiq.audit.verdict.shift import other_traffic
from socialiq.errors import UserError
from socialiq.policies.process.isolation import Asked
from socialiq.policies.process.load import GIB, Limits
from socialiq.policies.record import Loaded


@dataclasses.dataclass(frozen=True)
class Request:
    """Request of an audit.

    Attributes:
        policy: A specification as for `resolve_policy`.
        profile: File of the declaration.
        episodes: Number of episodes of every driver.
        seed: The auditor's seed, or None to draw it.
        references: Further drivers to compare with: files, or "python:MODULE:ATTRIBUTE".
        soft: Whether the policy draws its actions.
        trust: Permissions of the policy.
        threads: Number of threads of the intersection.
        films: Whether to draw six episodes.
        shift: Whether to run the policy in other traffic too.
        log: Folder of the audit log; None keeps none.
        nonce: File of the auditor's nonce, which a commitment in the log names.
        beacon: File of a beacon's round, which a commitment in the log names.
    """

    policy: str
    profile: Path
    episodes: int
    seed: int | None = None
    references: tuple[str, ...] = ()
    soft: bool = False
    trust: Trust = dataclasses.field(default_factory=Trust)
    threads: int = 1
    films: bool = False
    shift: bool = False
    log: Path | None = None
    nonce: Path | None = None
    beacon: Path | None = None

    def check(self) -> None:
        """Check the numbers and options before any work is done.

        Raises:
            UserError: If one is out of range, or two exclude each other.
        """
        check_episodes(self.episodes)
        if self.seed is not None:
            check_seed(self.seed)  # it is used only after the commitment
        if self.films and self.soft:
            raise UserError("films show a policy's best actions: leave out --films or --soft")
        self.trust.limits.check()
        if self.trust.files and not any(map(is_code, (self.policy, *self.references))):
            raise UserError("--files is of a process or Python: leave it out")
        if self.threads < 1:
            raise UserError(f"threads must be at least 1, got {self.threads}")
        if sum(one is not None for one in (self.seed, self.nonce, self.beacon)) > 1:
            raise UserError("an audit has one seed: give one of --seed, --nonce and --beacon")

    def given(self) -> int | Nonce | Round | None:
        """Return the auditor's seed, nonce or round of a beacon; None draws the seed.

        Raises:
            UserError: If its file can't be read, or a round's signature is not the beacon's.
        """
        if self.nonce is not None:
            return read_nonce(self.nonce)
        return self.seed if self.beacon is None else read_round(self.beacon)


class Collection(NamedTuple):
    """Evidence that is to be collected.

    Attributes:
        request: Request of the audit.
        profile: The declaration.
        traffic: Number of a traffic of `other_traffic`, or None for the declared one.
        world: World of the episodes.
        loaded: The policy.
        references: Drivers to compare with.
        seeds: Seeds of the episodes.
    """

    request: Request
    profile: Profile
    traffic: int | None
    world: World
    loaded: Loaded
    references: References
    seeds: Int64[np.ndarray, " episode"]

    @staticmethod
    def of(
        request: Request,
        profile: Profile,
        traffic: int | None,
        world: World,
        loaded: Loaded,
        closing: contextlib.ExitStack,
    ) -> Collection:
        """Resolve the references in the world of the episodes; there are no episodes yet.

        Processes of references end with `closing`.
        """
        found = resolve_references(world, request.references, loaded.record, request.trust)
        closing.callback(found.close)
        none = np.zeros(0, np.int64)
        return Collection(request, profile, traffic, world, loaded, found, none)

    def on(self, seeds: Int64[np.ndarray, " episode"]) -> Collection:
        """Return the collection on episodes of these seeds."""
        return self._replace(seeds=seeds)

    def collect(self, side_by_side: int | None = None) -> Evidence:
        """Run all drivers in this process; ask a policy that is code again what it was asked.

        Policies that are data run by this package's code, and drawn actions differ by design.
        """
        request, checked = self.request, is_code(self.request.policy) and not self.request.soft
        policy = Recorder(self.loaded.policy) if checked else self.loaded.policy
        evidence = collect_evidence(
            self.world,
            policy,
            self.seeds,
            self.references.drivers,
            deterministic=not request.soft,
            threads=request.threads,
            side_by_side=side_by_side,
        )
        if isinstance(policy, Recorder):
            angle = self.profile.angle
            with resolve_policy(request.policy, self.world, angle, request.trust) as fresh:
                evidence = dataclasses.replace(evidence, consistency=policy.check(fresh.policy))
        self.loaded.check_unchanged()
        return evidence


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
    started, clock = datetime.datetime.now(datetime.UTC), time.monotonic()
    given, profile = request.given(), load(request.profile)
    world = profile.world(request.trust.allow_code)
    if request.films:
        check_filmed(world)
    traffic = other_traffic(profile) if request.shift else ()
    with contextlib.ExitStack() as closing:
        loaded = resolve_policy(request.policy, world, profile.angle, request.trust)
        policy = closing.enter_context(loaded).record
        declared, *others = (
            Collection.of(request, profile, number, place, loaded, closing)
            for number, place in ((None, world), *enumerate(one.world for one in traffic))
        )
        plan = plan_of(request, profile, policy.sha256, declared.references)
        drawn, look = repeated or _open(request, plan, given, print_line)
        if drawn.commitment != plan.commitment:
            raise UserError(
                f"{request.policy} is not the policy that was audited: its hash differs"
            )

        def collected(collection: Collection, purpose: str) -> Evidence:
            return collect(collection.on(episode_seeds(drawn.derived(purpose), request.episodes)))

        complete = collected(declared, "episodes")
        elsewhere = [collected(one, f"shift {number}") for number, one in enumerate(others)]
        episodes = selected(complete, profile.angle)
        films = films_of(world, loaded.policy, episodes) if request.films else {}
        traces = traces_of(world, loaded.policy, episodes, not request.soft)
    itself = declared.references.itself
    resampling = drawn.derived("resampling")
    consistency = joined([one.consistency for one in (complete, *elsewhere)])
    verdict, discrimination, shifts = judged(
        profile,
        complete,
        itself,
        resampling,
        traffic,
        elsewhere,
        error=None if look is None else look.error,
        findings=dependence(consistency),
    )
    report = content(
        Audited(
            profile=profile,
            policy=policy.as_json(),
            deterministic=not request.soft,
            drawn=drawn,
            look=look,
            records=declared.references.records,
            reference_files=list(request.references),
            left_out=itself,
            consistency=consistency,
            evidence=complete,
            elsewhere=elsewhere,
            verdict=verdict,
            discrimination=discrimination,
            shifts=shifts,
            films=films,
            traces=traces,
            command=command_of(request, drawn.seed),
            started=started,
            seconds=round(time.monotonic() - clock, 3),
        )
    )
    return Conducted(report, (complete, *elsewhere), profile, films, request.log, look)


def plan_of(request: Request, profile: Profile, policy_sha256: str, references: References) -> Plan:
    """Return what a request commits to."""
    return Plan(
        Commitment(policy_sha256, profile.sha256),
        profile,
        request.episodes,
        request.soft,
        tuple(one["sha256"] for one in references.records.values()),
    )


def _open(
    request: Request,
    plan: Plan,
    given: int | Nonce | Round | None,
    print_line: Callable[[str], None],
) -> Opened:
    """Commit, learn the seed, and print both."""
    print_line(f"committed to policy and declaration: {plan.commitment.sha256}")
    opened = open_look(request.log, plan, given)
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
    isolation: Asked = "auto",
    files: Sequence[str | Path] = (),
) -> dict[str, Any]:
    """Audit a policy against its declaration and write the report, as `socialiq audit` does.

    Args:
        policy: A file, "python:MODULE:ATTRIBUTE", "process:COMMAND LINE", atlas:NAME, or at the
            intersection a rule-based driver.
        profile: File of the declaration: the `source` of the result of `declare`.
        out: Folder to write.
        episodes: Number of episodes of every driver.
        seed: The auditor's seed; by default drawn after policy and declaration were hashed.
        references: Further drivers to compare with; in an environment at least one.
        allow_code: Whether named Python modules may run without isolation, and an environment's
            module may be imported.
        replace: Whether an earlier report in the folder is replaced.
        log: Folder of the audit log; by default `audit-log` beside `out`.
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
        log=log_folder(out, log, no_log),
    )
    done = conduct(request, lambda _line: None)
    done.write(out, replace)
    return done.report


def log_folder(out: Path, log: Path | None, no_log: bool) -> Path | None:
    """Return the folder of the audit log: by default `audit-log` beside the report's folder.

    Raises:
        UserError: If a log is named and refused at once.
    """
    if no_log and log is not None:
        raise UserError("an audit keeps a log or none: leave out --log or --no-log")
    return None if no_log else log or out.parent / "audit-log"


def command_of(request: Request, seed: int) -> str:
    """Return the command that repeats an audit, without its output folder."""
    words = ["socialiq", "audit", request.policy, "--profile", str(request.profile)]
    words += ["--episodes", str(request.episodes), "--seed", str(seed)]
    words += [word for one in request.references for word in ("--reference", one)]
    words += ["--films"] if request.films else []
    words += ["--shift"] if request.shift else []
    words += ["--soft"] if request.soft else []
    words += ["--no-log"] if request.log is None else []
    words += ["--allow-code"] if request.trust.allow_code else []
    words += [word for one in request.trust.files for word in ("--files", one)]
    if request.trust.isolation != "auto":
        words += ["--isolation", request.trust.isolation]
    limits, usual = request.trust.limits, Limits()
    if limits.step != usual.step:
        words += ["--step-seconds", f"{limits.step:g}"]
    if limits.memory != usual.memory:
        words += ["--memory-gib", f"{limits.memory / GIB:g}"]
    return shlex.join(words)
