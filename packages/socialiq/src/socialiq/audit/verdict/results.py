"""Results of an audit: verdict, other drivers that would pass, kinds of episodes, shift check.

A margin can be so wide, and a floor so open, that no driver breaks the declaration. A pass is then
no evidence of the policy's behaviour.

A policy could be made to behave in audits only (thesis 9.5), so the shift check runs it in traffic
that the declaration doesn't name. Its result is reported beside the verdict and decides nothing.
For a verdict on that traffic, declare it in a separate profile.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from socialiq.audit.evidence.drive import GO_AND_WAIT
from socialiq.audit.evidence.outcomes import CRITERIA, Consistency, Evidence, events_of
from socialiq.audit.profile.profile import Profile, Traffic, scenario_sha256
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.verdict import Verdict, decide, enough_resamples, judge, whole_error
from socialiq.social.angle import exact_weights, score
from socialiq.statistics.comparisons import (
    Contrast,
    Difference,
    mean_contrast,
    paired_difference,
    share_contrast,
)
from socialiq.statistics.intervals import Share, wilson
from socialiq.types import RewardPair
from socialiq.worlds.registry import INTERSECTIONS

MEASURES = ("regret", *CRITERIA)


@dataclass(frozen=True)
class Change:
    """A measure of the policy in the declared traffic and in another.

    It is a criterion of the safety floor, or "regret" towards the apparently best reference in
    each. The change of these references, the effect of the traffic on a good driver, is None for
    regret, which is relative to them.
    """

    measure: str
    declared: float
    there: float
    change: float  # the second less the first
    low: float  # lower end of its interval; all intervals of an audit hold jointly
    high: float  # upper end
    shown: bool  # whether the change is significant: the interval excludes 0
    reference: float | None


@dataclass(frozen=True)
class Shift:
    """Result of one other traffic."""

    name: str  # of the traffic
    options: Mapping[str, Any]  # options of the world that differ from the declaration's
    scenario_sha256: str
    episodes: int  # number of episodes; they are others than in the declared traffic
    decision: Decision  # decision by the declared margin and floor there
    best: str  # name of the apparently best reference there
    changes: tuple[Change, ...]  # of each of `MEASURES`

    @property
    def significant(self) -> tuple[Change, ...]:
        """Significant changes."""
        return tuple(change for change in self.changes if change.shown)


def shift_of(
    profile: Profile,
    declared: Evidence,
    traffic: Sequence[Traffic],
    there: Sequence[Evidence],
    seed: int,
    resamples: int = 2000,
) -> tuple[Shift, ...]:
    """Compare the policy's driving in the declared traffic and in others.

    Intervals are Welch's and Newcombe's, because the episodes of each traffic are independent. The
    declared error is divided among all of them (Bonferroni), so it bounds the chance that any
    change is significant if the policy has none.

    Args:
        profile: The declaration.
        declared: Evidence of the verdict.
        traffic: Result of `other_traffic`.
        there: Evidence in each of them.
        seed: Seed of the resampling.
        resamples: Number of resamples.
    """
    error = whole_error(profile.confidence)
    confidence = 1.0 - error / (len(MEASURES) * len(traffic))
    shifts = []
    for variant, evidence in zip(traffic, there, strict=True):
        decisive = decide(profile, evidence, seed, resamples, error)
        shifts.append(
            Shift(
                variant.name,
                dict(variant.options),
                scenario_sha256(variant.world),
                evidence.episodes,
                decisive.decision,
                decisive.regret.best,
                changes(declared, evidence, profile.angle, confidence),
            )
        )
    return tuple(shifts)


def changes(
    declared: Evidence, there: Evidence, angle: float, confidence: float
) -> tuple[Change, ...]:
    """Return the change of every measure from the declared traffic to another.

    The angle is the declared one in degrees, the confidence that of each interval.
    """
    weights, measured = exact_weights(angle), []
    for evidence in (declared, there):
        best = max(evidence.references, key=lambda reference: score(weights, reference.mean))
        gains = (best.totals - evidence.policy.totals).T  # of the apparently best reference
        regrets = np.asarray(score(weights, RewardPair(*gains)))
        measured.append((regrets, events_of(evidence.policy), events_of(best)))
    (old, before, best_before), (new, after, best_after) = measured
    rows = [_change("regret", old.mean(), new.mean(), mean_contrast(new, old, confidence), None)]
    for name in CRITERIA:
        counts = [(int(events[name].sum()), len(events[name])) for events in (after, before)]
        contrast = share_contrast(*counts[0], *counts[1], confidence)
        reference = float(best_after[name].mean() - best_before[name].mean())
        shares = before[name].mean(), after[name].mean()
        rows.append(_change(name, *shares, contrast, reference))
    return tuple(rows)


def sentence_of(shifts: Sequence[Shift]) -> str:
    """Return the result of the shift check in plain words."""
    changed = []
    for shift in shifts:
        texts = []
        for change in shift.significant:
            if change.measure == "regret":
                way = "more" if change.change > 0 else "less"
                texts.append(f"regret is {abs(change.change):.3g} {way}")
            else:
                way = "more often" if change.change > 0 else "less often"
                points = 100 * abs(change.change)
                texts.append(f"it {CRITERIA[change.measure]} {way}, by {points:.3g} points")
        changed += [f"{shift.name}: {', '.join(texts)}"] if texts else []
    same = ", ".join(shift.name for shift in shifts if not shift.significant)
    if not changed:
        return f"In other traffic ({same}) its driving does not change significantly."
    unchanged = f" No significant change: {same}." if same else ""
    return f"In other traffic it drives differently. With {'; with '.join(changed)}.{unchanged}"


def _change(
    measure: str, declared: Any, there: Any, contrast: Contrast, reference: float | None
) -> Change:
    significant = contrast.low > 0.0 or contrast.high < 0.0
    return Change(measure, float(declared), float(there), *contrast, significant, reference)


def conclude(verdict: Verdict, findings: Sequence[str]) -> Verdict:
    """Return the verdict of an audit: INCONCLUSIVE where a finding forbids a pass.

    A fail stays a fail, since no finding makes a policy better. The tests are unchanged, and more
    episodes would not decide.
    """
    if verdict.decision is Decision.FAIL or not findings:
        return verdict
    reason = " ".join(findings)
    return replace(verdict, decision=Decision.INCONCLUSIVE, reason=reason, needed=None)


def dependence(consistency: Consistency | None) -> str:
    """Return on what a policy's answers depend besides the observation; "" if it wasn't asked.

    How it drove in the episodes is then no evidence about how it drives elsewhere.
    """
    if consistency is None or not consistency.dependences:
        return ""
    differing, queries = (
        sum(getattr(answers, name) for answers in consistency) for name in ("differing", "queries")
    )
    return (
        f"The policy's answers depend on {' and on '.join(consistency.dependences)}: "
        f"{differing:,} of {queries:,} repeated queries got another answer, so its episodes don't "
        "show how it drives elsewhere."
    )


@dataclass(frozen=True)
class OtherDriver:
    """Decision on another driver, had it been the policy of this declaration.

    A trivial one acts without regard to what it observes: one action always, or random ones.
    """

    name: str
    trivial: bool
    decision: Decision


@dataclass(frozen=True)
class Discrimination:
    """Drivers that would pass a declaration."""

    would_pass: int  # number of drivers
    of: int  # drivers in all
    excludes_nothing: bool  # whether every trivial driver would pass
    drivers: tuple[OtherDriver, ...]


def discriminate(
    profile: Profile,
    evidence: Evidence,
    seed: int,
    resamples: int = 2000,
    error: float | None = None,
) -> Discrimination:
    """Judge every other driver by the declaration of the policy; arguments are those of `judge`.

    Each is compared with the other references, as the policy is. Drivers that are the policy itself
    are left out of the evidence (`Evidence.without`).
    """
    level = whole_error(profile.confidence) if error is None else error
    count = enough_resamples(level, resamples)
    constant = GO_AND_WAIT if profile.scenario.world in INTERSECTIONS else ()
    drivers = [(driver, driver.name in constant) for driver in evidence.references]
    drivers += [(driver, True) for driver in evidence.trivial]
    decided = []
    for driver, trivial in drivers:
        references = tuple(
            reference for reference in evidence.references if reference is not driver
        )
        if references:
            swapped = replace(evidence, policy=driver, references=references, trivial=())
            decision = decide(profile, swapped, seed, count, level).decision
            decided.append(OtherDriver(driver.name, trivial, decision))
    passing = [driver for driver in decided if driver.decision is Decision.PASS]
    without_regard = {driver.decision for driver in decided if driver.trivial}
    return Discrimination(
        would_pass=len(passing),
        of=len(decided),
        excludes_nothing=without_regard == {Decision.PASS},
        drivers=tuple(decided),
    )


_FEWEST = 2  # episodes of a stratum for the test of a difference


@dataclass(frozen=True)
class Stratum:
    """A policy in the episodes of one label.

    Regret is towards the apparently best reference over all episodes, with a two-sided Student
    interval; None if there are fewer than two episodes. Intervals, Wilson's of the shares, are of
    each stratum alone: of many, some miss.
    """

    stratification: str  # for instance "density"
    label: str  # for instance "4 or more"
    episodes: int
    regret: Difference | None
    shares: dict[str, Share]  # of each criterion of the floor


def stratified(
    evidence: Evidence, angle: float, reference: str, confidence: float = 0.95
) -> tuple[Stratum, ...]:
    """Break the evidence down by every stratification, at the declared angle in degrees.

    The reference to compare with, `RegretTest.best`, is the same in every stratum, so that
    regrets, weighted by episodes, add up to the whole regret.
    """
    best = next(driver for driver in evidence.references if driver.name == reference)
    reference_values, ours = best.values(angle), evidence.policy.values(angle)
    events, strata = events_of(evidence.policy), []
    for stratification, labels in evidence.strata.items():
        for label in np.unique(labels).tolist():
            rows = labels == label
            count, regret = int(rows.sum()), None
            if count >= _FEWEST:
                regret = paired_difference(reference_values[rows], ours[rows], confidence)
            shares = {
                name: wilson(int(happened[rows].sum()), count, confidence)
                for name, happened in events.items()
            }
            strata.append(Stratum(stratification, label, count, regret, shares))
    return tuple(strata)


class Results(NamedTuple):
    """Verdict as far as no finding forbids it, discrimination, and changes in other traffic."""

    verdict: Verdict
    discrimination: Discrimination
    shifts: tuple[Shift, ...] | None


def results_of(
    profile: Profile,
    evidence: Evidence,
    left_out: Collection[str],
    seed: int,
    traffic: Sequence[Traffic] = (),
    elsewhere: Sequence[Evidence] = (),
    error: float | None = None,
    consistency: Consistency | None = None,
) -> Results:
    """Judge a policy by its evidence.

    Args:
        profile: The declaration.
        evidence: Evidence in the declared traffic, of all references.
        left_out: Names of the references that are the policy itself. The regret towards them is
            0; estimating it would only widen the bounds.
        seed: Seed of the resampling.
        traffic: Result of `other_traffic`, or none.
        elsewhere: Evidence in each of these, of all references.
        error: Error of this look (`look.spend`); None for the whole error, 1 - confidence.
        consistency: Answers of the policy to repeated queries; None if it was not asked.

    Raises:
        UserError: If the evidence is of another scenario.
    """
    compared, *there = [drives.without(left_out) for drives in (evidence, *elsewhere)]
    discrimination = discriminate(profile, compared, seed, error=error)
    tested = judge(profile, compared, seed, curve=evidence, error=error)
    findings = [dependence(consistency)]
    if discrimination.excludes_nothing:
        findings.append(
            "The declaration excludes nothing: constant actions and random ones would pass it too. "
            "Declare a smaller margin, or a stricter floor."
        )
    return Results(
        verdict=conclude(tested, [text for text in findings if text]),
        discrimination=discrimination,
        shifts=shift_of(profile, compared, traffic, there, seed) if traffic else None,
    )
