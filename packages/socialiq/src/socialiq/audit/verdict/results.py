"""Results in addition to the verdict: other drivers that would pass, kinds of episodes, shift.

A policy could be made to behave in audits only (thesis 9.5), so the shift check runs it in traffic
that the declaration doesn't name. Its result is reported next to the verdict and does not affect
it. For a verdict on that traffic, declare it in a separate profile. A further test finds a policy
whose driving depends on the order of the episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import kolmogorov

from socialiq.audit.evidence.drive import GO_AND_WAIT
from socialiq.audit.evidence.outcomes import CRITERIA, Evidence, events_of
from socialiq.audit.profile.profile import Profile, Traffic, scenario_sha256
from socialiq.audit.verdict.bounds import bound_tests
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets
from socialiq.audit.verdict.verdict import decide, direction_tests, enough_resamples
from socialiq.social.angle import exact_weights, score
from socialiq.statistics import comparisons
from socialiq.statistics.comparisons import Contrast, Difference
from socialiq.statistics.intervals import Share, wilson
from socialiq.types import Json, RewardPair
from socialiq.worlds.catalogue import INTERSECTION, base

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
    options: Json  # options of the world that differ from the declaration's
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
        declared: Evidence in the declared traffic.
        traffic: Result of `other_traffic`.
        there: Evidence in each of these, in their order.
        seed: Seed of the resampling.
        resamples: Number of resamples.

    Returns:
        A result for each other traffic.
    """
    error = profile.error
    confidence = 1.0 - error / (len(MEASURES) * len(traffic))
    shifts = []
    for variant, evidence in zip(traffic, there, strict=True):
        decisive = decide(profile, evidence, seed, resamples, error)
        traffic_there = variant.name, dict(variant.options), scenario_sha256(variant.world)
        outcome = evidence.episodes, decisive.decision, decisive.regret.best
        changed = changes(declared, evidence, profile.angle, confidence)
        shifts.append(Shift(*traffic_there, *outcome, changed))
    return tuple(shifts)


def changes(
    declared: Evidence, there: Evidence, angle: float, confidence: float
) -> tuple[Change, ...]:
    """Return the change of every measure from the declared traffic to another.

    Args:
        declared: Evidence in the declared traffic.
        there: Evidence in another traffic.
        angle: Declared angle in degrees.
        confidence: Confidence of each interval.

    Returns:
        A change for each of `MEASURES`.
    """
    weights = exact_weights(angle)
    measured = []
    for evidence in (declared, there):
        best = max(evidence.references, key=lambda reference: score(weights, reference.mean))
        gains = (best.totals - evidence.policy.totals).T  # of the apparently best reference
        regrets = np.asarray(score(weights, RewardPair(*gains)))
        measured.append((regrets, events_of(evidence.policy), events_of(best)))
    (old, before, best_before), (new, after, best_after) = measured
    contrast = comparisons.mean_contrast(new, old, confidence)
    rows = [_change("regret", old.mean(), new.mean(), contrast, None)]
    for name in CRITERIA:
        counts = [(int(events[name].sum()), len(events[name])) for events in (after, before)]
        contrast = comparisons.share_contrast(*counts[0], *counts[1], confidence)
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


_FEWEST = 2  # episodes of a stratum for the test of a difference


@dataclass(frozen=True)
class Stratum:
    """A policy in the episodes of one label.

    Regret is towards the apparently best reference over all episodes, with a two-sided Student
    interval; None if there are fewer than two episodes. Each interval, Wilson's for the shares,
    holds for its stratum alone: of many, some miss.
    """

    stratification: str  # for instance "density"
    label: str  # for instance "4 or more"
    episodes: int
    regret: Difference | None
    shares: dict[str, Share]  # of each criterion of the floor


def stratified(
    evidence: Evidence, angle: float, reference: str, confidence: float = 0.95
) -> tuple[Stratum, ...]:
    """Break the evidence down by every stratification.

    One reference is compared in every stratum, so that regrets, weighted by episodes, add up to the
    whole regret.

    Args:
        evidence: The evidence.
        angle: Declared angle in degrees.
        reference: Name of the reference to compare with, `RegretTest.best`.
        confidence: Confidence of each interval.

    Returns:
        A row for each label of each stratification, labels in alphabetical order.
    """
    best = next(driver for driver in evidence.references if driver.name == reference)
    reference_values = best.values(angle)
    ours = evidence.policy.values(angle)
    events = events_of(evidence.policy)
    strata = []
    for stratification, labels in evidence.strata.items():
        for label in np.unique(labels).tolist():
            rows = labels == label
            count = int(rows.sum())
            regret = None
            if count >= _FEWEST:
                pair = reference_values[rows], ours[rows]
                regret = comparisons.paired_difference(*pair, confidence)
            shares = {
                name: wilson(int(happened[rows].sum()), count, confidence)
                for name, happened in events.items()
            }
            strata.append(Stratum(stratification, label, count, regret, shares))
    return tuple(strata)


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
    trivial_passes: tuple[str, ...]  # names of the trivial drivers that would pass
    drivers: tuple[OtherDriver, ...]

    @property
    def excludes_nothing(self) -> bool:
        """Whether every trivial driver would pass."""
        return bool(self.trivial_passes) and len(self.trivial_passes) == sum(
            driver.trivial for driver in self.drivers
        )


