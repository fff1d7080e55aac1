"""Test of a policy's direction: whether it lies between the reference drivers of two angles.

A margin of regret can't mean an angle: near its best angle the regret of a driver is of second
order in the angle, less than what an honest weaker driver loses. The direction is of first order.
For the reference driver f(a) of an angle of a degrees

    D(a) = J(a + 90) of f(a) - J(a + 90) of the policy

is positive if the policy lies on the egoistic side of that driver, and negative on the social side.
A policy is within a width w of the declared d if D(d - w) < 0 < D(d + w).

Which driver is f(a) doesn't depend on the episodes, so no choice among drivers has to be corrected
for. In a gridworld it is the exact optimum of a, elsewhere the first reference that was made for
a; at the intersection the shipped dial comes first.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.template import possible_loss
from socialiq.audit.verdict.regret import Decision, slowest
from socialiq.statistics import betting, intervals
from socialiq.worlds.registry import NAMES

LAST = 90.0
"""Directions are tested from 0 degrees to this one."""

_DECIMALS = 6  # of an angle: the classes of neighbouring optima share their ends up to rounding


class Class(NamedTuple):
    """Angles of a reference driver: its own, or all those at which it is the best. Degrees."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """The angle at which the driver is compared."""
        return (self.low + self.high) / 2


def class_of(reference: Outcomes) -> Class | None:
    """Return a reference driver's angles from 0 to 90 degrees, None if it has none of them."""
    for turn in (0.0, -360.0) if reference.angles else ():
        low, high = (
            round(end + turn, _DECIMALS) for end in (reference.angles[0], reference.angles[-1])
        )
        if low <= LAST and high >= 0.0:
            return Class(max(low, 0.0), min(high, LAST))
    return None


class Driver(NamedTuple):
    """A reference driver and its angles."""

    outcomes: Outcomes
    angles: Class


def drivers_of(references: Sequence[Outcomes]) -> list[Driver]:
    """Return the reference driver of every angle that has one, by rising angle."""
    drivers: list[Driver] = []
    for reference in references:
        angles = class_of(reference)
        if angles is not None and driver_of(drivers, angles.middle) is None:
            drivers.append(Driver(reference, angles))
    return sorted(drivers, key=lambda driver: driver.angles)


def driver_of(drivers: Sequence[Driver], angle: float) -> Driver | None:
    """Return the reference driver of an angle in degrees."""
    holding = (row for row in drivers if row.angles.low <= angle <= row.angles.high)
    return next(holding, None)


@dataclass(frozen=True)
class Side:
    """The side of a reference driver on which the policy lies, if it is significant."""

    name: str  # of the reference driver
    low: float  # its angles, degrees
    high: float
    difference: float  # estimate of D(a), reward per episode
    deviation: float  # standard deviation of an episode's difference
    side: Literal["social", "egoistic", "not known"]


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


def ends_of(drivers: Sequence[Driver], angle: float, width: float) -> list[float | None]:
    """Return the two angles at which a width is tested, in degrees, None outside of 0 to 90.

    In a gridworld one policy is the best at a class of angles, and the class is what can be
    certified: an end in the class of the declared angle moves on by the width until it leaves it.
    """
    declared, ends = driver_of(drivers, angle), list[float | None]()
    for step in (-width, width):
        end = angle + step
        while declared is not None and declared is driver_of(drivers, end):
            end += step
        ends.append(end if 0.0 <= end <= LAST else None)
    return ends


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
    """
    width, drivers = profile.margin.width, drivers_of(evidence.references)
    ends = [None, None] if width is None else ends_of(drivers, profile.angle, width)
    tested = [None if end is None else driver_of(drivers, end) for end in ends]
    compared = [driver for driver in drivers if not ends_only or driver in tested]
    differences, limits = _differences(profile, evidence.policy, compared)
    lacking = _lacking(profile, ends, tested, limits)
    sides = _sides(compared, differences, limits, pass_error)
    beyond = _sides(compared, differences, limits, fail_error / 2)
    rows = [(compared.index(driver), way) for driver, way in zip(tested, _WAYS, strict=True)
            if driver is not None and not lacking]  # fmt: skip
    decision = None if width is None else Decision.INCONCLUSIVE
    if width is not None and not lacking:
        if all(sides[row].side == way for row, way in rows):
            decision = Decision.PASS
        elif any(beyond[row].side not in (way, _NOT_KNOWN) for row, way in rows):
            decision = Decision.FAIL
    undecided = decision is Decision.INCONCLUSIVE and not lacking
    needs = [
        betting.episodes_by_betting(
            values if values.mean() < 0.0 else -values, 0.0, 1.0, pass_error, intervals.POWER
        )
        for values in (differences[row] / limits[row] for row, _ in rows)
    ]
    excluded = [_run(order, way) for order, way in zip((sides, sides[::-1]), _WAYS, strict=True)]
    return DirectionTest(
        decision=decision,
        width=width,
        low=ends[0],
        high=ends[1],
        lacking=lacking,
        above=excluded[0].high if excluded[0] else None,
        below=excluded[1].low if excluded[1] else None,
        sides=tuple(sides),
        pass_error=pass_error,
        fail_error=fail_error,
        needed=slowest(needs) if undecided else None,
    )


@dataclass(frozen=True)
class Beyond:
    """Episodes in which the policy drives beyond an end; bounds are Clopper and Pearson's."""

    end: Literal["egoistic", "social"]
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


