"""The primary test: how much worse than the best reference a policy is at its declared angle.

Regret is ρ = max_k J_α(reference k) - J_α(policy), on common random numbers: every difference is
taken within an episode, so what a seed makes easy or hard for all drivers cancels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.verdict.decision import Decision, decide, episodes_needed
from socialiq.social.angle import exact_weights, score
from socialiq.statistics import rare_events as rare
from socialiq.statistics.bootstrap import (
    Moments,
    Studentised,
    largest_exceeds,
    largest_lower_bound,
    upper_bounds,
)
from socialiq.types import RewardPair

Rows = Int64[np.ndarray, " row"]


@dataclass(frozen=True)
class AgainstReference:
    """Regret towards one reference: estimate, and upper bound at the pass error.

    Attributes:
        name: Of the reference.
        regret: J_α(reference) - J_α(policy), reward per episode.
        high: One-sided upper bound.
        compared: Whether the test looks at it; see `RegretTest`.
    """

    name: str
    regret: float
    high: float
    compared: bool


@dataclass(frozen=True)
class RegretTest:
    """Whether the regret at the declared angle is within the margin.

    Attributes:
        decision: PASS if `high` <= margin, FAIL if `low` > margin.
        angle: Declared, degrees.
        margin: Reward per episode.
        regret: Estimate of ρ.
        low: One-sided lower bound of ρ at `fail_error`.
        high: One-sided upper bound of ρ at `pass_error`.
        pass_error: Chance of a pass although ρ exceeds the margin, at most.
        fail_error: Chance of a fail although ρ is within the margin, at most.
        best: The reference that looks best.
        references: Each by itself.
        episodes: Played.
        needed: Episodes that would decide, if the estimate is true, in 9 of 10 audits; None if it
            lies on the margin.
    """

    decision: Decision
    angle: float
    margin: float
    regret: float
    low: float
    high: float
    pass_error: float
    fail_error: float
    best: str
    references: tuple[AgainstReference, ...]
    episodes: int
    needed: int | None


class Regrets:
    """Regret and its bounds at any angle, from one set of resamples.

    Where references come with exact expectations they are the complete set of optima
    (`references.exact_optima`): which one is the best at an angle is then known, not chosen by
    the data, and it alone is compared; no other driver can be better.

    Args:
        evidence: Policy and references.
        seed: Of the resampling.
        resamples: How many.
    """

    def __init__(self, evidence: Evidence, seed: int, resamples: int = 2000) -> None:
        self._evidence = evidence
        self._gains = evidence.gains()
        self.moments = Moments.of(self._gains, seed, resamples)
        drivers = (evidence.policy, *evidence.references)
        self._totals = np.concatenate([one.totals for one in drivers])

    def compared(self, angle: float) -> Bool[np.ndarray, " reference"]:
        """References that are compared at an angle."""
        weights = exact_weights(angle)
        exact = [
            -np.inf if one.expected is None else float(score(weights, one.expected))
            for one in self._evidence.references
        ]
        if np.isneginf(exact).all():
            return np.ones(len(exact), bool)
        return np.arange(len(exact)) == int(np.argmax(exact))

    def means(self, angle: float) -> Float[np.ndarray, " reference"]:
        """Estimated regret towards each reference at an angle in degrees."""
        return np.asarray(score(exact_weights(angle), RewardPair(*self.moments.mean.T)))

    def best(self, angle: float) -> int:
        """The compared reference that looks best."""
        return int(np.where(self.compared(angle), self.means(angle), -np.inf).argmax())

    def estimate(self, angle: float) -> float:
        """ρ at an angle."""
        return float(self.means(angle)[self.best(angle)])

    def highs(
        self, angle: float, error: float, rows: Rows | None = None
    ) -> Float[np.ndarray, " row"]:
        """Upper bound of the regret towards each reference, or some of them, by itself."""
        rows = np.arange(len(self._gains)) if rows is None else rows
        return self._at(angle, rows).highs(error)

    def high(self, angle: float, error: float) -> float:
        """Upper bound of ρ; `bounds.upper` says why it needs no correction."""
        return float(self.highs(angle, error, np.flatnonzero(self.compared(angle))).max())

    def low(self, angle: float, error: float) -> float:
        """Lower bound of ρ."""
        seen = self._at(angle, np.flatnonzero(self.compared(angle)))
        lows = seen.rare_lows(error)
        if not seen.rare.all():
            lows.append(
                largest_lower_bound(seen.found.of(~seen.rare), error * float((~seen.rare).mean()))
            )
        return max(lows)

    def band(
        self, angle: float, margin: float, pass_error: float, fail_error: float
    ) -> tuple[bool, bool]:
        """Whether ρ is shown to be within a margin, and whether it is shown not to be.

        The same as `high` <= margin and `low` > margin, but fast enough for every degree.
        """
        seen = self._at(angle, np.flatnonzero(self.compared(angle)))
        within = bool((seen.highs(pass_error) <= margin).all())
        if max(seen.rare_lows(fail_error), default=-np.inf) > margin:
            return within, True
        share = fail_error * float((~seen.rare).mean())
        return within, share > 0 and largest_exceeds(seen.found.of(~seen.rare), margin, share)

    def needed(self, angle: float, margin: float, error: float) -> int | None:
        """Episodes that would decide between ρ and a margin, if the estimate is true."""
        seen = self._at(angle, np.array([self.best(angle)]))
        distance = margin - self.estimate(angle)
        if seen.rare[0]:
            common = float(np.median(seen.values[0]))
            count = rare.deviating(seen.values[0], seen.reach)
            return rare.episodes_needed(distance, common, seen.reach, count, error)
        deviation = float(seen.found.error[0]) * self.moments.episodes**0.5
        return episodes_needed(distance, deviation, error)

    def _at(self, angle: float, rows: Rows) -> _Seen:
        weights = exact_weights(angle)
        gains = np.moveaxis(self._gains[rows], 2, 0)
        values = np.asarray(score(weights, RewardPair(*gains)))
        reach = float(np.ptp(np.asarray(score(weights, RewardPair(*self._totals.T)))))
        seldom = [rare.seldom(one, reach) for one in values]
        return _Seen(self.moments.at(weights).of(rows), values, reach, np.array(seldom))


class _Seen(NamedTuple):
    """Gain of references over the policy at one angle.

    Attributes:
        found: Means and their bootstrap.
        values: In each episode.
        reach: How large a difference can be: the range of what all drivers earned.
        rare: Whose differences are nearly all equal, so that `rare` bounds them.
    """

    found: Studentised
    values: Float[np.ndarray, "reference episode"]
    reach: float
    rare: Bool[np.ndarray, " reference"]

    def highs(self, error: float) -> Float[np.ndarray, " reference"]:
        """Upper bound of each."""
        highs = upper_bounds(self.found, error)
        for row in np.flatnonzero(self.rare):
            highs[row] = rare.bounds(self.values[row], self.reach, error, error).high
        return highs

    def rare_lows(self, error: float) -> list[float]:
        """Lower bounds of the rare ones, each at its share of an error (Bonferroni)."""
        share = error / len(self.rare)
        rows = np.flatnonzero(self.rare)
        return [rare.bounds(self.values[row], self.reach, share, share).low for row in rows]


def regret_test(
    regrets: Regrets,
    evidence: Evidence,
    angle: float,
    margin: float,
    pass_error: float = 0.05,
    fail_error: float = 0.05,
) -> RegretTest:
    """Test ρ <= margin at an angle.

    Args:
        regrets: Of the evidence.
        evidence: Policy and references.
        angle: Declared, degrees.
        margin: Reward per episode.
        pass_error: Of a pass, one-sided.
        fail_error: Of a fail, one-sided.
    """
    highs, compared = regrets.highs(angle, pass_error), regrets.compared(angle)
    means = regrets.means(angle)
    low, high = regrets.low(angle, fail_error), float(highs[compared].max())
    estimate = regrets.estimate(angle)
    error = pass_error if estimate <= margin else fail_error
    rows = zip(evidence.references, means.tolist(), highs.tolist(), compared.tolist(), strict=True)
    return RegretTest(
        decision=decide(low, high, margin),
        angle=angle,
        margin=margin,
        regret=estimate,
        low=low,
        high=high,
        pass_error=pass_error,
        fail_error=fail_error,
        best=evidence.references[regrets.best(angle)].name,
        references=tuple(AgainstReference(one.name, *rest) for one, *rest in rows),
        episodes=evidence.episodes,
        needed=regrets.needed(angle, margin, error),
    )
