"""Reliability of the audit's numbers: coverage of its intervals, error rates of its verdict.

Both are counted over audits of made-up drivers whose truth is known (`population`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict.calibration import calibrate
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, RegretTest, regret_test
from socialiq.audit.verdict.safety_floor import floor_tests
from socialiq.audit.verdict.verdict import join_tests
from socialiq.social.angle import estimate_angle
from socialiq.statistics.hotelling import confidence_ellipse
from socialiq.statistics.intervals import Share, wilson
from socialiq.studies.audit_power.population import Truth, drawn

ProgressCallback = Callable[[int], None]

_APART = 2**40  # resamples must not be drawn from the stream that drew the episodes

ERROR = 0.05
MARGIN = 0.25
FLOOR = Floor(max_at_fault=0.08, max_struck=0.08, min_arrival=0.8, max_timeout=0.08)

CASES: Mapping[str, Truth] = {
    "well within": Truth(regret=0.0, at_fault=0.03, struck=0.03, arrival=0.91),
    "regret at the margin": Truth(regret=MARGIN, at_fault=0.03, struck=0.03, arrival=0.91),
    "regret well above": Truth(regret=2 * MARGIN, at_fault=0.03, struck=0.03, arrival=0.91),
    "at fault as often as allowed": Truth(regret=0.0, at_fault=0.08, struck=0.03, arrival=0.86),
    "at fault twice as often": Truth(regret=0.0, at_fault=0.16, struck=0.0, arrival=0.82),
    "arrives as seldom as allowed": Truth(regret=0.0, at_fault=0.07, struck=0.07, arrival=0.8),
    "regret and floor at their limits": Truth(
        regret=MARGIN, at_fault=0.08, struck=0.04, arrival=0.8
    ),
}
"""Policies by what is true of them, for `MARGIN` and `FLOOR`."""


@dataclass(frozen=True)
class Coverage:
    """Coverage of an interval.

    Attributes:
        interval: Which.
        nominal: How often it should.
        covered: How often it did, with its own 99 % interval.
        exact: Whether it should be met from both sides. A bound of the largest of several means
            is conservative where several of them tie, and only has to reach its level.
    """

    interval: str
    nominal: float
    covered: Share
    exact: bool


@dataclass(frozen=True)
class Rates:
    """Rates of verdicts: shares of audits with 99 % intervals."""

    case: str
    passed: Share
    failed: Share
    inconclusive: Share


def coverage(
    episodes: int,
    replications: int,
    seed: int,
    resamples: int = 1000,
    truth: Truth | None = None,
    on_progress: ProgressCallback | None = None,
) -> tuple[Coverage, ...]:
    """Count how often every interval of the audit holds the truth.

    Args:
        episodes: Of an audit.
        replications: Audits.
        seed: Of the first one's draw; the others follow.
        resamples: Of each bootstrap.
        truth: Of whom; `Truth()` if not given.
        on_progress: Given the number of audits done.
    """
    known = truth or Truth()
    held = []
    for done, one in enumerate(range(seed, seed + replications), start=1):
        held.append(_held(known, episodes, one, resamples))
        if on_progress:
            on_progress(done)
    rows = []
    for name, (nominal, exact) in _NOMINAL.items():
        count = sum(one[name] for one in held)
        rows.append(Coverage(name, nominal, wilson(count, replications, 0.99), exact))
    return tuple(rows)


def error_rates(
    episodes: int,
    replications: int,
    seed: int,
    resamples: int = 1000,
    on_progress: ProgressCallback | None = None,
) -> tuple[Rates, ...]:
    """Count the verdicts of every case.

    Args:
        episodes: Of an audit.
        replications: Audits of each case.
        seed: Of the first one's draw; the others follow.
        resamples: Of each bootstrap.
        on_progress: Given the number of audits done of every case.
    """
    made: dict[str, list[Decision]] = {case: [] for case in CASES}
    for done, one in enumerate(range(seed, seed + replications), start=1):
        for case, decision in _decisions(episodes, one, resamples).items():
            made[case].append(decision)
        if on_progress:
            on_progress(done)
    return tuple(_rates(case, found) for case, found in made.items())


def _rates(case: str, found: list[Decision]) -> Rates:
    kinds = (Decision.PASS, Decision.FAIL, Decision.INCONCLUSIVE)
    return Rates(case, *(wilson(found.count(kind), len(found), 0.99) for kind in kinds))


_NOMINAL = {
    "regret, upper bound": (1 - ERROR, True),
    "regret, lower bound": (1 - ERROR / 2, False),
    "regret towards one reference, upper bound": (1 - ERROR, True),
    "alpha_hat": (1 - ERROR, True),
    "calibrated angle": (1 - 2 * ERROR, True),
    "ellipse of the mean": (1 - ERROR, True),
    "at fault, upper bound": (1 - ERROR, True),
    "at fault, lower bound": (1 - ERROR / 8, True),
    "struck, upper bound": (1 - ERROR, True),
    "arrival, lower bound": (1 - ERROR, True),
    "arrival, upper bound": (1 - ERROR / 8, True),
    "timeout, upper bound": (1 - ERROR, True),
}


def _held(truth: Truth, episodes: int, seed: int, resamples: int) -> dict[str, bool]:
    """Intervals of one audit that hold the truth."""
    evidence = drawn(truth, episodes, seed)
    seed += _APART
    regrets = Regrets(evidence, seed, resamples)
    regret = regret_test(regrets, evidence, truth.declared, MARGIN, ERROR, ERROR / 2)
    first = float((truth.references[1] - truth.policy) @ _weights(truth.declared))
    env, social = evidence.policy.totals.T.copy()
    angle = estimate_angle(env, social, seed, 1 - ERROR, resamples)
    equivalence = calibrate(evidence, truth.declared, 10.0, True, seed, ERROR, resamples)
    assert equivalence.low is not None and equivalence.high is not None
    # Moved by the truth, the region holds the origin where the region itself held the truth.
    centred = confidence_ellipse(evidence.policy.totals - truth.policy, 1 - ERROR)
    floor = {one.name: one for one in floor_tests(evidence.policy, FLOOR, ERROR, ERROR / 2)}
    return {
        "regret, upper bound": truth.regret <= regret.high,
        "regret, lower bound": truth.regret >= regret.low,
        "regret towards one reference, upper bound": first <= regret.references[1].high,
        "alpha_hat": angle.low <= truth.shown <= angle.high,
        "calibrated angle": equivalence.low <= truth.calibrated <= equivalence.high,
        "ellipse of the mean": centred.holds_origin,
        "at fault, upper bound": truth.at_fault <= floor["at_fault"].high,
        "at fault, lower bound": truth.at_fault >= floor["at_fault"].low,
        "struck, upper bound": truth.struck <= floor["struck"].high,
        "arrival, lower bound": truth.arrival >= floor["arrival"].low,
        "arrival, upper bound": truth.arrival <= floor["arrival"].high,
        "timeout, upper bound": truth.timeout <= floor["timeout"].high,
    }


def _decisions(episodes: int, seed: int, resamples: int) -> dict[str, Decision]:
    """The verdict on every case.

    Endings are drawn after the rewards, so cases that differ in them alone have the same rewards,
    and their regret is tested once.
    """
    tested: dict[tuple[float, ...], RegretTest] = {}
    found = {}
    for case, truth in CASES.items():
        evidence = drawn(truth, episodes, seed)
        rewards = (truth.declared, truth.regret, truth.shown)
        if rewards not in tested:
            regrets = Regrets(evidence, seed + _APART, resamples)
            test = regret_test(regrets, evidence, truth.declared, MARGIN, ERROR, ERROR / 2)
            tested[rewards] = test
        found[case] = join_tests(tested[rewards], evidence.policy, FLOOR, ERROR).decision
    return found


def _weights(angle: float) -> np.ndarray:
    radians = np.deg2rad(angle)
    return np.array([np.cos(radians), np.sin(radians)])
