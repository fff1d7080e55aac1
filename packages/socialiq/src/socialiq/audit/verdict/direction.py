"""Test of a policy's direction and of its one character; angles that it follows under a rule.

A margin of regret can't mean an angle: near its best angle the regret of a driver grows with the
square of the angle, less than what an honest weaker driver loses. The direction changes linearly.
For the reference driver f(a) of an angle of a degrees

    D(a) = J(a + 90) of f(a) - J(a + 90) of the policy

is positive if the policy lies on the egoistic side of that driver, and negative on the social side.
A policy is within a width w of the declared d if D(d - w) < 0 < D(d + w).

Which driver is f(a) doesn't depend on the episodes, so no choice among drivers has to be corrected
for. In a gridworld it is the exact optimum of a, elsewhere the first reference that was made for
a; at the intersection the shipped dial comes first.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.profile.fields import LAST_DIRECTION
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.template import possible_loss
from socialiq.audit.verdict.decision import Decision, slowest
from socialiq.errors import UserError
from socialiq.evaluation.context import ContextLosses
from socialiq.social.angle_rule import AngleRule, angle_words
from socialiq.statistics import betting, intervals
from socialiq.statistics.comparisons import paired_difference
from socialiq.worlds.catalogue import KNOWN, base

_DECIMALS = 6  # of an angle: the classes of neighbouring optima share their ends up to rounding


class Driver(NamedTuple):
    """A reference driver and its angles in degrees: its own, or all at which it is the best."""

    low: float
    high: float
    outcomes: Outcomes

    @property
    def across(self) -> float:
        """Angle of the rewards that are compared: 90 degrees from the middle of both angles."""
        return (self.low + self.high) / 2 + 90.0


def drivers_of(references: Sequence[Outcomes]) -> list[Driver]:
    """Return the reference driver of every angle from 0 to 90 degrees, by rising angle."""
    drivers: list[Driver] = []
    for reference in references:
        for turn in (0.0, -360.0) if reference.angles else ():
            ends = (reference.angles[0], reference.angles[-1])
            low, high = (round(end + turn, _DECIMALS) for end in ends)
            row = Driver(max(low, 0.0), min(high, LAST_DIRECTION), reference)
            if row.low <= row.high and driver_of(drivers, row.across - 90.0) is None:
                drivers.append(row)
    return sorted(drivers, key=lambda row: (row.low, row.high))


def driver_of(drivers: Sequence[Driver], angle: float) -> Driver | None:
    """Return the reference driver of an angle.

    Args:
        drivers: Result of `drivers_of`.
        angle: Angle in degrees.

    Returns:
        The first driver whose angles include this one; None if there is none.
    """
    return next((row for row in drivers if row.low <= angle <= row.high), None)


def ends_of(drivers: Sequence[Driver], angle: float, width: float | None) -> list[float | None]:
    """Return the two angles at which a width is tested, in degrees.

    In a gridworld one policy is the best at a class of angles, and the class is what can be
    certified: an end in the class of the declared angle moves on by the width until it leaves it.

    Args:
        drivers: Result of `drivers_of`.
        angle: Declared angle in degrees.
        width: Declared width in degrees; None if there is none.

    Returns:
        The low and the high end; None for an end outside of 0 to 90 degrees, and for both without a
        width.
    """
    declared = driver_of(drivers, angle)
    ends = list[float | None]()
    for step in () if width is None else (-width, width):
        last, nearer = (LAST_DIRECTION, min) if step > 0.0 else (0.0, max)
        end = angle + step
        while declared is not None and declared is driver_of(drivers, end):
            # The last angle may be that of another class, which a whole step would leave out.
            end = end + step if end == last else nearer(end + step, last)
        ends.append(end if 0.0 <= end <= LAST_DIRECTION else None)
    return ends or [None, None]


Way = Literal["social", "egoistic", "not known"]
_WAYS: tuple[Way, Way] = ("social", "egoistic")
"""Sides of the drivers of the low and of the high end on which a policy within them lies."""


@dataclass(frozen=True)
class Side:
    """The side of a reference driver on which the policy lies, if it is significant."""

    name: str  # of the reference driver
    low: float  # its angles, degrees
    high: float
    difference: float  # estimate of D(a), reward per episode
    side: Way


@dataclass(frozen=True)
class DirectionTest:
    """Whether the policy's direction is within the declared width.

    It passes if the policy lies on the social side of the reference driver of `low` and on the
    egoistic side of that of `high`; it fails if it lies beyond one of them. An end outside of 0 to
    90 degrees is None, and needs no test.
    """

    decision: Decision | None  # None if no width is declared
    width: float | None  # degrees
    low: float | None
    high: float | None
    lacking: str  # what is missing for a test, "" if nothing is
    above: float | None  # angles that are not excluded are above this one; None: 0 is not excluded
    below: float | None  # and below this one; None: 90 is not excluded
    sides: tuple[Side, ...]  # of the reference drivers, by rising angle
    pass_error: float  # largest chance of a pass although the direction is beyond an end
    fail_error: float  # largest chance of a fail although it is within both
    needed: int | None  # episodes that would decide

    @property
    def where(self) -> str:
        """The angles that are not excluded, in words."""
        ends = [] if self.above is None else [f"{self.above:.3g}"]
        ends += [] if self.below is None else [f"{self.below:.3g}"]
        if not ends:
            return "no angle is excluded"
        side = "below " if self.above is None else "above " if self.below is None else ""
        return f"angles not excluded: {side}{' to '.join(ends)}"

    def clause(self, _where: str, _world: str) -> str:
        """Return how the policy's direction breaks the width, or what of it is not decided."""
        if self.decision is Decision.FAIL:
            return f"its direction is beyond the declared width: {self.where}"
        return f"drives within {self.width:g} degrees of the declared angle"


