"""Verdict and shift check from the evidence of every traffic, for an audit and its verification."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.profile.profile import Profile
from socialiq.audit.verdict.discrimination import Discrimination, discriminate, finding_of
from socialiq.audit.verdict.findings import Finding, conclude
from socialiq.audit.verdict.shift import Shift, Traffic, shift_of
from socialiq.audit.verdict.verdict import Verdict, judge


class Judged(NamedTuple):
    """Results of an audit.

    Attributes:
        verdict: Result of `judge`, as far as no finding forbids it (`conclude`).
        discrimination: Result of `discriminate`.
        shifts: Result of `shift_of`, or None without other traffic.
    """

    verdict: Verdict
    discrimination: Discrimination
    shifts: tuple[Shift, ...] | None


def judged(
    profile: Profile,
    evidence: Evidence,
    left_out: Collection[str],
    seed: int,
    traffic: Sequence[Traffic] = (),
    elsewhere: Sequence[Evidence] = (),
    error: float | None = None,
    findings: Sequence[Finding] = (),
) -> Judged:
    """Judge a policy by its evidence.

    Args:
        profile: The declaration.
        evidence: Evidence in the declared traffic, of all references.
        left_out: Names of the references that are the policy itself. The regret towards them is
            0; estimating it would only widen the bounds.
        seed: Seed of the resampling.
        traffic: Result of `other_traffic`, or none.
        elsewhere: Evidence in each of these, of all references.
        error: Error of this look (`looks.spending`); None for the whole error, 1 - confidence.
        findings: Findings beside the tests that forbid a pass.

    Raises:
        UserError: If the evidence is of another scenario.
    """
    compared, *there = [one.without(left_out) for one in (evidence, *elsewhere)]
    others = discriminate(profile, compared, seed, error=error)
    tested = judge(profile, compared, seed, curve=evidence, error=error)
    return Judged(
        verdict=conclude(tested, [*findings, *finding_of(others)]),
        discrimination=others,
        shifts=shift_of(profile, compared, traffic, there, seed) if traffic else None,
    )
