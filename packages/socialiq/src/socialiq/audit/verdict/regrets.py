"""Regret of a policy at any angle and its bounds by the bootstrap.

Regret is ρ = max_k J_α(reference k) - J_α(policy), on common random numbers: every difference is
taken within an episode, so the effect of a seed on all drivers cancels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.verdict.decision import episodes_needed
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


class Regrets:
    """Regret and its bounds at any angle, from one set of resamples.

    References with exact expectations are the complete set of optima (`drive.exact_optima`): the
    best one at an angle is then known, not selected by the data, and it alone is compared; no
    other driver can be better.

    Args:
        evidence: Policy and references.
        seed: Seed of the resampling.
        resamples: Number of resamples.
        largest_loss: Declared largest loss of an episode at the declared angle, or None.
    """

    def __init__(
        self,
        evidence: Evidence,
        seed: int,
        resamples: int = 2000,
        largest_loss: float | None = None,
    ) -> None:
        self.largest_loss = largest_loss
        self._evidence = evidence
        self._gains = evidence.gains()
        self.moments = Moments.of(self._gains, seed, resamples)
        drivers = (evidence.policy, *evidence.references)
        self._totals = np.concatenate([one.totals for one in drivers])

    def compared(self, angle: float) -> Bool[np.ndarray, " reference"]:
        """Return which references are compared at an angle."""
        weights = exact_weights(angle)
        exact = [
            -np.inf if one.expected is None else float(score(weights, one.expected))
            for one in self._evidence.references
        ]
        if np.isneginf(exact).all():
            return np.ones(len(exact), bool)
        return np.arange(len(exact)) == int(np.argmax(exact))

    def means(self, angle: float) -> Float[np.ndarray, " reference"]:
        """Return the estimated regret towards each reference at an angle in degrees."""
        return np.asarray(score(exact_weights(angle), RewardPair(*self.moments.mean.T)))

    def losses(self, angle: float) -> Float[np.ndarray, "reference episode"]:
        """Return R(α) of each reference less the policy's in each episode."""
        gains = np.moveaxis(self._gains, 2, 0)
        return np.asarray(score(exact_weights(angle), RewardPair(*gains)))

    def best(self, angle: float) -> int:
        """Return the compared reference with the largest estimate."""
        return int(np.where(self.compared(angle), self.means(angle), -np.inf).argmax())

    def estimate(self, angle: float) -> float:
        """Return the estimate of ρ at an angle."""
        return float(self.means(angle)[self.best(angle)])

    def highs(self, angle: float, error: float) -> Float[np.ndarray, " reference"]:
        """Return an upper bound of the regret towards each reference.

        The largest of the compared ones bounds ρ without a correction (`upper_bounds`).
        """
        return self._at(angle, np.arange(len(self._gains))).highs(error)

    def low(self, angle: float, error: float) -> float:
        """Return a lower bound of ρ."""
        gains = self._at(angle, np.flatnonzero(self.compared(angle)))
        lows = gains.rare_lows(error)
        if not gains.rare.all():
            lows.append(
                largest_lower_bound(
                    gains.found.of(~gains.rare), error * float((~gains.rare).mean())
                )
            )
        return max(lows)

    def band(
        self, angle: float, margin: float, pass_error: float, fail_error: float
    ) -> tuple[bool, bool]:
        """Whether ρ is significantly within a margin, and whether significantly beyond it.

        The same as an upper bound <= margin and `low` > margin, but fast enough for every degree.
        """
        gains = self._at(angle, np.flatnonzero(self.compared(angle)))
        within = bool((gains.highs(pass_error) <= margin).all())
        if max(gains.rare_lows(fail_error), default=-np.inf) > margin:
            return within, True
        share = fail_error * float((~gains.rare).mean())
        return within, share > 0 and largest_exceeds(gains.found.of(~gains.rare), margin, share)

    def needed(self, angle: float, margin: float, error: float) -> int | None:
        """Return the number of episodes that would decide, if the estimate is true."""
        gains = self._at(angle, np.array([self.best(angle)]))
        distance = margin - self.estimate(angle)
        if gains.rare[0]:
            common = float(np.median(gains.values[0]))
            count = rare.deviating(gains.values[0], gains.reach)
            return rare.episodes_needed(distance, common, gains.reach, count, error)
        deviation = float(gains.found.error[0]) * self.moments.episodes**0.5
        return episodes_needed(distance, deviation, error)

    def _at(self, angle: float, rows: Rows) -> _Gains:
        weights = exact_weights(angle)
        gains = np.moveaxis(self._gains[rows], 2, 0)
        values = np.asarray(score(weights, RewardPair(*gains)))
        reach = float(np.ptp(np.asarray(score(weights, RewardPair(*self._totals.T)))))
        seldom = [rare.seldom(one, reach) for one in values]
        return _Gains(self.moments.at(weights, rows), values, reach, np.array(seldom))


class _Gains(NamedTuple):
    """Gains of references over the policy at one angle.

    Attributes:
        found: Means and their bootstrap.
        values: Gain in each episode.
        reach: Largest possible difference: the range of the rewards of all drivers.
        rare: Whether nearly all differences of a reference are equal (`statistics.rare_events`).
    """

    found: Studentised
    values: Float[np.ndarray, "reference episode"]
    reach: float
    rare: Bool[np.ndarray, " reference"]

    def highs(self, error: float) -> Float[np.ndarray, " reference"]:
        """Return the upper bound of each."""
        highs = upper_bounds(self.found, error)
        for row in np.flatnonzero(self.rare):
            highs[row] = rare.bounds(self.values[row], self.reach, error, error).high
        return highs

    def rare_lows(self, error: float) -> list[float]:
        """Return lower bounds of the rare ones, each at its share of an error (Bonferroni)."""
        share = error / len(self.rare)
        rows = np.flatnonzero(self.rare)
        return [rare.bounds(self.values[row], self.reach, share, share).low for row in rows]
