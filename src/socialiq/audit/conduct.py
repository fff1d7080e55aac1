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

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import Evidence, check_episodes, episode_seeds
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.reader import load
from socialiq.audit.profile.scenario import World
from socialiq.audit.report.content import Audited, content
from socialiq.audit.report.episodes import check_filmed, films_of, selected
from socialiq.audit.report.folder import check_target, files_of, write_folder
from socialiq.audit.resolve_policy import References, Trust, resolve_policy, resolve_references
from socialiq.audit.seeds.commitment import Commitment, check_seed, draw
from socialiq.audit.verdict.judged import judged
from socialiq.audit.verdict.shift import other_traffic
from socialiq.errors import UserError
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
        if self.threads < 1:
            raise UserError(f"threads must be at least 1, got {self.threads}")


class Collection(NamedTuple):
    """Evidence that is to be collected.

    Attributes:
        request: Request of the audit.
        profile: The declaration.
        traffic: Number of a traffic of `other_traffic`, or None for the declared one.
        world: World of the episodes.
        seeds: Seeds of the episodes.
        loaded: The policy.
        references: Drivers to compare with.
    """

    request: Request
    profile: Profile
    traffic: int | None
    world: World
    seeds: Int64[np.ndarray, " episode"]
    loaded: Loaded
    references: References

    @staticmethod
    def of(
        request: Request,
        profile: Profile,
        traffic: int | None,
        world: World,
        seeds: Int64[np.ndarray, " episode"],
        loaded: Loaded,
    ) -> Collection:
        """Resolve the references in the world of the episodes."""
        found = resolve_references(world, request.references, loaded.record, request.trust)
        return Collection(request, profile, traffic, world, seeds, loaded, found)

    def collect(self, side_by_side: int | None = None) -> Evidence:
        """Run all drivers in this process."""
        return collect_evidence(
            self.world,
            self.loaded.policy,
            self.seeds,
            self.references.drivers,
            deterministic=not self.request.soft,
            threads=self.request.threads,
            side_by_side=side_by_side,
        )


@dataclasses.dataclass(frozen=True)
class Conducted:
    """A finished audit.

    Attributes:
        report: Content of `report.json`.
        evidence: Evidence of the verdict, then that of each other traffic; of all references.
        profile: The declaration.
        films: Films by path in the report's folder.
    """

    report: dict[str, Any]
    evidence: tuple[Evidence, ...]
    profile: Profile
    films: dict[str, bytes]


def conduct(
    request: Request,
    print_line: Callable[[str], None],
    wanted_sha256: str = "",
    collect: Callable[[Collection], Evidence] = Collection.collect,
) -> Conducted:
    """Load declaration and policy, commit to both, draw the seed, run all drivers, judge.

    Args:
        request: Request of the audit.
        print_line: Prints commitment and seed.
        wanted_sha256: Hash of the policy, if it must be a certain one.
        collect: Collects the evidence, by default in this process.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    request.check()
    started, clock = datetime.datetime.now(datetime.UTC), time.monotonic()
    profile = load(request.profile)
    world = profile.world(request.trust.allow_code)
    if request.films:
        check_filmed(world)
    traffic = other_traffic(profile) if request.shift else ()
    with resolve_policy(request.policy, world, profile.angle, request.trust) as loaded:
        policy = loaded.record
        if wanted_sha256 and policy.sha256 != wanted_sha256:
            raise UserError(
                f"{request.policy} is not the policy that was audited: its hash differs"
            )
        commitment = Commitment(policy.sha256, profile.sha256)
        print_line(f"committed to policy and declaration: {commitment.sha256}")
        drawn = draw(commitment, request.seed)
        print_line(f"seed {drawn.seed}, chosen by the {drawn.chosen_by}")

        def collection(number: int | None, place: World, purpose: str) -> Collection:
            seeds = episode_seeds(drawn.derived(purpose), request.episodes)
            return Collection.of(request, profile, number, place, seeds, loaded)

        declared = collection(None, world, "episodes")
        complete = collect(declared)
        elsewhere = [
            collect(collection(number, one.world, f"shift {number}"))
            for number, one in enumerate(traffic)
        ]
        episodes = selected(complete, profile.angle)
        films = films_of(world, loaded.policy, episodes) if request.films else {}
    itself = declared.references.itself
    resampling = drawn.derived("resampling")
    verdict, discrimination, shifts = judged(
        profile, complete, itself, resampling, traffic, elsewhere
    )
    report = content(
        Audited(
            profile=profile,
            policy=policy.as_json(),
            deterministic=not request.soft,
            drawn=drawn,
            records=declared.references.records,
            reference_files=list(request.references),
            left_out=itself,
            evidence=complete,
            elsewhere=elsewhere,
            verdict=verdict,
            discrimination=discrimination,
            shifts=shifts,
            films=films,
            command=command_of(request, drawn.seed),
            started=started,
            seconds=round(time.monotonic() - clock, 3),
        )
    )
    return Conducted(report, (complete, *elsewhere), profile, films)


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
        profile: File of the declaration: the `source` of the result of `declare`.
        out: Folder to write.
        episodes: Number of episodes of every driver.
        seed: The auditor's seed; by default drawn after policy and declaration were hashed.
        references: Further drivers to compare with; in an environment at least one.
        allow_code: Whether the named Python modules may be imported.
        replace: Whether an earlier report in the folder is replaced.

    Returns:
        Content of `report.json`: `["verdict"]["decision"]` is pass, fail or inconclusive.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    check_target(out, replace)
    handed = tuple(map(str, references))
    request = Request(str(policy), profile, episodes, seed, handed, trust=Trust(allow_code))
    done = conduct(request, lambda _line: None)
    write_folder(out, files_of(done.report, done.profile, done.evidence, done.films), replace)
    return done.report


def command_of(request: Request, seed: int) -> str:
    """Return the command that repeats an audit, without its output folder."""
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
