"""Safety floor: shares of episodes against their limits, and whether a floor can be kept at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from socialiq.audit.evidence import drive
from socialiq.audit.evidence.outcomes import CRITERIA, Outcomes, events_of
from socialiq.audit.profile.profile import Floor, Profile
from socialiq.audit.request import shipped_dial
from socialiq.audit.seeds import episode_seeds
from socialiq.audit.verdict.direction import driver_of, drivers_of
from socialiq.audit.verdict.regret import Decision
from socialiq.statistics import intervals
from socialiq.worlds.registry import NAMES


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
        low = intervals.clopper_pearson(count, episodes, 1.0 - 2.0 * low_error).low
        high = intervals.clopper_pearson(count, episodes, 1.0 - 2.0 * high_error).high
        holds = low >= limit if least else high <= limit
        broken = high < limit if least else low > limit
        share = count / episodes
        good = share >= limit if least else share <= limit
        # Near 0 and 1 a share varies little: the deviation at the limit avoids too small a number.
        deviation = max(chance * (1.0 - chance) for chance in (share, limit)) ** 0.5
        error = pass_error if good else fail_error
        decision = Decision.PASS if holds else Decision.FAIL if broken else Decision.INCONCLUSIVE
        needed = intervals.episodes_needed(share - limit, deviation, error)
        counted = (limit, count, episodes, share, low, high, pass_error, fail_error, needed)
        tests.append(FloorTest(name, decision, "at least" if least else "at most", *counted))
    return tuple(tests)


CHECKED = 1_000
"""Episodes of the best driver of an angle, on fixed seeds, against which a floor is checked."""


def faults_of_floor(profile: Profile) -> dict[str, str]:
    """Return why the best driver of the declared angle fails the floor, by field of a declaration.

    Every policy of that angle would fail too. Where no such driver is known, nothing is said.
    """
    if profile.scenario.world not in NAMES or profile.rule is not None:
        return {}
    angle, world, best = profile.angle, profile.world(), None
    course = drive.Course(world, episode_seeds(0, CHECKED))
    if world.is_exact:
        optimum = driver_of(drivers_of(drive.exact_optima(course)), angle)
        best = optimum and optimum.outcomes
    elif angle <= 90.0 and (dial := shipped_dial(world, [angle])):
        best = course.drive(dial[0][0])
    if best is None:
        return {}
    return {
        f"competence.{'min' if test.side == 'at least' else 'max'}_{test.name}": (
            f"the best driver of {angle:g} degrees {CRITERIA[test.name]} in "
            f"{100 * test.share:.3g} % of {CHECKED:,} episodes, and the floor asks for "
            f"{test.side} {100 * test.limit:.3g} %: declare another limit"
        )
        for test in floor_tests(best, profile.competence)
        if test.decision is Decision.FAIL
    }
