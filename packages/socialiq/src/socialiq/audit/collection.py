"""Collection of an audit's evidence: the drivers of a request on episodes of one world."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Int64

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.consistency import Recorder
from socialiq.audit.evidence.drive import ByRule
from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.profile.junction import Junction
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.scenario import World
from socialiq.audit.request import Request
from socialiq.audit.resolve_policy import (
    References,
    is_code,
    reference_dial,
    resolve_policy,
    resolve_references,
)
from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.policies.interface import Loaded
from socialiq.worlds.context_policy import ContextPolicy
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.intersection.world import Intersection


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
        found = resolve_references(world, request.references, loaded.record, request.trust)
        closing.callback(found.close)
        none, by_rule = np.zeros(0, np.int64), None
        if profile.rule is not None:
            if loaded.record.kind == "dial":
                raise UserError(
                    "a dial has one angle here: write its policy with `socialiq turn --angle-rule`"
                )
            if request.soft:
                raise UserError("a declared rule is tested with best actions: leave out --soft")
            dial = None if isinstance(world, GridWorld) else reference_dial(request.references)
            by_rule = ByRule(profile.rule, dial)
            if dial is not None:
                ContextPolicy.of(dial, profile.rule)  # refuses what doesn't fit, before any episode
        return Collection(request, profile, traffic, world, loaded, found, none, by_rule)

    def on(self, seeds: Int64[np.ndarray, " episode"]) -> Collection:
        """Return the collection on episodes of these seeds."""
        return self._replace(seeds=seeds)

    def check_parts(self) -> None:
        """Refuse a stochastic policy whose draws depend on the order of all episodes.

        Raises:
            UserError: If parts of the episodes would give other evidence than all at once.
        """
        draws_by_seed = isinstance(self.world, Intersection | Junction) and isinstance(
            self.loaded.policy, SoftPolicy
        )
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
