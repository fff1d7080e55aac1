"""Decisions of tests, and the safety floor: the largest or smallest share of each kind of event."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from socialiq.audit.evidence.outcomes import CRITERIA, Outcomes, events_of
from socialiq.audit.profile.profile import Floor
from socialiq.statistics.intervals import clopper_pearson

POWER = 0.9
"""Chance of a decision with the number of `episodes_needed`, if the estimate is true."""


class Decision(enum.Enum):
    """Outcome of a test, and of the whole audit."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


def decide(low: float, high: float, limit: float) -> Decision:
    """Compare an interval with the largest value allowed.

    Args:
        low: One-sided lower bound.
        high: One-sided upper bound.
        limit: Largest value that passes.
    """
    if high <= limit:
        return Decision.PASS
    return Decision.FAIL if low > limit else Decision.INCONCLUSIVE


def joint_decision(decisions: Iterable[Decision]) -> Decision:
    """Return PASS if all tests pass, FAIL if any fails, else INCONCLUSIVE."""
    outcomes = set(decisions)
    if Decision.FAIL in outcomes:
        return Decision.FAIL
    return Decision.PASS if outcomes == {Decision.PASS} else Decision.INCONCLUSIVE


def episodes_needed(distance: float, deviation: float, error: float) -> int | None:
    """Return the number of episodes with which a one-sided test decides (normal approximation).

    n = ((z_{1-error} + z_power) σ / distance)², the textbook formula for a mean.

    Args:
        distance: Difference between value and limit, in the value's unit.
        deviation: σ of one episode.
        error: One-sided error of the test.

    Returns:
        The number; None if the value is on the limit, where no number is enough.
    """
    from scipy.stats import norm

    if distance == 0.0:
        return None
    quantiles = float(norm.isf(error)) + float(norm.ppf(POWER))
    episodes = (quantiles * deviation / distance) ** 2
    return max(1, math.ceil(episodes)) if episodes < 1e12 else None


def slowest(needs: Sequence[int | None]) -> int | None:
    """Return the largest of some numbers of episodes; None if no number is enough for one."""
    counts = [count for count in needs if count is not None]
    return max(counts) if len(counts) == len(needs) else None


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

    Args:
        policy: The policy under audit.
        floor: Declared floor.
        pass_error: Error of a wrong pass of the floor.
        fail_error: Error of a wrong fail of the floor.
    """
    limits = (floor.max_at_fault, floor.max_struck, floor.min_arrival, floor.max_timeout)
    share_of_error = fail_error / len(CRITERIA)
    return tuple(
        _test(name, happened, limit, pass_error, share_of_error)
        for (name, happened), limit in zip(events_of(policy).items(), limits, strict=True)
    )


def _test(
    name: str, happened: np.ndarray, limit: float, pass_error: float, fail_error: float
) -> FloorTest:
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
    return FloorTest(
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
        needed=episodes_needed(share - limit, deviation, pass_error if good else fail_error),
    )