def direction_test(
    profile: Profile,
    evidence: Evidence,
    pass_error: float,
    fail_error: float,
    ends_only: bool = False,
) -> DirectionTest:
    """Test the direction of the evidence's policy.

    A pass needs both ends, so that each may have the whole pass error (intersection-union); one
    end is enough for a fail, so that each has half of the fail error. The angles that are not
    excluded are found from both ends of 0 to 90 degrees: each side stops at the first reference
    driver that is not significant, so its first wrong step has the pass error (fixed sequence).

    Args:
        profile: The declaration.
        evidence: Evidence with all references, the policy itself too; clipped as declared.
        pass_error: Largest chance of a wrong pass.
        fail_error: Largest chance of a wrong fail.
        ends_only: Whether only the two drivers of the test are compared.

    Raises:
        UserError: If a width is declared and neither a clip nor the world limits the rewards.
    """
    width = profile.margin.width
    drivers = drivers_of(evidence.references)
    ends = ends_of(drivers, profile.angle, width)
    tested = [None if end is None else driver_of(drivers, end) for end in ends]
    bounded = _is_bounded(profile)
    if width is not None and not bounded:
        raise UserError("margin.width needs limits of the rewards: add [clip]")
    compared = [row for row in drivers if bounded and (not ends_only or row in tested)]
    values, limits = _differences(profile, evidence.policy, compared)
    missing = [end for end, row in zip(ends, tested, strict=True) if end is not None and not row]
    lacking = f"no reference driver of {missing[0]:g} degrees" if missing else ""
    if width is not None and ends == [None, None]:
        lacking = f"no end of the width from 0 to {LAST_DIRECTION:g} degrees"
    ways, beyond = _ways(values, np.array([pass_error, fail_error / 2]))
    rows = [(compared.index(row), way) for row, way in zip(tested, _WAYS, strict=True) if row]
    decision = None
    if width is not None:
        within = not lacking and all(ways[row] == way for row, way in rows)
        broken = any(beyond[row] not in (way, "not known") for row, way in rows)
        decision = Decision.of(within, broken)
    away = (-np.sign(values[row].mean()) * values[row] for row, _ in rows)
    how = (0.0, 1.0, pass_error, intervals.POWER)
    needs = [betting.episodes_by_betting(row, *how) for row in away]
    line = list(zip(compared, ways, strict=True))
    first, last = (
        [row for row, _ in itertools.takewhile(lambda row, way=way: row[1] == way, order)]
        for order, way in zip((line, line[::-1]), _WAYS, strict=True)
    )
    means = values.mean(axis=1) * limits
    return DirectionTest(
        decision=decision,
        width=width,
        low=ends[0],
        high=ends[1],
        lacking=lacking,
        above=first[-1].high if first else None,
        below=last[-1].low if last else None,
        sides=tuple(
            Side(row.outcomes.name, row.low, row.high, float(mean), way)
            for (row, way), mean in zip(line, means, strict=True)
        ),
        pass_error=pass_error,
        fail_error=fail_error,
        needed=slowest(needs) if decision is Decision.INCONCLUSIVE and not lacking else None,
    )


