"""Collect evidence: the policy and its references drive the same episodes, of several kinds."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Int64

from socialiq.audit import request as requested
from socialiq.audit.evidence import drive
from socialiq.audit.evidence.consistency import Recorder, joined
from socialiq.audit.evidence.outcomes import (
    AS_DECLARED,
    Evidence,
    Outcomes,
    Reference,
    end_to_end,
)
from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.profile import Profile, other_traffic
from socialiq.audit.profile.reader import load
from socialiq.audit.request import References, Request, resolve_policy
from socialiq.errors import UserError
from socialiq.evaluation import parts
from socialiq.evaluation.episodes import CONFLICT_SECONDS
from socialiq.evaluation.simulate import SoftPolicy, shown_rows
from socialiq.learners.callbacks import Report
from socialiq.policies.interface import Loaded
from socialiq.types import Policy
from socialiq.worlds.catalogue import INTERSECTION, base
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.intersection import policies
from socialiq.worlds.situation import ContextPolicy
from socialiq.worlds.world import World

BLOCK = 250
"""Episodes that a process of a policy drives before it is ended and another one is started."""

REPEATED = 3  # episodes of an environment that are started twice, to check its seeding
Seeds = Int64[np.ndarray, " episode"]


@dataclass(frozen=True)
class Collection:
    """The drivers of an audit in one traffic."""

    request: Request
    profile: Profile
    traffic: int | None  # number of a traffic of `other_traffic`, or None for the declared one
    world: World  # of the episodes
    loaded: Loaded  # policy
    references: References
    by_rule: drive.ByRule | None

    @staticmethod
    def of(
        request: Request,
        profile: Profile,
        traffic: int | None,
        world: World,
        loaded: Loaded,
        closing: contextlib.ExitStack,
    ) -> Collection:
        """Resolve the references in the world, and check that a declared rule can be tested.

        Args:
            request: Request of the audit.
            profile: The declaration.
            traffic: Number of a traffic of `other_traffic`, from 0; None for the declared one.
            world: World of the episodes.
            loaded: The policy under audit.
            closing: Ends the processes of the references.

        Raises:
            UserError: If a reference can't be read or doesn't fit, the world has no reference, or
                the declared rule can't be tested with this policy and these options.
        """
        specs = request.references
        by_rule = None
        angles = requested.dial_angles(profile.angle, profile.margin.width)
        drivers = (world, specs, loaded.record.as_json(), request.trust, closing, angles)
        references = requested.resolve_references(*drivers)
        if not (references.drivers or world.references or world.is_exact):
            raise UserError(
                f"{world.name} has no reference drivers: name at least one with --reference DRIVER"
            )
        if profile.rule is not None:
            if loaded.record.kind == "dial":
                raise UserError(
                    "a dial has one angle here: write its policy with `socialiq turn --angle-rule`"
                )
            if request.soft:
                raise UserError("a declared rule is tested with best actions: leave out --soft")
            dial = None if world.is_exact else requested.reference_dial(specs)
            by_rule = drive.ByRule(profile.rule, dial)
            if dial is not None:
                ContextPolicy.of(dial, profile.rule)  # refuses what doesn't fit, before any episode
        return Collection(request, profile, traffic, world, loaded, references, by_rule)

    def check_parts(self) -> None:
        """Refuse, by a `UserError`, what would give other evidence in parts than all at once."""
        draws_by_seed = self.world.draws_by_seed and isinstance(self.loaded.policy, SoftPolicy)
        if self.by_rule is not None:
            raise UserError("a declared rule is tested in one process: leave out --processes")
        if self.request.soft and not draws_by_seed:
            raise UserError(
                "this policy draws its actions in order: leave out --soft, or --processes"
            )

    def collect(self, seeds: Seeds, side_by_side: int | None = None) -> Evidence:
        """Run all drivers in this process; ask a policy that is code again what it was asked.

        Policies that are data run by this package's code.

        Args:
            seeds: Seeds of the episodes.
            side_by_side: Number of episodes at once, as for `Course`.

        Raises:
            UserError: As `collect_evidence`, or if the policy's files have changed meanwhile.
        """
        request = self.request
        policy = self.loaded.policy
        restart = self.loaded.restart
        policy = policy if restart is None else Recorder(policy, restart)
        evidence = collect_evidence(
            self.world,
            policy,
            seeds,
            self.references.drivers,
            deterministic=not request.soft,
            threads=request.threads,
            side_by_side=side_by_side,
            by_rule=self.by_rule,
            measured=self.profile.effects,
            schema=self.loaded.record.interface.schema,
        )
        if isinstance(policy, Recorder):
            evidence = replace(evidence, consistency=policy.check())
        self.loaded.check_unchanged()
        return evidence

    def collect_in_parts(
        self, seeds: Seeds, processes: int, on_report: Callable[[Report], None] | None = None
    ) -> Evidence:
        """Run all drivers by several processes; the evidence is the same for any number of them.

        Args:
            seeds: Seeds of the episodes, which are divided into blocks.
            processes: Number of processes.
            on_report: Called with the progress after each part.

        Raises:
            UserError: If a part fails, for instance because policy or declaration have changed.
        """
        hashes = (self.loaded.record.sha256, self.profile.sha256)
        size = min(drive.SIDE_BY_SIDE, len(seeds))
        play = functools.partial(_collect_part, self.request, self.traffic, hashes, size)
        blocks = parts.blocks_of(seeds, processes)
        played = parts.in_parts(play, blocks, processes, on_report)
        columns = zip(*(evidence.drivers for evidence in played), strict=True)
        first = played[0]
        drivers = list(map(end_to_end, columns))
        if self.world.is_exact:
            # Angles and expectations of the exact optima are computed here: their last bits depend
            # on the number of threads of a process.
            drivers = [
                replace(driver, angles=exact.angles, expected=exact.expected)
                for driver, exact in zip(drivers, self.collect(seeds[:1]).drivers, strict=True)
            ]
        count = 1 + len(first.references)
        strata = {
            name: np.concatenate([evidence.strata[name] for evidence in played])
            for name in first.strata
        }
        policy = drivers[0]
        references = tuple(drivers[1:count])
        trivial = tuple(drivers[count:])
        answers = joined([evidence.consistency for evidence in played])
        return Evidence(first.scenario, seeds, policy, references, strata, trivial, answers)


def _collect_part(
    request: Request, traffic: int | None, hashes: tuple[str, str], side_by_side: int, seeds: Seeds
) -> Evidence:
    """Run all drivers in a separate process, if policy and declaration have these hashes."""
    profile = load(request.profile)
    world = scenario = profile.world(request.trust.allow_code)
    if traffic is not None:
        scenario = other_traffic(profile, request.shift or ())[traffic].world
    with contextlib.ExitStack() as closing:
        loaded = resolve_policy(request.policy, world, profile.angle, request.trust)
        closing.enter_context(loaded)
        if (loaded.record.sha256, profile.sha256) != hashes:
            raise UserError("policy or declaration have changed since the audit began")
        collection = Collection.of(request, profile, traffic, scenario, loaded, closing)
        return collection.collect(seeds, side_by_side)


def collect_evidence(
    world: World,
    policy: Policy,
    seeds: Seeds,
    references: Sequence[Reference] = (),
    deterministic: bool = True,
    threads: int = 1,
    side_by_side: int | None = None,
    by_rule: drive.ByRule | None = None,
    measured: Sequence[str] = (),
    schema: str = "",
) -> Evidence:
    """Run the policy, its references and trivial drivers on the same episodes.

    In a gridworld the exact optima are always among the references, elsewhere the world's own
    (`World.references`); an environment has none. Trivial drivers run in every world.
    The result has some 50 bytes for each episode and driver.

    Args:
        world: World of the declaration: `Profile.world()`.
        policy: The policy under audit.
        seeds: Seeds of the episodes: `seeds.episode_seeds`.
        references: Further drivers, for instance a family of policies over the angles.
        deterministic: Whether the policy takes its best action; references always do.
        threads: Number of threads of a compiled world.
        side_by_side: Number of episodes at once, as for `Course`.
        by_rule: A declared rule of the angle: decision losses are measured too.
        measured: Effects that have bounds.
        schema: Schema of what the policy observes, as `World.schema`; "" for the world's.

    Raises:
        UserError: If the policy's answers are invalid, or two drivers have one name.
    """
    if isinstance(world, Environment):
        for seed in seeds[:REPEATED]:
            world.check_repeats(int(seed))
    course = drive.Course(world, seeds, side_by_side, threads, by_rule, measured)
    driver = Reference("policy", policy, schema=schema)
    driven = list[Outcomes]()
    for block in course.blocks(BLOCK) if isinstance(policy, Recorder) else [course]:
        if isinstance(policy, Recorder):
            policy.restart()
        driven.append(block.drive(driver, deterministic, drive.CANDIDATES))
    return Evidence(
        scenario=world.description,
        seeds=seeds,
        policy=end_to_end(driven),
        references=drive_references(course, references),
        strata=strata_of(course),
        trivial=drive.trivial_drivers(course),
    )


def drive_references(course: drive.Course, references: Sequence[Reference]) -> tuple[Outcomes, ...]:
    """Run the exact optima, the world's own references, further ones, and a declared rule's.

    Args:
        course: Episodes to drive.
        references: Further drivers, for instance a family of policies over the angles.

    Returns:
        Outcomes in this order: exact optima of a gridworld, the world's own references, further
        ones, and the reference `AS_DECLARED`, if a rule is declared.
    """
    world = course.world
    by_rule = course.by_rule
    drivers = [*(Reference(rule, world.driver(rule)) for rule in world.references), *references]
    if by_rule is not None and by_rule.dial is not None:
        drivers.append(Reference(AS_DECLARED, ContextPolicy.of(by_rule.dial, by_rule.rule)))
    compared = [
        *(drive.exact_optima(course) if world.is_exact else ()),
        *map(course.drive, drivers),
    ]
    if by_rule is not None and world.is_exact:
        compared.append(drive.exactly_as_declared(course, by_rule.rule))
    return tuple(compared)


NO_CROSSING = "nobody crosses"  # codespell:ignore
"""Label of episodes without a crossing vehicle; a key of written reports."""

_SOON = 5  # steps of a gridworld within which the first conflicts are decided


def strata_of(course: drive.Course) -> dict[str, np.ndarray]:
    """Return labels of all episodes by stratification; none in an environment of other code.

    They depend on the seeds alone: in a gridworld on the draws that decide where vehicles spawn,
    on roads on the ego's first observation.
    """
    batch = course.batch
    seeds = course.seeds
    name = course.world.name
    if course.world.is_exact:
        batch.reset(seeds)
        fate = batch.save().fate
        chance = batch.table.world.chance
        if len(chance) == 1:  # nothing is drawn
            return {}
        spawns = (fate[:, 1 : 1 + _SOON] >= 1.0 - chance[-1]).sum(axis=1)
        return {"density": np.select([spawns == 0, spawns == 1], ["0", "1"], "2 or more")}
    if base(name) not in (INTERSECTION, "recorded-junction"):
        return {}
    label = intersection_strata if base(name) == INTERSECTION else junction_strata
    blocks = []
    for first in range(0, len(seeds), batch.size):
        block = seeds[first : first + batch.size]
        observation = batch.reset(block, rows=np.arange(len(block)))
        blocks.append(label(shown_rows(batch, observation)[: len(block)]))
    return {
        stratification: np.concatenate([labels[stratification] for labels in blocks])
        for stratification in blocks[0]
    }


def intersection_strata(
    observation: Float32[np.ndarray, "episode feature"],
) -> dict[str, np.ndarray]:
    """Return labels of the vehicles in view, and of those that cross within `CONFLICT_SECONDS`."""
    rows = policies.in_metres(observation)
    vehicles = (rows[:, 1:, 0] > 0).sum(axis=1)
    crossing = policies.conflict(rows, CONFLICT_SECONDS)
    other_road = np.abs(rows[:, 1:, 3]) > np.abs(rows[:, 1:, 4])
    met = crossing.any(axis=1)
    yielding = (crossing & other_road).any(axis=1)
    return {
        "density": np.select([vehicles <= 1, vehicles <= 3], ["0 to 1", "2 to 3"], "4 or more"),
        "conflict": np.where(met, "at once", "none yet"),
        "right_of_way": np.select([yielding, met], ["theirs", "oncoming"], NO_CROSSING),
    }


def junction_strata(observation: Float32[np.ndarray, "episode feature"]) -> dict[str, np.ndarray]:
    """Return labels from the ego's first observation: number of other rows, closed lines too."""
    rows = observation.reshape(len(observation), -1, len(FEATURES))
    count = (rows[:, 1:, 0] > 0).sum(axis=1)
    return {"density": np.select([count <= 3, count <= 7], ["0 to 3", "4 to 7"], "8 or more")}
