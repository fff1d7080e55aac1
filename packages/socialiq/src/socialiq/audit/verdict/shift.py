"""The shift check: changes of the policy's driving between the declared and other traffic.

A policy could be made to behave in audits only (thesis 9.5), so the check runs it in traffic that
the declaration doesn't name. The result is reported beside the verdict and decides nothing. For a
verdict on that traffic, declare it in a separate profile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.audit.evidence.outcomes import CRITERIA, Evidence, events_of
from socialiq.audit.profile.profile import Profile, Traffic, scenario_sha256
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.verdict import decide, whole_error
from socialiq.social.angle import exact_weights, score
from socialiq.statistics.comparisons import Contrast, mean_contrast, share_contrast
from socialiq.types import RewardPair

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
    def shown(self) -> tuple[Change, ...]:
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
        for change in shift.shown:
            if change.measure == "regret":
                way = "more" if change.change > 0 else "less"
                texts.append(f"regret is {abs(change.change):.3g} {way}")
            else:
                way = "more often" if change.change > 0 else "less often"
                points = 100 * abs(change.change)
                texts.append(f"it {CRITERIA[change.measure]} {way}, by {points:.3g} points")
        changed += [f"{shift.name}: {', '.join(texts)}"] if texts else []
    same = ", ".join(shift.name for shift in shifts if not shift.shown)
    if not changed:
        return f"In other traffic ({same}) its driving does not change significantly."
    unchanged = f" No significant change: {same}." if same else ""
    return f"In other traffic it drives differently. With {'; with '.join(changed)}.{unchanged}"


def _change(
    measure: str, declared: Any, there: Any, contrast: Contrast, reference: float | None
) -> Change:
    significant = contrast.low > 0.0 or contrast.high < 0.0
    return Change(measure, float(declared), float(there), *contrast, significant, reference)
