"""Discrimination of a declaration: which other drivers would pass it on the same episodes.

A margin can be so wide, and a floor so open, that no driver breaks the declaration. A pass is then
no evidence of the policy's behaviour.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.evidence.trivial import GO_AND_WAIT
from socialiq.audit.profile.profile import Profile
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.findings import Finding
from socialiq.audit.verdict.verdict import decide, enough_resamples, whole_error
from socialiq.worlds.registry import INTERSECTIONS


@dataclass(frozen=True)
class OtherDriver:
    """Decision on another driver, had it been the policy of this declaration.

    Attributes:
        name: Name of the driver.
        trivial: Whether it acts without regard to what it observes: one action always, or random
            ones.
        decision: Decision by the same tests with the same margin, floor and error.
    """

    name: str
    trivial: bool
    decision: Decision


@dataclass(frozen=True)
class Discrimination:
    """Drivers that would pass a declaration.

    Attributes:
        would_pass: Number of drivers that would pass.
        of: Number of drivers.
        excludes_nothing: Whether every trivial driver would pass.
        drivers: Decision on each driver.
    """

    would_pass: int
    of: int
    excludes_nothing: bool
    drivers: tuple[OtherDriver, ...]


def discriminate(
    profile: Profile,
    evidence: Evidence,
    seed: int,
    resamples: int = 2000,
    error: float | None = None,
) -> Discrimination:
    """Judge every other driver by the declaration of the policy.

    Each is compared with the other references, as the policy is. Drivers that are the policy itself
    are left out of the evidence (`Evidence.without`).

    Args:
        profile: The declaration.
        evidence: Evidence of the verdict.
        seed: Seed of the resampling.
        resamples: Smallest number of resamples, as for `judge`.
        error: Error of the tests; None for 1 - confidence.
    """
    level = whole_error(profile.confidence) if error is None else error
    count = enough_resamples(level, resamples)
    constant = GO_AND_WAIT if profile.scenario.world in INTERSECTIONS else ()
    drivers = [(one, one.name in constant) for one in evidence.references]
    drivers += [(one, True) for one in evidence.trivial]
    found = []
    for one, trivial in drivers:
        others = tuple(other for other in evidence.references if other is not one)
        if others:
            swapped = replace(evidence, policy=one, references=others, trivial=())
            decision = _decision(profile, swapped, level, seed, count)
            found.append(OtherDriver(one.name, trivial, decision))
    passing = [one for one in found if one.decision is Decision.PASS]
    without_regard = {one.decision for one in found if one.trivial}
    return Discrimination(
        would_pass=len(passing),
        of=len(found),
        excludes_nothing=without_regard == {Decision.PASS},
        drivers=tuple(found),
    )


def finding_of(found: Discrimination) -> list[Finding]:
    """Return why a policy can't pass a declaration that excludes nothing, or nothing."""
    if not found.excludes_nothing:
        return []
    text = (
        "The declaration excludes nothing: constant actions and random ones would pass it too. "
        "Declare a smaller margin, or a stricter floor."
    )
    return [Finding("margin", text)]


def _decision(
    profile: Profile, evidence: Evidence, error: float, seed: int, resamples: int
) -> Decision:
    return decide(profile, evidence, seed, resamples, error).decision
