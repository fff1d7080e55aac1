"""Test of a policy's regret: bounds by the bootstrap at any angle, and by a declared largest loss.

Regret is ρ = max_k J_α(reference k) - J_α(policy), on common random numbers: every difference is
taken within an episode, so the effect of a seed on all drivers cancels.

The bootstrap takes the sample for the distribution. A loss so rare that the sample hardly shows it
is then as good as impossible, whatever its size. With a declared largest loss the bounds of
`statistics.betting` count on it in every episode.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.verdict.decision import Decision, slowest
from socialiq.social.angle import Arc, complement, exact_weights, score
from socialiq.statistics import betting, bootstrap, intervals
from socialiq.types import RewardPair

Losses = Float[np.ndarray, "reference episode"]
"""R(α) of each reference less the policy's in each episode."""

Compared = Bool[np.ndarray, " reference"]
"""Whether the test compares each reference."""


@dataclass(frozen=True, eq=False)
class Regrets:
    """Regret and its bounds at any angle, from one set of resamples.

    References with exact expectations are the complete set of optima (`drive.exact_optima`): the
    best one at an angle is then known, not selected by the data, and it alone is compared. A
    largest loss is that of an episode at the declared angle. `decisive` regrets have only the
    bounds by which `regret_test` decides: of other drivers an audit reports only the decision.
    """

    evidence: Evidence
    seed: int
    resamples: int = 2000
    largest_loss: float | None = None
    decisive: bool = False

    @cached_property
    def _gains(self) -> Float[np.ndarray, "reference episode 2"]:
        return self.evidence.gains()

    @cached_property
    def moments(self) -> bootstrap.Moments:
        """Moments of the gains, with their resamples."""
        return bootstrap.Moments.of(self._gains, self.seed, self.resamples)

    def compared(self, angle: float) -> Compared:
        """Return which references are compared at an angle."""
        weights = exact_weights(angle)
        exact = [
            -np.inf if reference.expected is None else float(score(weights, reference.expected))
            for reference in self.evidence.references
        ]
        if np.isneginf(exact).all():
            return np.ones(len(exact), bool)
        return np.arange(len(exact)) == int(np.argmax(exact))

    def means(self, angle: float) -> Float[np.ndarray, " reference"]:
        """Return the estimated regret towards each reference at an angle in degrees."""
        return np.asarray(score(exact_weights(angle), RewardPair(*self._gains.mean(axis=1).T)))

    def losses(self, angle: float) -> Losses:
        """Return R(α) of each reference less the policy's in each episode."""
        gains = np.moveaxis(self._gains, 2, 0)
        return np.asarray(score(exact_weights(angle), RewardPair(*gains)))

    def highs(
        self, angle: float, error: float, rows: Int64[np.ndarray, " row"] | None = None
    ) -> np.ndarray:
        """Return an upper bound of the regret towards each reference.

        The largest of the compared ones bounds ρ without a correction (`upper_bounds`).

        Args:
            angle: Angle in degrees.
            error: One-sided error of each bound.
            rows: References to bound, by their rows; by default all.

        Returns:
            Shape (references,), or (rows,), reward per episode.
        """
        gains = self._at(angle, np.arange(len(self._gains)) if rows is None else rows)
        highs = bootstrap.upper_bounds(gains.resampled, error)
        for row in np.flatnonzero(gains.rare):
            highs[row] = intervals.bounds(gains.values[row], gains.reach, error, error).high
        return highs

    def low(self, angle: float, error: float) -> float:
        """Return a lower bound of ρ; each reference has its share of the error (Bonferroni).

        Args:
            angle: Angle in degrees.
            error: One-sided error of the bound.

        Returns:
            Reward per episode.
        """
        gains = self._at(angle, np.flatnonzero(self.compared(angle)))
        share = error / len(gains.rare)
        pairs = ((gains.values[row], gains.reach) for row in np.flatnonzero(gains.rare))
        lows = [intervals.bounds(*pair, share, share).low for pair in pairs]
        if not gains.rare.all():
            share = error * float((~gains.rare).mean())
            lows.append(bootstrap.largest_lower_bound(gains.resampled.of(~gains.rare), share))
        return max(lows)

    def needed(self, angle: float, best: int, distance: float, error: float) -> int | None:
        """Return the number of episodes that would decide, if the estimate is true.

        Args:
            angle: Angle in degrees.
            best: Row of the best reference, whose regret is the estimate.
            distance: Margin less the estimate, reward per episode.
            error: One-sided error of the bound that would decide.

        Returns:
            Number of episodes; None if no number is enough.
        """
        gains = self._at(angle, np.array([best]))
        if gains.rare[0]:
            common = float(np.median(gains.values[0]))
            count = intervals.deviating(gains.values[0], gains.reach)
            return intervals.episodes_if_rare(distance, common, gains.reach, count, error)
        deviation = float(gains.resampled.error[0]) * self.moments.episodes**0.5
        return intervals.episodes_needed(distance, deviation, error)

    def _at(self, angle: float, rows: Int64[np.ndarray, " row"]) -> _Gains:
        values = self.losses(angle)[rows]
        drivers = (self.evidence.policy, *self.evidence.references)
        reach = float(np.ptp([driver.values(angle) for driver in drivers]))
        seldom = [intervals.seldom(gain, reach) for gain in values]
        resampled = self.moments.at(exact_weights(angle), rows)
        return _Gains(resampled, values, reach, np.array(seldom))


