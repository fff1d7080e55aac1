"""Simulated drivers of known true values: coverage of intervals, error rates of verdicts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict.bounds import Regrets
from socialiq.audit.verdict.calibration import calibrate, preimage
from socialiq.audit.verdict.decision import Decision, RegretTest, floor_tests, regret_test
from socialiq.audit.verdict.verdict import join_tests
from socialiq.social.angle import angle_of, estimate_angle, exact_weights
from socialiq.statistics.hotelling import confidence_ellipse
from socialiq.statistics.intervals import wilson
from socialiq.types import Ending, Row
from socialiq.worlds.highway.state import Contact

ANGLES = np.array([0.0, 30.0, 60.0, 90.0])
"""Target angles of the references in degrees."""
ACHIEVED = np.array([-20.0, 5.0, 60.0, 130.0])
"""Their true α̂ in degrees, which differs from the target angle."""
_LENGTH = 4.0  # of the references' true mean totals
_COMMON = 1.5  # standard deviation of an episode's effect on all drivers
_OWN = 1.0  # of its effect on each driver; exponential in r_env: losses are rare and large


@dataclass(frozen=True)
class Truth:
    """A population of drivers.

    Attributes:
        declared: Declared angle of the policy in degrees.
        regret: Its true regret at this angle, in reward per episode.
        at_fault: Its true share of at-fault collisions.
        struck: True share of collisions that others caused.
        arrival: True share of arrivals; the remaining episodes run out of time.
        alpha_hat: True α̂ of the policy in degrees.
    """

    declared: float = 45.0
    regret: float = 0.25
    at_fault: float = 0.05
    struck: float = 0.05
    arrival: float = 0.85
    alpha_hat: float = 30.0

    @property
    def references(self) -> Float[np.ndarray, "reference 2"]:
        """True mean totals of the references."""
        return _LENGTH * _directions(ACHIEVED)

    @property
    def policy(self) -> Float[np.ndarray, " 2"]:
        """True mean totals of the policy, in its direction and of its regret."""
        weights = np.array(exact_weights(self.declared))
        along = _directions(np.array([self.alpha_hat]))[0]
        best = float((self.references @ weights).max())
        return (best - self.regret) / float(weights @ along) * along

    @property
    def calibrated(self) -> float:
        """True calibrated angle, degrees."""
        return float(preimage(ANGLES, ACHIEVED[None], np.array([self.alpha_hat])).low[0])

    @property
    def timeout(self) -> float:
        """True share of timeouts."""
        return 1.0 - self.at_fault - self.struck - self.arrival


def draw_evidence(truth: Truth, episodes: int, seed: int) -> Evidence:
    """Draw the evidence of an audit.

    Args:
        truth: True values of the population.
        episodes: Number of episodes.
        seed: Seed of all draws.
    """
    rng = np.random.default_rng(seed)
    means = np.concatenate([truth.references, truth.policy[None]])
    common = rng.normal(0.0, _COMMON, (episodes, 2))
    totals = []
    for mean in means:
        losses = 1.0 - rng.exponential(1.0, episodes)
        own = np.stack([losses, rng.normal(size=episodes)], axis=1)
        totals.append(mean + common + _OWN * own)
    names = [f"made for {angle:g}" for angle in ANGLES]
    references = [
        _outcomes(name, total, np.full(episodes, Ending.ARRIVAL), angles=(angle,))
        for name, total, angle in zip(names, totals, ANGLES.tolist(), strict=False)
    ]
    bounds = np.cumsum([truth.at_fault, truth.struck, truth.arrival])
    kind = np.searchsorted(bounds, rng.random(episodes), side="right")
    ending = np.array([Ending.COLLISION, Ending.COLLISION, Ending.ARRIVAL, Ending.TIMEOUT])[kind]
    contact = np.array([Contact.EGO_STRUCK, Contact.EGO_WAS_STRUCK, Contact.NONE, Contact.NONE])
    return Evidence(
        scenario=f"made up: α̂ {angle_of(*truth.policy.tolist()):g} degrees",
        seeds=np.arange(episodes),
        policy=_outcomes("policy", totals[-1], ending, contact[kind]),
        references=tuple(references),
        strata={},
    )


def _outcomes(
    name: str,
    totals: np.ndarray,
    ending: np.ndarray,
    contact: np.ndarray | None = None,
    angles: tuple[float, ...] = (),
) -> Outcomes:
    none = np.zeros(len(totals)) if contact is None else contact
    length = np.ones(len(totals), np.int64)
    return Outcomes(name, totals, ending.astype(np.int8), none.astype(np.int8), length, angles)


def _directions(angles: Float[np.ndarray, " angle"]) -> Float[np.ndarray, "angle 2"]:
    radians = np.deg2rad(angles)
    return np.stack([np.cos(radians), np.sin(radians)], axis=1)


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
    for case, declared in decisions.items():
        row: Row = {"case": case}
        for name, kind in _VERDICTS.items():
            share = wilson(declared.count(kind), len(declared), 0.99)
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
