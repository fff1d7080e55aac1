"""Conduct one audit from its request to its report, in the order of commitment."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from socialiq.audit.evidence import replay
from socialiq.audit.evidence.collect import Collection
from socialiq.audit.evidence.consistency import joined
from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.log import Subject
from socialiq.audit.look import Look, Opened, Plan, commit, open_look, record
from socialiq.audit.profile.profile import Traffic, other_traffic
from socialiq.audit.profile.reader import load
from socialiq.audit.report.content import Audited, content
from socialiq.audit.report.folder import REPORT, files_of, write_folder
from socialiq.audit.request import Request, command_of, resolve_policy
from socialiq.audit.seeds import Commitment, Draw, episode_seeds
from socialiq.errors import UserError
from socialiq.learners.callbacks import Report
from socialiq.policies.drivers import showing
from socialiq.reading import sha256_of
from socialiq.types import Json

Stage = Callable[[str], Callable[[Report], None]]  # begins to show the progress of something


@dataclasses.dataclass(frozen=True)
class Conducted:
    """A finished audit."""

    report: Json  # content of `report.json`
    audited: Audited  # what it was made from
    log: Path | None  # folder of the audit log

    def write(self, out: Path, replace: bool) -> None:
        """Write the report's folder, and the verdict into the log, if there is one.

        Args:
            out: Folder to write.
            replace: Whether an earlier report in the folder is replaced.

        Raises:
            UserError: If a file or the log can't be written.
        """
        profile = self.audited.profile
        look = self.audited.look
        files = files_of(self.report, profile, self.audited.evidence, self.audited.films)
        write_folder(out, files, replace)
        if self.log is not None and look is not None:
            decision = self.report["verdict"]["decision"]
            sha256 = sha256_of(files[REPORT])
            record(self.log, Subject.of(profile), look, decision, sha256)


def commit_to(request: Request, source: Json) -> Look:
    """Commit to policy and declaration of a later audit, which has a log, before its seed is known.

    Args:
        request: Request of the audit, with the folder of its log.
        source: Origin of the seed: the result of `look.of_nonce` or `look.of_beacon`.

    Returns:
        The look that the commitment counts as.

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
        plan = _plan(Collection.of(request, profile, None, world, loaded, closing))
    return commit(request.log, plan, source)


def _plan(collection: Collection) -> Plan:
    """Return what the drivers of an audit commit to."""
    request = collection.request
    profile = collection.profile
    hashes = tuple(driver["sha256"] for driver in collection.references.records.values())
    commitment = Commitment(collection.loaded.record.sha256, profile.sha256)
    return Plan(commitment, profile, request.episodes, request.soft, hashes)


def conduct(
    request: Request,
    print_line: Callable[[str], None],
    repeated: Opened | None = None,
    processes: int = 0,
    stage: Stage | None = None,
) -> Conducted:
    """Load declaration and policy, commit to both, learn the seed, run all drivers, judge.

    Args:
        request: Request of the audit.
        print_line: Prints commitment and seed.
        repeated: Seed and look of an earlier audit to repeat; a repetition is not a look.
        processes: Number of processes among which the episodes are split; 0 for this one.
        stage: Shows the progress of these.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    request.check()
    clock = time.monotonic()
    started = datetime.datetime.now(datetime.UTC)
    profile = load(request.profile)
    world = profile.world(request.trust.allow_code)
    traffic = () if request.shift is None else other_traffic(profile, request.shift)
    if request.films:
        replay.check_filmed(world)
    with contextlib.ExitStack() as closing:
        loaded = resolve_policy(request.policy, world, profile.angle, request.trust)
        closing.enter_context(loaded)
        worlds = (None, world), *enumerate(variant.world for variant in traffic)
        collections = [
            Collection.of(request, profile, number, scenario, loaded, closing)
            for number, scenario in worlds
        ]
        if processes:
            collections[0].check_parts()
        plan = _plan(collections[0])
        if repeated is None:
            print_line(f"committed to policy and declaration: {plan.commitment.sha256}")
            draw, look = open_look(request.log, plan, request.seed)
            if look is not None:
                print_line(f"look {look.number} of {look.log}")
            print_line(f"seed {draw.seed}, from {draw.source}")
        else:
            draw, look = repeated
        if draw.commitment != plan.commitment:
            raise UserError(
                f"{request.policy} is not the policy that was audited: its hash differs"
            )
        audited = _audited(collections, traffic, draw, look, started, processes, stage)
    report = content(audited)
    report["timing"]["seconds"] = round(time.monotonic() - clock, 3)
    return Conducted(report, audited, request.log)


def _audited(
    collections: Sequence[Collection],
    traffic: Sequence[Traffic],
    draw: Draw,
    look: Look | None,
    started: datetime.datetime,
    processes: int,
    stage: Stage | None,
) -> Audited:
    """Run all drivers in each traffic, by this process or several, and some episodes again."""
    declared = collections[0]
    request = declared.request
    world = declared.world
    loaded = declared.loaded

    def driven(collection: Collection) -> Evidence:
        purpose = "episodes" if collection.traffic is None else f"shift {collection.traffic}"
        seeds = episode_seeds(draw.derived(purpose), request.episodes)
        if not processes:
            return collection.collect(seeds)
        return collection.collect_in_parts(seeds, processes, stage("episodes") if stage else None)

    evidence = list(map(driven, collections))
    episodes = replay.selected(evidence[0], declared.profile.angle)
    shown_world = showing(world, loaded.record.interface.schema)
    films = replay.films_of(shown_world, loaded.policy, episodes) if request.films else {}
    return Audited(
        profile=declared.profile,
        policy=loaded.record.as_json(),
        deterministic=not request.soft,
        drawn=draw,
        look=look,
        records=declared.references.records,
        reference_files=list(request.references),
        left_out=declared.references.itself,
        consistency=joined([drivers.consistency for drivers in evidence]),
        evidence=evidence,
        traffic=traffic,
        episodes=episodes,
        films=films,
        traces=replay.traces_of(shown_world, loaded.policy, episodes, not request.soft),
        command=command_of(request, draw.seed),
        started=started,
    )


def log_folder(out: Path, log: Path | None, no_log: bool, seed: int | None) -> Path | None:
    """Return the folder of the audit log, None for an audit without a log.

    Args:
        out: Folder of the report. By default the log is `audit-log` in the same folder.
        log: Folder that the user names, if any.
        no_log: Whether to keep no log.
        seed: Seed known beforehand. Such an audit is a trial or a repetition: by default it has no
            log.

    Raises:
        UserError: If a log is named and refused at once.
    """
    if no_log and log is not None:
        raise UserError("an audit keeps a log or none: leave out --log or --no-log")
    if no_log or (seed is not None and log is None):
        return None
    return log or out.parent / "audit-log"
