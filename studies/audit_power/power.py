"""Reliability of the audit's numbers: coverage of its intervals, error rates of its verdict.

Both are counted over audits of simulated drivers with known true values (`population`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict.bounds import Regrets
from socialiq.audit.verdict.calibration import calibrate
from socialiq.audit.verdict.decision import Decision, floor_tests
from socialiq.audit.verdict.regret import RegretTest, regret_test
from socialiq.audit.verdict.verdict import join_tests
from socialiq.social.angle import estimate_angle
from socialiq.statistics.hotelling import confidence_ellipse
from socialiq.statistics.intervals import wilson
from socialiq.types import Row
from studies.audit_power.population import Truth, draw_evidence

ProgressCallback = Callable[[int], None]

_APART = 2**40  # between the seeds of resamples and of episodes, so that their streams differ

ERROR = 0.05
MARGIN = 0.25
FLOOR = Floor(max_at_fault=0.08, max_struck=0.08, min_arrival=0.8, max_timeout=0.08)

_VERDICTS = {
    "passed": Decision.PASS,
    "failed": Decision.FAIL,
    "inconclusive": Decision.INCONCLUSIVE,
}

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
"""True values of the audited policies by case, for `MARGIN` and `FLOOR`."""

NOMINAL = {
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
"""Nominal coverage of each interval, and whether it is exact.

A bound of the largest of several means is conservative where several of them tie, and only has to
reach its level.
"""


def coverage_rows(
    episodes: int,
    replications: int,
    seed: int,
    resamples: int = 1000,
    on_progress: ProgressCallback | None = None,
) -> list[Row]:
    """Return the share of audits in which each interval contains the true value.

    Args:
        episodes: Episodes of each audit.
        replications: Number of audits.
        seed: Seed of the first audit; the others follow.
        resamples: Resamples of each bootstrap.
        on_progress: Called with the number of finished audits.
    """
    covered = []
    for done, current in enumerate(range(seed, seed + replications), start=1):
        covered.append(_covered(Truth(), episodes, current, resamples))
        if on_progress:
            on_progress(done)
    rows: list[Row] = []
    for name, (nominal, exact) in NOMINAL.items():
        share = wilson(sum(audit[name] for audit in covered), replications, 0.99)
        ends = {"covered": share.value, "low": share.low, "high": share.high}
        rows.append({"interval": name, "nominal": nominal} | ends | {"exact": int(exact)})
    return rows


def verdict_rows(
    episodes: int,
    replications: int,
    seed: int,
    resamples: int = 1000,
    on_progress: ProgressCallback | None = None,
) -> list[Row]:
    """Return the shares of verdicts on every case, with 99 % intervals.

    Args:
        episodes: Episodes of each audit.
        replications: Number of audits of each case.
        seed: Seed of the first audit; the others follow.
        resamples: Resamples of each bootstrap.
        on_progress: Called with the number of finished audits of every case.
    """
    decisions: dict[str, list[Decision]] = {case: [] for case in CASES}
    for done, current in enumerate(range(seed, seed + replications), start=1):
        for case, decision in _decisions(episodes, current, resamples).items():
            decisions[case].append(decision)
        if on_progress:
            on_progress(done)
    rows = []
    for case, given in decisions.items():
        row: Row = {"case": case}
        for name, kind in _VERDICTS.items():
            share = wilson(given.count(kind), len(given), 0.99)
            row |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
        rows.append(row)
    return rows


def _covered(truth: Truth, episodes: int, seed: int, resamples: int) -> dict[str, bool]:
    """Return whether each interval of one audit contains the true value."""
    evidence = draw_evidence(truth, episodes, seed)
    seed += _APART
    regrets = Regrets(evidence, seed, resamples)
    regret = regret_test(regrets, evidence, truth.declared, MARGIN, ERROR, ERROR / 2)
    towards_first = float((truth.references[1] - truth.policy) @ _weights(truth.declared))
    env, social = evidence.policy.totals.T.copy()
    angle = estimate_angle(env, social, seed, 1 - ERROR, resamples)
    equivalence = calibrate(evidence, truth.declared, 10.0, True, seed, ERROR, resamples)
    assert equivalence.low is not None and equivalence.high is not None
    # Of centred totals, the region contains the origin where it would contain the true mean.
    centred = confidence_ellipse(evidence.policy.totals - truth.policy, 1 - ERROR)
    tests = floor_tests(evidence.policy, FLOOR, ERROR, ERROR / 2)
    floor = {test.name: test for test in tests}
    return {
        "regret, upper bound": truth.regret <= regret.high,
        "regret, lower bound": truth.regret >= regret.low,
        "regret towards one reference, upper bound": towards_first <= regret.references[1].high,
        "alpha_hat": angle.low <= truth.alpha_hat <= angle.high,
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
    """Return the verdict on every case.

    Endings are drawn after the rewards, so cases that differ only in endings have the same rewards,
    and their regret is tested once.
    """
    tested: dict[tuple[float, ...], RegretTest] = {}
    decisions = {}
    for case, truth in CASES.items():
        evidence = draw_evidence(truth, episodes, seed)
        rewards = (truth.declared, truth.regret, truth.alpha_hat)
        if rewards not in tested:
            regrets = Regrets(evidence, seed + _APART, resamples)
            test = regret_test(regrets, evidence, truth.declared, MARGIN, ERROR, ERROR / 2)
            tested[rewards] = test
        decisions[case] = join_tests(tested[rewards], evidence.policy, FLOOR, ERROR).decision
    return decisions


def _weights(angle: float) -> np.ndarray:
    radians = np.deg2rad(angle)
    return np.array([np.cos(radians), np.sin(radians)])
