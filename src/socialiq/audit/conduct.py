"""Conduct one audit from its request to its report, in the order of commitment."""

from __future__ import annotations

import dataclasses
import datetime
import shlex
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int64

from socialiq.audit.commitment import Commitment, check_seed, draw
from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import Evidence, Reference, check_episodes, episode_seeds
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.reader import load
from socialiq.audit.profile.scenario import World
from socialiq.audit.report.content import Audited, content
from socialiq.audit.report.episodes import check_filmed, films_of, selected
from socialiq.audit.report.folder import check_target, files_of, write_folder
from socialiq.audit.resolve_policy import (
    Trust,
    resolve_policy,
    resolve_references,
    rules_that_are_the_policy,
)
from socialiq.audit.verdict.calibration import calibrate
from socialiq.audit.verdict.shift import other_traffic, shift_of
from socialiq.audit.verdict.verdict import Verdict, judge
from socialiq.errors import UserError
from socialiq.policies.process.load import GIB, Limits
from socialiq.policies.record import Loaded
from socialiq.worlds.intersection.world import Intersection


@dataclasses.dataclass(frozen=True)
class Request:
    """Request of an audit.

    Attributes:
        policy: A specification as `resolve_policy` takes it.
        profile: File of the declaration.
        episodes: How many.
        seed: The auditor's, or None to have it drawn.
        references: Further drivers to compare with: files, or "python:MODULE:ATTRIBUTE".
        soft: Whether the policy draws its actions.
        trust: What the policy may do.
        threads: That share the intersection's episodes.
        films: Whether to draw six episodes.
        shift: Whether to let the policy drive in other traffic too.
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


@dataclasses.dataclass(frozen=True)
class Conducted:
    """An audit that is over.

    Attributes:
        report: Content of `report.json`.
        evidence: Every episode.
        profile: The declaration.
        films: By path in the report's folder.
    """

    report: dict[str, Any]
    evidence: Evidence
    profile: Profile
    films: dict[str, bytes]


class Collection(NamedTuple):
    """Evidence that is to be collected.

    Attributes:
        request: What is audited.
        profile: The declaration.
        traffic: Which of `other_traffic`, or None for the declared one.
        world: Where the episodes are driven.
        seeds: Of the episodes.
        loaded: The policy.
        references: Drivers that were handed in.
    """

    request: Request
    profile: Profile
    traffic: int | None
    world: World
    seeds: Int64[np.ndarray, " episode"]
    loaded: Loaded
    references: Sequence[Reference]

    def collect(self, side_by_side: int | None = None) -> Evidence:
        """Let everybody drive, in this process."""
        return collect_evidence(
            self.world,
            self.loaded.policy,
            self.seeds,
            self.references,
            deterministic=not self.request.soft,
            threads=self.request.threads,
            side_by_side=side_by_side,
        )


def conduct(
    request: Request,
    say: Callable[[str], None],
    wanted_sha256: str = "",
    collect: Callable[[Collection], Evidence] = Collection.collect,
) -> Conducted:
    """Read, commit, draw, play, judge.

    Args:
        request: What to do.
        say: Takes lines for people.
        wanted_sha256: Of the policy, where only that one will do.
        collect: Collects the evidence, by default in this process.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    _check(request)
    started, clock = datetime.datetime.now(datetime.UTC), time.monotonic()
    profile = load(request.profile)
    world = profile.world(request.trust.allow_code)
    if request.films:
        check_filmed(world)
    traffic = other_traffic(profile) if request.shift else ()
    with resolve_policy(request.policy, world, profile.angle, request.trust) as loaded:
        if wanted_sha256 and loaded.record.sha256 != wanted_sha256:
            raise UserError(
                f"{request.policy} is not the policy that was audited: its hash differs"
            )
        commitment = Commitment(loaded.record.sha256, profile.sha256)
        say(f"committed to policy and declaration: {commitment.sha256}")
        drawn = draw(commitment, request.seed)
        say(f"seed {drawn.seed}, chosen by the {drawn.chosen_by}")
        evidence, handed, out = _played(
            request, profile, None, world, drawn.derived("episodes"), loaded, collect
        )
        elsewhere = [
            _played(
                request,
                profile,
                number,
                one.world,
                drawn.derived(f"shift {number}"),
                loaded,
                collect,
            )[0]
            for number, one in enumerate(traffic)
        ]
        films = _filmed(request, profile, world, loaded, evidence)
    compared = _without(evidence, out)
    resampling = drawn.derived("resampling")
    verdict = _judged(profile, compared, evidence, resampling)
    there = [_without(one, out) for one in elsewhere]
    shifts = shift_of(profile, compared, traffic, there, resampling) if traffic else None
    audited = Audited(
        profile=profile,
        policy=loaded.record.as_json(),
        deterministic=not request.soft,
        drawn=drawn,
        handed=handed,
        reference_files=list(request.references),
        left_out=out,
        evidence=compared,
        verdict=verdict,
        shifts=shifts,
        films=films,
        command=command_of(request, drawn.seed),
        started=started,
        seconds=round(time.monotonic() - clock, 3),
    )
    return Conducted(content(audited), compared, profile, films)


