"""The primary test: regret of a policy at its declared angle, and angles where it is small.

Regret is ρ = max_k J_α(reference k) - J_α(policy), on common random numbers: every difference is
taken within an episode, so the effect of a seed on all drivers cancels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.verdict.decision import Decision, decide, episodes_needed
from socialiq.social.angle import Arc, arcs_of_grid, complement, exact_weights, score
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
        name: Name of the reference.
        regret: J_α(reference) - J_α(policy), reward per episode.
        high: One-sided upper bound.
        compared: Whether the test uses it; see `Regrets`.
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
        angle: Declared angle in degrees.
        margin: Margin, reward per episode.
        regret: Estimate of ρ.
        low: One-sided lower bound of ρ at `fail_error`.
        high: One-sided upper bound of ρ at `pass_error`.
        pass_error: Largest chance of a pass although ρ exceeds the margin.
        fail_error: Largest chance of a fail although ρ is within the margin.
        best: Name of the reference with the largest estimate.
        references: Regret towards each reference.
        episodes: Number of episodes.
        needed: Episodes that would decide, if the estimate is true, in 9 of 10 audits; None if it
            is on the margin.
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

    References with exact expectations are the complete set of optima (`drive.exact_optima`): the
    best one at an angle is then known, not selected by the data, and it alone is compared; no
    other driver can be better.

    Args:
        evidence: Policy and references.
        seed: Seed of the resampling.
        resamples: Number of resamples.
    """

    def __init__(self, evidence: Evidence, seed: int, resamples: int = 2000) -> None:
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
        return _Gains(self.moments.at(weights).of(rows), values, reach, np.array(seldom))


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
        regrets: Regrets of the evidence.
        evidence: Policy and references.
        angle: Declared angle in degrees.
        margin: Margin, reward per episode.
        pass_error: One-sided error of a pass.
        fail_error: One-sided error of a fail.
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


_STEP = 1.0  # degrees of the band's grid

_FINE = 0.1  # degrees of the search for the smallest regret


@dataclass(frozen=True)
class CompatibleAngles:
    """Angles at which the policy's regret is within the margin, none if it is large everywhere.

    Attributes:
        arcs: Angles by the estimates.
        surely: Angles at which the policy would pass, to the degree: any angle whose true regret
            exceeds the margin is in it with a chance of at most `pass_error`.
        possibly: Angles at which it would not fail: any angle whose true regret is within the
            margin is outside with a chance of at most `fail_error`.
        least_angle: Angle of the smallest regret (the first one), degrees.
        least: The regret there, reward per episode.
        margin: Margin, reward per episode.
    """

    arcs: tuple[Arc, ...]
    surely: tuple[Arc, ...]
    possibly: tuple[Arc, ...]
    least_angle: float
    least: float
    margin: float


def compatible_angles(
    regrets: Regrets, margin: float, pass_error: float = 0.05, fail_error: float = 0.05
) -> CompatibleAngles:
    """Return the angles compatible with the behaviour, and their bootstrap band.

    The answer is a set, since many angles share one optimal policy. Towards reference k the regret
    is r_k cos(α - φ_k), with (r_k, φ_k) its mean gain in polar coordinates, so each reference
    excludes the open arc φ_k ± arccos(margin / r_k).

    Args:
        regrets: Regrets of the evidence.
        margin: Margin, reward per episode, positive.
        pass_error: Error of `surely`, at each angle.
        fail_error: Error of `possibly`, at each angle.
    """
    env, social = regrets.moments.mean.T
    length = np.hypot(env, social)
    large = length > margin
    centres = np.degrees(np.arctan2(social[large], env[large]))
    halves = np.degrees(np.arccos(margin / length[large]))
    grid = np.arange(0.0, 360.0, _STEP).tolist()
    within, beyond = np.array(
        [regrets.band(angle, margin, pass_error, fail_error) for angle in grid]
    ).T
    fine = np.deg2rad(np.arange(0.0, 360.0, _FINE))
    by_angle = np.max(env[:, None] * np.cos(fine) + social[:, None] * np.sin(fine), axis=0)
    return CompatibleAngles(
        arcs=complement(centres.tolist(), halves.tolist()),
        surely=arcs_of_grid(within, _STEP),
        possibly=arcs_of_grid(~beyond, _STEP),
        least_angle=round(int(by_angle.argmin()) * _FINE, 6),
        least=float(by_angle.min()),
        margin=margin,
    )