def _is_bounded(profile: Profile) -> bool:
    """Whether a clip, or the world's rewards, limit the difference of two drivers."""
    named = base(profile.scenario.world) in KNOWN
    return profile.clip is not None or (named and bool(possible_loss(profile.world(), 45.0)))


def _differences(
    profile: Profile, policy: Outcomes, drivers: Sequence[Driver]
) -> tuple[Float[np.ndarray, "driver episode"], Float[np.ndarray, " driver"]]:
    """Return each driver's D(a) in every episode in units of the most that it can be, and that."""
    clip = profile.clip
    values = np.zeros((len(drivers), len(policy.totals)))
    if not drivers:  # making an environment may run code
        return values, np.ones(0)
    largest = clip.largest_loss if clip else functools.partial(possible_loss, profile.world())
    limits = np.ones(len(drivers))
    for row, driver in enumerate(drivers):
        limits[row] = largest(driver.across) or np.inf
        values[row] = driver.outcomes.values(driver.across) - policy.values(driver.across)
    # Of an absolute value of at most 1, but for rounding.
    return (values / limits[:, None]).clip(-1.0, 1.0), limits


def _ways(
    values: Float[np.ndarray, "driver episode"], errors: Float[np.ndarray, " error"]
) -> list[list[Way]]:
    """Return at each error on which side of each driver the policy lies significantly."""
    signed = np.concatenate([values, -values])
    levels = np.zeros(len(errors))
    below = betting.significantly_below(signed, levels, 1.0, errors).T
    return [
        [_WAYS[0] if low else _WAYS[1] if high else "not known" for low, high in sides.T]
        for sides in below.reshape(len(errors), 2, -1)
    ]


@dataclass(frozen=True)
class Beyond:
    """Episodes in which the policy drives beyond an end; bounds are Clopper and Pearson's."""

    end: Way
    count: int
    share: float
    low: float  # one-sided lower bound at the fail error
    high: float  # one-sided upper bound at the pass error


@dataclass(frozen=True)
class CharacterTest:
    """Whether the policy has one character, and doesn't draw it by the episode.

    The mean of two characters is that of a third, so the test of the direction can't tell them. In
    single episodes they are beyond its ends: R(d + 90) is smaller than that of the drivers of both
    ends and of d, or larger, by more than twice the margin of regret. A pass needs both shares to
    be within the declared one, a fail one beyond it.
    """

    decision: Decision
    limit: float  # declared largest share of episodes beyond either end
    tolerance: float  # reward per episode
    beyond: tuple[Beyond, ...]  # of the ends that are tested
    pass_error: float
    fail_error: float  # of the test; each share has its part
    needed: int | None

    def clause(self, _where: str, _world: str) -> str:
        """Return beyond which end the policy drives, or what of its character is not decided."""
        if self.decision is not Decision.FAIL:
            return "has one character in all episodes"
        side = max(self.beyond, key=lambda row: row.low)
        return (
            f"it has not one character: in at least {100 * side.low:.3g} % of episodes it drives "
            f"beyond the {side.end} end of the width (at most {100 * self.limit:.3g} % allowed)"
        )


TOLERANCE = 2.0  # margins of regret by which an episode has to be beyond an end to count


def character_test(
    profile: Profile, evidence: Evidence, pass_error: float, fail_error: float
) -> CharacterTest | None:
    """Test the shares of episodes beyond the ends of the direction.

    Without an end, or drivers of it and of the declared angle, the test is inconclusive.

    Args:
        profile: The declaration.
        evidence: Evidence with all references, the policy itself too; clipped as declared.
        pass_error: Largest chance of a wrong pass.
        fail_error: Largest chance of a wrong fail.

    Returns:
        The test; None if no share is declared.
    """
    limit = profile.margin.beyond
    angle = profile.angle
    if limit is None:
        return None
    drivers = drivers_of(evidence.references)
    tolerance = TOLERANCE * profile.margin.regret
    ends = ends_of(drivers, angle, profile.margin.width)
    compared = [driver_of(drivers, at) for at in (angle, *(end for end in ends if end is not None))]
    rewards = [row.outcomes.values(angle + 90.0) for row in compared if row]
    ours = evidence.policy.values(angle + 90.0)
    # Of the declared angle and of an end at least.
    complete = len(rewards) == len(compared) > 1
    rows = []
    for end, name, sign in zip(ends, _WAYS[::-1], (-1.0, 1.0), strict=True):
        if end is not None and complete:
            farthest = np.max([sign * values for values in rewards], axis=0)
            count = int((sign * ours > farthest + tolerance).sum())
            episodes = len(ours)
            low = intervals.clopper_pearson(count, episodes, 1.0 - fail_error).low
            high = intervals.clopper_pearson(count, episodes, 1.0 - 2.0 * pass_error).high
            rows.append(Beyond(name, count, count / episodes, low, high))
    within = complete and all(row.high <= limit for row in rows)
    decision = Decision.of(within, any(row.low > limit for row in rows))
    deviation = (limit * (1.0 - limit)) ** 0.5
    needs = [intervals.episodes_needed(row.share - limit, deviation, pass_error) for row in rows]
    needed = slowest(needs) if decision is Decision.INCONCLUSIVE and complete else None
    return CharacterTest(decision, limit, tolerance, tuple(rows), pass_error, fail_error, needed)