def audit_policy(
    policy: str | Path,
    profile: Path,
    out: Path,
    episodes: int = 500,
    seed: int | None = None,
    references: Sequence[str | Path] = (),
    allow_code: bool = False,
    replace: bool = False,
) -> dict[str, Any]:
    """Audit a policy against its declaration and write the report, as `socialiq audit` does.

    Args:
        policy: A file, "python:MODULE:ATTRIBUTE", "process:COMMAND LINE", atlas:NAME, or at the
            intersection a rule-based driver.
        profile: File of the declaration: the `source` of what `declare` made.
        out: Folder to write.
        episodes: Number of episodes that every driver drives.
        seed: The auditor's own; by default drawn after policy and declaration were hashed.
        references: Further drivers to compare with; in an environment at least one.
        allow_code: Whether Python modules that are named may be imported.
        replace: Whether an earlier report in the folder is replaced.

    Returns:
        The content of `report.json`: `["verdict"]["decision"]` is pass, fail or inconclusive.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    check_target(out, replace)
    handed = tuple(map(str, references))
    request = Request(str(policy), profile, episodes, seed, handed, trust=Trust(allow_code))
    done = conduct(request, _silent)
    write_folder(out, files_of(done.report, done.profile, done.evidence, done.films), replace)
    return done.report


def _silent(_line: str) -> None:
    """Print the verdict; Python callers read `report.json` instead."""


def command_of(request: Request, seed: int) -> str:
    """The command that repeats an audit, but for the folder that it writes."""
    words = ["socialiq", "audit", request.policy, "--profile", str(request.profile)]
    words += ["--episodes", str(request.episodes), "--seed", str(seed)]
    words += [word for one in request.references for word in ("--reference", one)]
    words += ["--films"] if request.films else []
    words += ["--shift"] if request.shift else []
    words += ["--soft"] if request.soft else []
    words += ["--allow-code"] if request.trust.allow_code else []
    limits, usual = request.trust.limits, Limits()
    if limits.step != usual.step:
        words += ["--step-seconds", f"{limits.step:g}"]
    if limits.memory != usual.memory:
        words += ["--memory-gib", f"{limits.memory / GIB:g}"]
    return shlex.join(words)


def _check(request: Request) -> None:
    check_episodes(request.episodes)
    if request.seed is not None:
        check_seed(request.seed)  # before anything is read; it is used only after the commitment
    if request.films and request.soft:
        raise UserError("films show a policy's best actions: leave out --films or --soft")
    request.trust.limits.check()
    if request.threads < 1:
        raise UserError(f"threads must be at least 1, got {request.threads}")


def _played(
    request: Request,
    profile: Profile,
    traffic: int | None,
    world: World,
    seed: int,
    loaded: Loaded,
    collect: Callable[[Collection], Evidence],
) -> tuple[Evidence, dict[str, dict[str, Any]], list[str]]:
    """Return the evidence, the references' records, and the names of those that are the policy."""
    record = loaded.record
    references, handed, out = resolve_references(
        world, request.references, record.sha256, record.source, request.trust
    )
    seeds = episode_seeds(seed, request.episodes)
    evidence = collect(Collection(request, profile, traffic, world, seeds, loaded, references))
    return evidence, handed, [*rules_that_are_the_policy(record.sha256, world), *out]


def _filmed(
    request: Request, profile: Profile, world: World, loaded: Loaded, evidence: Evidence
) -> dict[str, bytes]:
    if not (request.films and isinstance(world, Intersection)):
        return {}
    return films_of(world, loaded.policy, selected(evidence, profile.angle))


def _without(evidence: Evidence, names: list[str]) -> Evidence:
    """Without the references that are the policy itself.

    Its regret towards itself is 0. To find that by sampling would take episodes for nothing.
    """
    kept = tuple(one for one in evidence.references if one.name not in names)
    return dataclasses.replace(evidence, references=kept)


def _judged(profile: Profile, compared: Evidence, complete: Evidence, seed: int) -> Verdict:
    """The verdict; the reference curve alone is drawn through the policy's own twin too."""
    verdict = judge(profile, compared, seed)
    if len(complete.references) == len(compared.references):
        return verdict
    calibration = calibrate(
        complete,
        profile.angle,
        profile.margin.degrees,
        not verdict.identifiability.holds_origin,
        seed,
        verdict.error,
    )
    return dataclasses.replace(verdict, calibration=calibration)