def discriminate(
    profile: Profile,
    evidence: Evidence,
    seed: int,
    resamples: int = 2000,
    error: float | None = None,
    directed: Evidence | None = None,
) -> Discrimination:
    """Judge every other driver by the declaration of the policy.

    Each is compared with the remaining references, as the policy is. Drivers that are the policy
    itself are left out of the evidence (`Evidence.without`), but keep their place in the direction.

    Args:
        profile: The declaration.
        evidence: Evidence as for `judge`.
        seed: Seed of the resampling.
        resamples: Smallest number of resamples; a small error takes more.
        error: Error of this look; None for the whole error, 1 - confidence.
        directed: Evidence with the reference drivers of all angles, if `evidence` lacks some.
    """
    level = profile.error if error is None else error
    count = enough_resamples(level, resamples)
    constant = GO_AND_WAIT if base(profile.scenario.world) == INTERSECTION else ()
    drivers = [(driver, driver.name in constant) for driver in evidence.references]
    drivers += [(driver, True) for driver in evidence.trivial]
    decided = []
    for driver, trivial in drivers:
        references = tuple(row for row in evidence.references if row is not driver)
        if references:
            swapped = replace(evidence, policy=driver, references=references, trivial=())
            as_policy = replace(driver, name=evidence.policy.name)  # it stays a reference too
            line = replace(directed or evidence, policy=as_policy, trivial=())
            beside = direction_tests(profile, line, level)
            tests = (*beside, *bound_tests(driver, profile.bounds, level, level / 2))
            decision = Decision.FAIL
            # The bounds of regret take longest; where another test fails they change nothing.
            if all(test is None or test.decision is not Decision.FAIL for test in tests):
                rewards = swapped.clipped(profile.clip)
                limit = profile.largest_loss
                regrets = Regrets(rewards, seed, count, limit, decisive=True)
                decision = decide(profile, swapped, seed, count, level, regrets, line).decision
            decided.append(OtherDriver(driver.name, trivial, decision))
    passing = [driver for driver in decided if driver.decision is Decision.PASS]
    return Discrimination(
        would_pass=len(passing),
        of=len(decided),
        trivial_passes=tuple(driver.name for driver in passing if driver.trivial),
        drivers=tuple(decided),
    )


ORDER_ERROR = 0.001
"""Largest chance that a policy without a memory is found to depend on the order. It can't pass
then, so that the error of a wrong pass has no share of it."""

_ROUNDING = 1e-9
"""Part of the largest reward below which two rewards are equal. In a deterministic world all
episodes are, and the order of their rounding errors is that of the summation."""

_ORDERS = 10_000  # random orders with which that of the episodes is compared
_AT_ONCE = 100  # of these
_USUAL = 2.5  # deviations of the sum of products below which no order is compared


def order_dependence(evidence: Evidence) -> str:
    """Return that the policy's rewards depend on the order of the episodes; "" if none is found.

    Episodes are drawn by chance after the commitment: without a memory any order is as likely. Of
    each reward, relative to the references' mean of the same episodes, there are two tests, which
    share the error (Bonferroni). Rewards that are equal but for rounding have no order. Bounds of a
    mean are wrong where a policy has a memory: they may decide before the rest counts.

    One takes the largest sum of the first episodes' deviations from the mean (CUSUM; Brown, Durbin
    and Evans 1975), for changes that last. Divided by their deviation and √n, the path is close to
    a Brownian bridge, whose maximum has Kolmogorov's distribution; of few values it is smaller. The
    other is for effects on the next episode (`_chance_of_neighbours`).
    """
    totals = [evidence.policy.totals, *(row.totals for row in evidence.references)]
    floor = _ROUNDING * max(1.0, float(np.abs(totals).max()))
    chances = []
    for values in (totals[0] - np.mean(totals[1:], axis=0)).T:
        values = values - np.median(values)
        values[np.abs(values) <= floor] = 0.0
        deviations = values - values.mean()
        path = np.cumsum(deviations) / (np.linalg.norm(deviations) or np.inf)
        chances.append(float(kolmogorov(np.abs(path).max())))
        chances.append(_chance_of_neighbours(deviations))
    if min(chances) * len(chances) >= ORDER_ERROR:
        return ""
    return (
        "The policy's rewards depend on the order of the episodes, so it has a memory of earlier "
        "ones, and its mean says nothing about later ones."
    )


def _chance_of_neighbours(deviations: Float[np.ndarray, " episode"]) -> float:
    """Return the chance that a random order has neighbours as alike, or as unlike, as the episodes.

    The measure is the sum of products of neighbours, the last and the first among them. By random
    orders the test is exact for any distribution, ties and rare values too. Where the sum is usual
    the chance is taken as 1, which makes the test only stricter.
    """
    squares = float(deviations @ deviations)
    count = len(deviations)

    def unlikeness(orders: Float[np.ndarray, "order episode"]) -> Float[np.ndarray, " order"]:
        products = (orders * np.roll(orders, 1, axis=1)).sum(axis=1)
        return np.abs(products + squares / (count - 1))  # the mean over all orders is negative

    tie = unlikeness(deviations[None])[0] - _ROUNDING * squares
    if tie <= _USUAL * squares / np.sqrt(count):
        return 1.0
    rng = np.random.default_rng(0)
    rows = np.tile(deviations, (_AT_ONCE, 1))
    as_far = 0
    for _ in range(_ORDERS // _AT_ONCE):
        as_far += int((unlikeness(rng.permuted(rows, axis=1)) >= tie).sum())
        if as_far > _ORDERS * ORDER_ERROR:  # too many already
            return 1.0
    return (1 + as_far) / (1 + _ORDERS)
