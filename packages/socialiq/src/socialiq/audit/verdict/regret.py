"""The primary test: regret of a policy at its declared angle, and angles where it is small."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.verdict.bounds import (
    LossBounds,
    Regrets,
    exceeds,
    loss_bounds,
    needed_with,
)
from socialiq.audit.verdict.decision import Decision, decide
from socialiq.social.angle import Arc, arcs_of_grid, complement


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
        decision: PASS if `high` <= margin, FAIL if `low` > margin or the declaration is `broken`.
        angle: Declared angle in degrees.
        margin: Margin, reward per episode.
        regret: Estimate of ρ.
        low: One-sided lower bound of ρ at `fail_error`.
        high: One-sided upper bound of ρ at `pass_error`.
        pass_error: Largest chance of a pass although ρ exceeds the margin.
        fail_error: Largest chance of a fail although ρ is within the margin.
        bound: Method of `low` and `high`: by betting, which holds for any distribution within a
            declared largest loss, or by the bootstrap, if none is declared.
        bootstrap_low: Lower bound by the bootstrap.
        bootstrap_high: Upper bound by the bootstrap.
        largest_loss: Declared largest loss of an episode; None if none is declared.
        seen_loss: Largest loss of an episode.
        seen_against: Name of the reference against which the policy lost it.
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
    bound: Literal["betting", "bootstrap"]
    bootstrap_low: float
    bootstrap_high: float
    largest_loss: float | None
    seen_loss: float
    seen_against: str
    best: str
    references: tuple[AgainstReference, ...]
    episodes: int
    needed: int | None

    @property
    def broken(self) -> bool:
        """Whether an episode shows that the declared largest loss is false."""
        return self.largest_loss is not None and exceeds(self.seen_loss, self.largest_loss)


def regret_test(
    regrets: Regrets,
    evidence: Evidence,
    angle: float,
    margin: float,
    pass_error: float = 0.05,
    fail_error: float = 0.05,
) -> RegretTest:
    """Test ρ <= margin at an angle.

    With a declared largest loss the bounds by betting decide, and nothing else needs to be
    assumed. An episode that lost more shows that the declaration is false: that fails.

    Args:
        regrets: Regrets of the evidence.
        evidence: Policy and references.
        angle: Declared angle in degrees.
        margin: Margin, reward per episode.
        pass_error: One-sided error of a pass.
        fail_error: One-sided error of a fail.
    """
    compared, largest_loss = regrets.compared(angle), regrets.largest_loss
    usual = LossBounds(regrets.low(angle, fail_error), regrets.highs(angle, pass_error))
    estimate, losses = regrets.estimate(angle), regrets.losses(angle)
    error = pass_error if estimate <= margin else fail_error
    if largest_loss is None:
        bounds, needed = usual, regrets.needed(angle, margin, error)
    else:
        bounds = loss_bounds(losses, compared, margin, largest_loss, pass_error, fail_error)
        needed = needed_with(losses, compared, margin, largest_loss, error)
    high = float(bounds.highs[compared].max())
    most = np.where(compared, losses.max(axis=1), -np.inf)
    broken = largest_loss is not None and exceeds(float(most.max()), largest_loss)
    names = [reference.name for reference in evidence.references]
    means, highs = regrets.means(angle).tolist(), bounds.highs.tolist()
    rows = zip(names, means, highs, compared.tolist(), strict=True)
    return RegretTest(
        decision=Decision.FAIL if broken else decide(bounds.low, high, margin),
        angle=angle,
        margin=margin,
        regret=estimate,
        low=bounds.low,
        high=high,
        pass_error=pass_error,
        fail_error=fail_error,
        bound="bootstrap" if largest_loss is None else "betting",
        bootstrap_low=usual.low,
        bootstrap_high=float(usual.highs[compared].max()),
        largest_loss=largest_loss,
        seen_loss=float(most.max()),
        seen_against=names[int(most.argmax())],
        best=names[regrets.best(angle)],
        references=tuple(AgainstReference(*row) for row in rows),
        episodes=evidence.episodes,
        needed=needed,
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

    The band is by the bootstrap even where a largest loss is declared: the declaration bounds the
    loss at the declared angle only, and the band doesn't decide.

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
