"""Request of an audit, the command that repeats it, and the evidence that it collects."""

from __future__ import annotations

import contextlib
import dataclasses
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int64

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.consistency import Recorder, joined
from socialiq.audit.evidence.drive import SIDE_BY_SIDE, ByRule
from socialiq.audit.evidence.outcomes import Evidence, Outcomes, check_episodes
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.reader import load
from socialiq.audit.resolve_policy import (
    References,
    Trust,
    is_code,
    reference_dial,
    resolve_policy,
    resolve_references,
)
from socialiq.audit.seeds import Nonce, Round, check_seed, read_nonce, read_round
from socialiq.audit.verdict.shift import other_traffic
from socialiq.errors import UserError
from socialiq.evaluation.parts import blocks_of, in_parts
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.learners.callbacks import Report
from socialiq.policies.interface import Loaded
from socialiq.policies.process import GIB, Limits
from socialiq.worlds.situation import ContextPolicy
from socialiq.worlds.world import World


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
        in_parts: Whether the episodes are run in parts, by several processes.
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
    in_parts: bool = False

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
        if sum(origin is not None for origin in (self.seed, self.nonce, self.beacon)) > 1:
            raise UserError("an audit has one seed: give one of --seed, --nonce and --beacon")

    def given(self) -> int | Nonce | Round | None:
        """Return the auditor's seed, nonce or round of a beacon; None draws the seed.

        Raises:
            UserError: If its file can't be read, or a round's signature is not the beacon's.
        """
        if self.nonce is not None:
            return read_nonce(self.nonce)
        return self.seed if self.beacon is None else read_round(self.beacon)


def command_of(request: Request, seed: int) -> str:
    """Return the command that repeats an audit, without its output folder."""
    words = ["socialiq", "audit", request.policy, "--profile", str(request.profile)]
    words += ["--episodes", str(request.episodes), "--seed", str(seed)]
    words += [word for reference in request.references for word in ("--reference", reference)]
    words += ["--films"] if request.films else []
    words += ["--shift"] if request.shift else []
    words += ["--soft"] if request.soft else []
    words += ["--allow-code"] if request.trust.allow_code else []
    words += [word for file in request.trust.files for word in ("--files", file)]
    if request.trust.isolation != "auto":
        words += ["--isolation", request.trust.isolation]
    limits, usual = request.trust.limits, Limits()
    if limits.step != usual.step:
        words += ["--step-seconds", f"{limits.step:g}"]
    if limits.memory != usual.memory:
        words += ["--memory-gib", f"{limits.memory / GIB:g}"]
    return shlex.join(words)


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
        by_rule: The declared rule of the angle; None without one.
    """

    request: Request
    profile: Profile
    traffic: int | None
    world: World
    loaded: Loaded
    references: References
    seeds: Int64[np.ndarray, " episode"]
    by_rule: ByRule | None = None

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
        references = resolve_references(world, request.references, loaded.record, request.trust)
        closing.callback(references.close)
        none, by_rule = np.zeros(0, np.int64), None
        if profile.rule is not None:
            if loaded.record.kind == "dial":
                raise UserError(
                    "a dial has one angle here: write its policy with `socialiq turn --angle-rule`"
                )
            if request.soft:
                raise UserError("a declared rule is tested with best actions: leave out --soft")
            dial = None if world.is_exact else reference_dial(request.references)
            by_rule = ByRule(profile.rule, dial)
            if dial is not None:
                ContextPolicy.of(dial, profile.rule)  # refuses what doesn't fit, before any episode
        return Collection(request, profile, traffic, world, loaded, references, none, by_rule)

    def on(self, seeds: Int64[np.ndarray, " episode"]) -> Collection:
        """Return the collection on episodes of these seeds."""
        return self._replace(seeds=seeds)

    def check_parts(self) -> None:
        """Refuse a stochastic policy whose draws depend on the order of all episodes.

        Raises:
            UserError: If parts of the episodes would give other evidence than all at once.
        """
        draws_by_seed = self.world.draws_by_seed and isinstance(self.loaded.policy, SoftPolicy)
        if self.by_rule is not None:
            raise UserError("a declared rule is tested in one process: leave out --processes")
        if self.request.soft and not draws_by_seed:
            raise UserError(
                "this policy draws its actions in order: leave out --soft, or --processes"
            )

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
            by_rule=self.by_rule,
        )
        if isinstance(policy, Recorder):
            angle = self.profile.angle
            with resolve_policy(request.policy, self.world, angle, request.trust) as fresh:
                evidence = dataclasses.replace(evidence, consistency=policy.check(fresh.policy))
        self.loaded.check_unchanged()
        return evidence


class _Part(NamedTuple):
    """Episodes that a process of its own runs; `hashes` are of policy and declaration."""

    request: Request
    traffic: int | None
    hashes: tuple[str, str]
    side_by_side: int
    seeds: Int64[np.ndarray, " episode"]


def _collect_part(part: _Part) -> Evidence:
    request, profile = part.request, load(part.request.profile)
    world = scenario = profile.world(request.trust.allow_code)
    if part.traffic is not None:
        scenario = other_traffic(profile)[part.traffic].world
    with contextlib.ExitStack() as closing:
        loaded = resolve_policy(request.policy, world, profile.angle, request.trust)
        closing.enter_context(loaded)
        if (loaded.record.sha256, profile.sha256) != part.hashes:
            raise UserError("policy or declaration have changed since the audit began")
        collection = Collection.of(request, profile, part.traffic, scenario, loaded, closing)
        return collection.on(part.seeds).collect(part.side_by_side)


def collect_in_parts(
    collection: Collection, processes: int, on_report: Callable[[Report], None] | None = None
) -> Evidence:
    """Run all drivers on the episodes in parts; the evidence is the same in however many.

    Args:
        collection: What is to be collected.
        processes: Number of processes.
        on_report: Called with the progress after each part.

    Raises:
        UserError: If the episodes can't be split, or a part fails.
    """
    collection.check_parts()
    hashes = (collection.loaded.record.sha256, collection.profile.sha256)
    size = min(SIDE_BY_SIDE, len(collection.seeds))
    parts = [
        _Part(collection.request, collection.traffic, hashes, size, block)
        for block in blocks_of(collection.seeds, processes)
    ]
    played = in_parts(_collect_part, parts, processes, on_report)
    first, columns = played[0], zip(*(evidence.drivers for evidence in played), strict=True)
    drivers = [_end_to_end(column) for column in columns]
    if collection.world.is_exact:
        # Angles and expectations of the exact optima are computed here: their last bits depend on
        # the number of threads of a process.
        here = collection.on(collection.seeds[:1]).collect().drivers
        drivers = [
            dataclasses.replace(driver, angles=exact.angles, expected=exact.expected)
            for driver, exact in zip(drivers, here, strict=True)
        ]
    count = 1 + len(first.references)
    return Evidence(
        scenario=first.scenario,
        seeds=collection.seeds,
        policy=drivers[0],
        references=tuple(drivers[1:count]),
        strata={
            name: np.concatenate([evidence.strata[name] for evidence in played])
            for name in first.strata
        },
        trivial=tuple(drivers[count:]),
        consistency=joined([evidence.consistency for evidence in played]),
    )


def _end_to_end(parts: Sequence[Outcomes]) -> Outcomes:
    columns = ("totals", "ending", "contact", "length")
    values = {name: [getattr(outcomes, name) for outcomes in parts] for name in columns}
    return dataclasses.replace(parts[0], **{k: np.concatenate(v) for k, v in values.items()})
