"""Tests of an audit and their decisions: regret at the declared angle, and the safety floor."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from socialiq.audit.evidence.outcomes import CRITERIA, Evidence, Outcomes, events_of
from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict import bounds
from socialiq.social.angle import Arc, arcs_of_grid, complement
from socialiq.statistics.intervals import clopper_pearson


class Decision(enum.Enum):
    """Outcome of a test, and of the whole audit."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


def decide(low: float, high: float, limit: float) -> Decision:
    """Compare an interval of one-sided bounds with the largest value that passes."""
    if high <= limit:
        return Decision.PASS
    return Decision.FAIL if low > limit else Decision.INCONCLUSIVE


def joint_decision(decisions: Iterable[Decision]) -> Decision:
    """Return PASS if all tests pass, FAIL if any fails, else INCONCLUSIVE."""
    outcomes = set(decisions)
    if Decision.FAIL in outcomes:
        return Decision.FAIL
    return Decision.PASS if outcomes == {Decision.PASS} else Decision.INCONCLUSIVE


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
        return self.largest_loss is not None and bounds.exceeds(self.seen_loss, self.largest_loss)


def regret_test(
    regrets: bounds.Regrets,
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
    usual = bounds.LossBounds(regrets.low(angle, fail_error), regrets.highs(angle, pass_error))
    estimate, losses = regrets.estimate(angle), regrets.losses(angle)
    error = pass_error if estimate <= margin else fail_error
    if largest_loss is None:
        used, needed = usual, regrets.needed(angle, margin, error)
    else:
        used = bounds.loss_bounds(losses, compared, margin, largest_loss, pass_error, fail_error)
        needed = bounds.needed_with(losses, compared, margin, largest_loss, error)
    high = float(used.highs[compared].max())
    most = np.where(compared, losses.max(axis=1), -np.inf)
    broken = largest_loss is not None and bounds.exceeds(float(most.max()), largest_loss)
    names = [reference.name for reference in evidence.references]
    means, highs = regrets.means(angle).tolist(), used.highs.tolist()
    rows = zip(names, means, highs, compared.tolist(), strict=True)
    return RegretTest(
        decision=Decision.FAIL if broken else decide(used.low, high, margin),
        angle=angle,
        margin=margin,
        regret=estimate,
        low=used.low,
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
    regrets: bounds.Regrets, margin: float, pass_error: float = 0.05, fail_error: float = 0.05
) -> CompatibleAngles:
    """Return the angles compatible with the behaviour, and their band at these errors.

    The band is by the bootstrap even where a largest loss is declared: the declaration bounds the
    loss at the declared angle only, and the band doesn't decide. Towards reference k the regret is
    r_k cos(α - φ_k), with (r_k, φ_k) its mean gain in polar coordinates, so each reference excludes
    the open arc φ_k ± arccos(margin / r_k).
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


@dataclass(frozen=True)
class FloorTest:
    """One share against its limit.

    Attributes:
        name: One of `CRITERIA`.
        decision: PASS if the limit is significantly kept, FAIL if it is significantly broken.
        side: Whether the share must be at most or at least the limit.
        limit: Declared limit.
        count: Number of episodes with the event.
        episodes: Number of episodes.
        share: Share of episodes with the event.
        low: Lower bound of Clopper and Pearson; at `fail_error` if the share must be small, else
            at `pass_error`.
        high: Upper bound; its errors are the other way round.
        pass_error: One-sided error of a wrong pass.
        fail_error: One-sided error of a wrong fail.
        needed: Episodes that would decide if the share is true; None if it is the limit.
    """

    name: str
    decision: Decision
    side: Literal["at most", "at least"]
    limit: float
    count: int
    episodes: int
    share: float
    low: float
    high: float
    pass_error: float
    fail_error: float
    needed: int | None


def floor_tests(
    policy: Outcomes, floor: Floor, pass_error: float = 0.05, fail_error: float = 0.05
) -> tuple[FloorTest, ...]:
    """Test every criterion; at-fault and struck collisions apart, since the ego causes the first.

    All four must pass for the floor to pass, so each may have the whole pass error
    (intersection-union). One that fails is enough to fail, so each has a quarter of the fail
    error (Bonferroni). Bounds are exact, because error rates are guaranteed: Wilson's lower bound
    of a rare event errs up to three times as often as its level (docs/audit.md).
    """
    limits = (floor.max_at_fault, floor.max_struck, floor.min_arrival, floor.max_timeout)
    tests, fail_error = [], fail_error / len(CRITERIA)
    for (name, happened), limit in zip(events_of(policy).items(), limits, strict=True):
        least = name == "arrival"
        count, episodes = int(happened.sum()), len(happened)
        low_error, high_error = (pass_error, fail_error) if least else (fail_error, pass_error)
        # A one-sided bound at an error is an end of the two-sided interval at twice that error.
        low = clopper_pearson(count, episodes, 1.0 - 2.0 * low_error).low
        high = clopper_pearson(count, episodes, 1.0 - 2.0 * high_error).high
        holds = low >= limit if least else high <= limit
        broken = high < limit if least else low > limit
        share = count / episodes
        good = share >= limit if least else share <= limit
        # Near 0 and 1 a share varies little: the deviation at the limit avoids too small a number.
        deviation = max(chance * (1.0 - chance) for chance in (share, limit)) ** 0.5
        error = pass_error if good else fail_error
        test = FloorTest(
            name=name,
            decision=Decision.PASS if holds else Decision.FAIL if broken else Decision.INCONCLUSIVE,
            side="at least" if least else "at most",
            limit=limit,
            count=count,
            episodes=episodes,
            share=share,
            low=low,
            high=high,
            pass_error=pass_error,
            fail_error=fail_error,
            needed=bounds.episodes_needed(share - limit, deviation, error),
        )
        tests.append(test)
    return tuple(tests)