class _Gains(NamedTuple):
    """Gains of references over the policy at one angle: by episode, and with their bootstrap."""

    resampled: bootstrap.Studentised
    values: Losses
    reach: float  # largest possible difference: the range of the rewards of all drivers
    rare: Compared  # nearly all differences are equal (`intervals`)


_ROUNDING = 1e-9  # relative: a sum of rewards may exceed its limit by rounding errors
_FINE = 0.1  # degrees of the search for the smallest regret


@dataclass(frozen=True)
class LossBounds:
    """Lower bound of the regret, and upper bound towards each reference.

    If one of them lost more than the declared loss, they are the smallest gain and the largest
    loss, which are no bounds.
    """

    low: float
    highs: Float[np.ndarray, " reference"]


def exceeds(loss: float, largest_loss: float) -> bool:
    """Whether the loss of an episode shows that a declared largest loss is false.

    Args:
        loss: Loss of the episode.
        largest_loss: Declared largest loss, which rounding errors may exceed.
    """
    return loss > largest_loss * (1.0 + _ROUNDING)


def loss_bounds(
    losses: Losses,
    compared: Compared,
    margin: float,
    largest_loss: float,
    pass_error: float,
    fail_error: float,
) -> LossBounds:
    """Bound the largest mean loss either way.

    The largest of the upper bounds, each at the pass error, has the error of one
    (`bootstrap.upper_bounds` says why).

    Args:
        losses: R(α) of each reference less the policy's, with the episodes in the order in which
            they were drawn; in absolute value at most the declared largest loss.
        compared: Whether the test compares a reference.
        margin: Margin of regret, reward per episode.
        largest_loss: Declared largest loss of an episode.
        pass_error: One-sided error of each upper bound.
        fail_error: One-sided error of the lower bound, which is over the compared references.
    """
    within = _without_rounding(losses, largest_loss)
    below = betting.levels(margin, largest_loss)
    highs = betting.bounds_by_betting(within, below, largest_loss, pass_error)
    above = betting.levels(margin, largest_loss, between=True)
    low = betting.lower_bound_of_largest(within[compared], above, largest_loss, fail_error)
    return LossBounds(
        low=low if np.isfinite(low) else float(losses[compared].min()),
        highs=np.where(np.isfinite(highs), highs, losses.max(axis=1)),
    )