@dataclass(frozen=True)
class CandidateLoss:
    """Mean decision loss of a context at an angle in degrees, reward per episode.

    `compatible` says whether it is not significantly larger than the least one.
    """

    angle: float
    loss: float
    compatible: bool


@dataclass(frozen=True)
class FollowedAngle:
    """A policy in one context of a declared rule."""

    context: str  # the context in words
    declared: str  # its declared angle in words
    decisions: float  # mean number of decisions in an episode
    loss: float  # mean decision loss at the declared angle, reward per episode
    low: float  # lower end of its two-sided interval (Student)
    high: float  # upper end
    by_angle: tuple[CandidateLoss, ...]  # the policy follows the least one


def followed_angles(
    rule: AngleRule, losses: ContextLosses, candidates: tuple[float, ...], confidence: float
) -> tuple[FollowedAngle, ...]:
    """Return the angle that a policy follows in each context, by its losses at the candidates.

    Args:
        rule: The declared rule.
        losses: Decision losses of the policy by episode and context.
        candidates: Candidate angles in degrees, in the order of `losses.by_angle`.
        confidence: Confidence of each interval, and of each comparison of two angles.

    Returns:
        A row for each context, in the rule's order.
    """
    followed = []
    for number, context in enumerate(rule.contexts):
        by_angle = losses.by_angle[:, number]
        declared = losses.declared[:, number]
        least = by_angle[:, int(by_angle.mean(axis=0).argmin())]
        interval = paired_difference(declared, np.zeros_like(declared), confidence)
        rows = list[CandidateLoss]()
        for angle, loss in zip(candidates, by_angle.T, strict=True):
            compatible = bool(paired_difference(loss, least, confidence).low <= 0.0)
            rows.append(CandidateLoss(angle, float(loss.mean()), compatible))
        words = angle_words(rule.angles[number])
        count = float(losses.decisions[:, number].mean())
        declared_loss = (interval.mean, interval.low, interval.high)
        followed.append(FollowedAngle(context, words, count, *declared_loss, tuple(rows)))
    return tuple(followed)


USUAL_WIDTH = 15.0  # degrees, of a rule whose angles no width holds


def faults_of_contexts(
    profile: Profile, losses: ContextLosses | None, candidates: tuple[float, ...], error: float
) -> list[str]:
    """Return in which contexts of a declared rule the policy decides by another angle.

    The mean of a policy of 15 degrees to some road users and of 75 to others is that of 45. The
    decisions of a context show its angle: the loss grows with the square of the distance from it,
    so the loss at two widths from the declared angle is smaller than at the declared one if the
    policy is beyond the end of the width. All comparisons share the error (Bonferroni); the bounds
    are Student's. An angle that is interpolated is not tested.

    Args:
        profile: The declaration.
        losses: Decision losses of the policy by episode and context; None without a rule.
        candidates: Candidate angles in degrees, in the order of `losses.by_angle`.
        error: Largest chance that any context is named though the policy is within the width.

    Returns:
        A sentence for each context and side.
    """
    rule = profile.rule
    if rule is None or losses is None:
        return []
    step = 2.0 * (profile.margin.width or USUAL_WIDTH)
    confidence = 1.0 - error / len(rule.contexts)  # two comparisons in each, one-sided
    faults = list[str]()
    for number, (context, declared) in enumerate(zip(rule.contexts, rule.angles, strict=True)):
        for place, angle in enumerate(candidates):
            if isinstance(declared, float) and abs(angle - declared) == step:
                pair = losses.declared[:, number], losses.by_angle[:, number, place]
                less = paired_difference(*pair, confidence)
                if less.low > 0.0:
                    faults.append(
                        f"Where {context}, the policy decides as one of {angle:g} degrees and not "
                        f"of {declared:g}: by that angle it loses at least {less.low:.3g} less an "
                        "episode."
                    )
    return faults
