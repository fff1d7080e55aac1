"""Tests of an audit and their decisions: regret at the declared angle, and the safety floor."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from socialiq.audit.evidence.outcomes import CRITERIA, Outcomes, events_of
from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict import bounds
from socialiq.social.angle import Arc, arcs_of_grid, complement
from socialiq.statistics.intervals import clopper_pearson


class Decision(enum.Enum):
    """Outcome of a test, and of the whole audit."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


def joint_decision(decisions: Iterable[Decision]) -> Decision:
    """Return PASS if all tests pass, FAIL if any fails, else INCONCLUSIVE."""
    outcomes = set(decisions)
    if Decision.FAIL in outcomes:
        return Decision.FAIL
    return Decision.PASS if outcomes == {Decision.PASS} else Decision.INCONCLUSIVE


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
        return self.largest_loss is not None and bounds.exceeds(self.seen_loss, self.largest_loss)


def regret_test(
    regrets: bounds.Regrets,
    angle: float,
    margin: float,
    pass_error: float = 0.05,
    fail_error: float = 0.05,
) -> RegretTest:
    """Test ρ <= margin at an angle.

    With a declared largest loss the bounds by betting decide, and nothing else needs to be
    assumed. An episode that lost more shows that the declaration is false: that fails.

    Args:
        regrets: Regrets of the policy and its references.
        angle: Declared angle in degrees.
        margin: Margin, reward per episode.
        pass_error: One-sided error of a pass.
        fail_error: One-sided error of a fail.
    """
    compared, largest_loss = regrets.compared(angle), regrets.largest_loss
    usual = bounds.LossBounds(regrets.low(angle, fail_error), regrets.highs(angle, pass_error))
    means, losses = regrets.means(angle), regrets.losses(angle)
    best = int(np.where(compared, means, -np.inf).argmax())
    estimate = float(means[best])
    error = pass_error if estimate <= margin else fail_error
    if largest_loss is None:
        used, needed = usual, regrets.needed(angle, best, margin - estimate, error)
    else:
        used = bounds.loss_bounds(losses, compared, margin, largest_loss, pass_error, fail_error)
        needed = bounds.needed_with(losses, compared, margin, largest_loss, error)
    high = float(used.highs[compared].max())
    most = np.where(compared, losses.max(axis=1), -np.inf)
    broken = largest_loss is not None and bounds.exceeds(float(most.max()), largest_loss)
    names = [reference.name for reference in regrets.evidence.references]
    columns = (means.tolist(), used.highs.tolist(), compared.tolist())
    decision = Decision.FAIL if used.low > margin else Decision.INCONCLUSIVE
    decision = Decision.PASS if high <= margin else decision
    return RegretTest(
        decision=Decision.FAIL if broken else decision,
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
        best=names[best],
        references=tuple(map(AgainstReference, names, *columns)),
        episodes=regrets.evidence.episodes,
        needed=needed,
    )


_STEP = 1.0  # degrees of the band's grid
_FINE = 0.1  # degrees of the search for the smallest regret


@dataclass(frozen=True)
class CompatibleAngles:
    """Angles at which the policy's regret is within the margin, none if it is large everywhere.

    To the degree, it would surely pass at some angles, and possibly not fail at others. Any angle
    whose true regret exceeds the margin is among the first with a chance of at most the pass error;
    any whose true regret is within it is not among the second with one of at most the fail error.
    """

    arcs: tuple[Arc, ...]  # angles by the estimates
    surely: tuple[Arc, ...]
    possibly: tuple[Arc, ...]
    least_angle: float  # angle of the smallest regret (the first one), degrees
    least: float  # the regret there, reward per episode
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
    """A share of episodes against its limit, significantly kept or broken.

    Bounds are those of Clopper and Pearson. The lower one is at the fail error if the share must be
    small, else at the pass error; those of the upper one are the other way round.
    """

    name: str  # one of `CRITERIA`
    decision: Decision
    side: Literal["at most", "at least"]
    limit: float
    count: int  # number of episodes with the event
    episodes: int
    share: float
    low: float
    high: float
    pass_error: float  # one-sided error of a wrong pass
    fail_error: float  # one-sided error of a wrong fail
    needed: int | None  # episodes that would decide, if the share is true and not the limit


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