def needed_with(
    losses: Losses,
    compared: Compared,
    margin: float,
    largest_loss: float,
    error: float,
) -> int | None:
    """Return the number of episodes that would decide by `loss_bounds`, if losses are typical.

    Args:
        losses: Losses as for `loss_bounds`.
        compared: Whether the test compares a reference.
        margin: Margin of regret, reward per episode.
        largest_loss: Declared largest loss of an episode.
        error: One-sided error of the bound that would decide.

    Returns:
        Number of episodes; None if no number is enough.
    """
    rows = _without_rounding(losses, largest_loss)[compared]
    means = rows.mean(axis=1)
    if means.max() > margin:  # a fail needs the bound of the best reference alone
        rows = -rows[[means.argmax()]]
        margin = -margin
    how = (margin, largest_loss, error, intervals.POWER)
    return slowest([betting.episodes_by_betting(row, *how) for row in rows])


def _without_rounding(losses: Losses, largest_loss: float) -> Losses:
    nearly = np.abs(losses) <= largest_loss * (1.0 + _ROUNDING)
    return np.where(nearly, losses.clip(-largest_loss, largest_loss), losses)


@dataclass(frozen=True)
class AgainstReference:
    """Regret towards one reference: estimate, and upper bound at the pass error."""

    name: str  # name of the reference
    regret: float  # J_α(reference) - J_α(policy), reward per episode
    high: float  # one-sided upper bound
    compared: bool  # whether the test uses it; see `Regrets`


@dataclass(frozen=True)
class RegretTest:
    """Whether the regret ρ at the declared angle is within the margin, in reward per episode.

    It passes if `high` <= margin, and fails if `low` > margin or the declaration is `broken`. These
    bounds are by betting, which holds for any distribution within a declared largest loss, or by
    the bootstrap, if none is declared.
    """

    decision: Decision
    angle: float  # declared, degrees
    margin: float
    regret: float  # estimate of ρ
    low: float  # one-sided lower bound of ρ at `fail_error`
    high: float  # one-sided upper bound of ρ at `pass_error`
    pass_error: float  # largest chance of a pass although ρ exceeds the margin
    fail_error: float  # largest chance of a fail although ρ is within the margin
    bound: Literal["betting", "bootstrap"]  # method of `low` and `high`
    bootstrap_low: float
    bootstrap_high: float
    largest_loss: float | None  # of an episode, if one is declared
    seen_loss: float  # largest loss of an episode
    seen_against: str  # name of the reference against which the policy lost it
    best: str  # name of the reference with the largest estimate
    references: tuple[AgainstReference, ...]
    episodes: int
    needed: int | None  # episodes that decide in 9 of 10 audits, if the estimate is not the margin

    @property
    def broken(self) -> bool:
        """Whether an episode shows that the declared largest loss is false."""
        return self.largest_loss is not None and exceeds(self.seen_loss, self.largest_loss)

    def clause(self, where: str, _world: str) -> str:
        """Return how the policy breaks the margin, or what of it is not decided.

        Args:
            where: Words for the declared angle or rule.
        """
        if self.decision is not Decision.FAIL:
            return f"earns enough {where}"
        if self.broken:
            return (
                f"in an episode it lost {self.seen_loss:.3g} against {self.seen_against}, "
                f"where at most {self.largest_loss or 0.0:.3g} was declared"
            )
        assumed = "; if no loss of that driver is too rare to show"
        return (
            f"{where} it earns at least {self.low:.3g} "
            f"less reward per episode than the best reference driver ({self.margin:.3g} less "
            f"is allowed{assumed if self.bound == 'bootstrap' else ''})"
        )