TOLERANCE = 2.0
"""Margins of regret by which an episode has to be beyond an end to count."""


def character_test(
    profile: Profile, evidence: Evidence, pass_error: float, fail_error: float
) -> CharacterTest | None:
    """Test the shares of episodes beyond the ends of the direction; None if none is declared.

    Arguments are those of `direction_test`; without drivers of both ends it is not decided.
    """
    limit, width, angle = profile.margin.beyond, profile.margin.width, profile.angle
    if limit is None or width is None:
        return None
    drivers, tolerance = drivers_of(evidence.references), TOLERANCE * profile.margin.regret
    ends = ends_of(drivers, angle, width)
    named = [driver_of(drivers, at) for at in (angle, *(end for end in ends if end is not None))]
    known = [driver.outcomes.values(angle + 90.0) for driver in named if driver is not None]
    ours, complete, rows = evidence.policy.values(angle + 90.0), len(known) == len(named), []
    for end, name, sign in zip(ends, ("egoistic", "social"), (-1.0, 1.0), strict=True):
        if end is not None and complete:
            farthest = np.max([sign * values for values in known], axis=0)
            count, episodes = int((sign * ours > farthest + tolerance).sum()), len(ours)
            low = intervals.clopper_pearson(count, episodes, 1.0 - fail_error).low
            high = intervals.clopper_pearson(count, episodes, 1.0 - 2.0 * pass_error).high
            rows.append(Beyond(name, count, count / episodes, low, high))
    decision = Decision.INCONCLUSIVE
    if complete and all(row.high <= limit for row in rows):
        decision = Decision.PASS
    elif any(row.low > limit for row in rows):
        decision = Decision.FAIL
    deviation = (limit * (1.0 - limit)) ** 0.5
    needs = [intervals.episodes_needed(row.share - limit, deviation, pass_error) for row in rows]
    needed = slowest(needs) if decision is Decision.INCONCLUSIVE and complete else None
    return CharacterTest(decision, limit, tolerance, tuple(rows), pass_error, fail_error, needed)


_NOT_KNOWN = "not known"
_WAYS: tuple[Literal["social"], Literal["egoistic"]] = ("social", "egoistic")
"""Where the policy lies of the drivers of the low and of the high end, if it is as declared."""


def _run(sides: Sequence[Side], way: str) -> Side | None:
    """Return the last of the first sides that are all of one way."""
    run = list(itertools.takewhile(lambda side: side.side == way, sides))
    return run[-1] if run else None


def _lacking(
    profile: Profile,
    ends: Sequence[float | None],
    tested: Sequence[Driver | None],
    limits: Float[np.ndarray, " driver"],
) -> str:
    """Return what is missing for a test of the declared width."""
    if profile.margin.width is None:
        return ""
    for end, driver in zip(ends, tested, strict=True):
        if end is not None and driver is None:
            return f"no reference driver of {end:g} degrees"
    return "" if np.isfinite(limits).all() else "no limits of an episode's rewards"


def _differences(
    profile: Profile, policy: Outcomes, drivers: Sequence[Driver]
) -> tuple[Float[np.ndarray, "driver episode"], Float[np.ndarray, " driver"]]:
    """Return each driver's D(a) in every episode, and the most that it can be.

    That is infinite where the limits of the rewards are not known.
    """
    known = profile.clip is not None or profile.scenario.world in NAMES
    world = profile.world() if known and profile.clip is None else None
    differences = np.zeros((len(drivers), len(policy.totals)))
    limits = np.full(len(drivers), np.inf)
    for row, (reference, angles) in enumerate(drivers):
        across = angles.middle + 90.0
        differences[row] = reference.values(across) - policy.values(across)
        limit = profile.clip.largest_loss(across) if profile.clip else None
        limit = possible_loss(world, across) if world is not None else limit
        limits[row] = limit or np.inf
    return differences, limits


def _sides(
    drivers: Sequence[Driver],
    differences: Float[np.ndarray, "driver episode"],
    limits: Float[np.ndarray, " driver"],
    error: float,
) -> list[Side]:
    """Return the side of each driver on which the policy lies, each at an error."""
    # In units of the limit; what exceeds it by more than rounding shows nothing.
    scaled = differences / limits[:, None]
    usable = np.isfinite(limits) & (np.abs(scaled).max(axis=1, initial=0.0) <= 1.0 + 1e-9)
    scaled = scaled.clip(-1.0, 1.0)
    both = np.concatenate([scaled, -scaled])
    shown = betting.significantly_below(both, np.zeros(1), 1.0, error)[:, 0].reshape(2, -1) & usable
    rows = []
    for (reference, angles), values, (social, egoistic) in zip(
        drivers, differences, shown.T, strict=True
    ):
        side = "social" if social else "egoistic" if egoistic else _NOT_KNOWN
        mean, deviation = float(values.mean()), float(values.std())
        rows.append(Side(reference.name, *angles, mean, deviation, side))
    return rows