def regret_test(
    regrets: Regrets,
    angle: float,
    margin: float,
    pass_error: float = 0.05,
    fail_error: float = 0.05,
) -> RegretTest:
    """Test ρ <= margin at an angle.

    With a declared largest loss the bounds by betting decide, without further assumptions. An
    episode that lost more shows that the declaration is false, and the test fails.

    Args:
        regrets: Regrets of the policy. With `decisive` ones the references that are not compared,
            the bounds that do not decide (NaN) and `needed` (None) are left out.
        angle: Declared angle in degrees.
        margin: Margin of regret, reward per episode.
        pass_error: One-sided error of a wrong pass.
        fail_error: One-sided error of a wrong fail.
    """
    compared = regrets.compared(angle)
    largest_loss = regrets.largest_loss
    means = regrets.means(angle)
    losses = regrets.losses(angle)
    decisive = regrets.decisive
    rows = np.flatnonzero(compared) if decisive else np.arange(len(compared))
    usual = LossBounds(np.nan, np.full(len(rows), np.nan))
    if largest_loss is None or not decisive:
        usual = LossBounds(regrets.low(angle, fail_error), regrets.highs(angle, pass_error, rows))
    best = int(np.where(compared, means, -np.inf).argmax())
    estimate = float(means[best])
    error = pass_error if estimate <= margin else fail_error
    used = usual
    needed = None
    if largest_loss is not None:
        errors = pass_error, fail_error
        used = loss_bounds(losses[rows], compared[rows], margin, largest_loss, *errors)
        needed = None if decisive else needed_with(losses, compared, margin, largest_loss, error)
    elif not decisive:
        needed = regrets.needed(angle, best, margin - estimate, error)
    high = float(used.highs[compared[rows]].max())
    most = np.where(compared, losses.max(axis=1), -np.inf)
    broken = largest_loss is not None and exceeds(float(most.max()), largest_loss)
    names = [reference.name for reference in regrets.evidence.references]
    columns = (means[rows].tolist(), used.highs.tolist(), compared[rows].tolist())
    references = map(AgainstReference, (names[row] for row in rows), *columns)
    return RegretTest(
        decision=Decision.of(high <= margin and not broken, used.low > margin or broken),
        angle=angle,
        margin=margin,
        regret=estimate,
        low=used.low,
        high=high,
        pass_error=pass_error,
        fail_error=fail_error,
        bound="bootstrap" if largest_loss is None else "betting",
        bootstrap_low=usual.low,
        bootstrap_high=float(usual.highs[compared[rows]].max()),
        largest_loss=largest_loss,
        seen_loss=float(most.max()),
        seen_against=names[int(most.argmax())],
        best=names[best],
        references=tuple(references),
        episodes=regrets.evidence.episodes,
        needed=needed,
    )


@dataclass(frozen=True)
class CompatibleAngles:
    """Angles at which the estimated regret is within the margin, none if it is large everywhere."""

    arcs: tuple[Arc, ...]
    least_angle: float  # angle of the smallest regret (the first one), degrees
    least: float  # the regret there, reward per episode
    margin: float


def compatible_angles(regrets: Regrets, margin: float) -> CompatibleAngles:
    """Return the angles compatible with the behaviour.

    Towards reference k the regret is r_k cos(α - φ_k), with (r_k, φ_k) its mean gain in polar
    coordinates, so each reference excludes the open arc φ_k ± arccos(margin / r_k).

    Args:
        regrets: Regrets of the policy.
        margin: Margin of regret, reward per episode.
    """
    env, social = regrets.moments.mean.T
    length = np.hypot(env, social)
    large = length > margin
    centres = np.degrees(np.arctan2(social[large], env[large]))
    halves = np.degrees(np.arccos(margin / length[large]))
    fine = np.deg2rad(np.arange(0.0, 360.0, _FINE))
    by_angle = np.max(env[:, None] * np.cos(fine) + social[:, None] * np.sin(fine), axis=0)
    return CompatibleAngles(
        arcs=complement(centres.tolist(), halves.tolist()),
        least_angle=round(int(by_angle.argmin()) * _FINE, 6),
        least=float(by_angle.min()),
        margin=margin,
    )
