"""Simulated drivers of known true values: coverage of intervals, error rates of verdicts."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq import Ending, estimate_angle
from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict.bounds import bound_tests
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, RegretTest, regret_test
from socialiq.audit.verdict.verdict import join_tests
from socialiq.social.angle import angle_of, exact_weights
from socialiq.statistics import hotelling
from socialiq.types import Row
from socialiq.worlds.highway.options import Contact
from socialiq_lab.audit_pool import outcomes, shares
from socialiq_lab.registry import declaration
from socialiq_lab.study import StageCallback, silent, tracked

ANGLES = np.array([0.0, 30.0, 60.0, 90.0])  # target angles of the references in degrees
ACHIEVED = np.array([-20.0, 5.0, 60.0, 130.0])
"""Their true α̂ in degrees, which differs from the target angle."""
_LENGTH = 4.0  # of the references' true mean totals
_COMMON = 1.5  # standard deviation of an episode's effect on all drivers
_OWN = 1.0  # of its effect on each driver; exponential in r_env: losses are rare and large


@dataclass(frozen=True)
class Truth:
    """A population of drivers."""

    declared: float = 45.0  # declared angle of the policy in degrees
    regret: float = 0.25  # its true regret at this angle, in reward per episode
    at_fault: float = 0.05  # its true share of at-fault collisions
    struck: float = 0.05  # true share of collisions that others caused
    arrival: float = 0.85  # true share of arrivals; the remaining episodes run out of time
    alpha_hat: float = 30.0  # true α̂ of the policy in degrees

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
    def timeout(self) -> float:
        """True share of timeouts."""
        return 1.0 - self.at_fault - self.struck - self.arrival


def draw_evidence(truth: Truth, episodes: int, seed: int) -> Evidence:
    """Draw the evidence of an audit of a population.

    Args:
        truth: True values of the population.
        episodes: Number of episodes.
        seed: Seed of all draws.

    Returns:
        Evidence of the policy and of a reference for each of `ANGLES`.
    """
    rng = np.random.default_rng(seed)
    means = np.concatenate([truth.references, truth.policy[None]])
    common = rng.normal(0.0, _COMMON, (episodes, 2))
    totals = []
    for mean in means:
        losses = 1.0 - rng.exponential(1.0, episodes)
        own = np.stack([losses, rng.normal(size=episodes)], axis=1)
        totals.append(mean + common + _OWN * own)
    arrived = np.full(episodes, Ending.ARRIVAL)
    untouched = np.full(episodes, Contact.NONE)
    references = tuple(
        outcomes(f"made for {angle:g}", total, arrived, untouched, (angle,))
        for total, angle in zip(totals, ANGLES.tolist(), strict=False)
    )
    bounds = np.cumsum([truth.at_fault, truth.struck, truth.arrival])
    kind = np.searchsorted(bounds, rng.random(episodes), side="right")
    ending = np.array([Ending.COLLISION, Ending.COLLISION, Ending.ARRIVAL, Ending.TIMEOUT])[kind]
    contact = np.array([Contact.EGO_STRUCK, Contact.EGO_WAS_STRUCK, Contact.NONE, Contact.NONE])
    policy = outcomes("policy", totals[-1], ending, contact[kind])
    scenario = f"made up: α̂ {angle_of(*truth.policy.tolist()):g} degrees"
    return Evidence(scenario, np.arange(episodes), policy, references, {})


def share(name: str, count: int, number: int) -> Row:
    """Return one share with its 99 % interval.

    Args:
        name: Name of the share's column.
        count: Number of audits that are counted.
        number: Number of all audits.

    Returns:
        The share under its name, and the ends of the interval as `low` and `high`.
    """
    return dict(zip((name, "low", "high"), shares(number, share=count).values(), strict=True))


def _directions(angles: Float[np.ndarray, " angle"]) -> Float[np.ndarray, "angle 2"]:
    radians = np.deg2rad(angles)
    return np.stack([np.cos(radians), np.sin(radians)], axis=1)


_APART = 2**40  # between the seeds of resamples and of episodes, so that their streams differ
ERROR = 0.05
MARGIN = 0.25
FLOOR = Floor(max_at_fault=0.08, max_struck=0.08, min_arrival=0.8, max_timeout=0.08)

_DECLARED = declaration("audit-power")
CASES = {name: Truth(**values) for name, values in _DECLARED["case"].items()}
"""True values of the audited policies by case, for `MARGIN` and `FLOOR`."""

INTERVALS = _DECLARED["interval"]
"""Nominal coverage of each interval, and whether it is exact."""


def coverage_rows(config: Any, on_stage: StageCallback = silent) -> list[Row]:
    """Return the share of audits in which each interval contains the true value.

    Args:
        config: Configuration of the study; audit k has the seed `first_seed` + k.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each of `INTERVALS`, with the share `covered` and its 99 % interval.
    """
    truth = Truth()
    covered = list[dict[str, bool]]()
    along = _directions(np.array([truth.declared]))[0]
    for current in tracked(seeds_of(config), on_stage, "coverage", "audits"):
        evidence = draw_evidence(truth, config.episodes, current)
        draws = current + _APART
        regrets = Regrets(evidence, draws, config.resamples)
        regret = regret_test(regrets, truth.declared, MARGIN, ERROR, ERROR / 2)
        env, social = evidence.policy.totals.T.copy()
        angle = estimate_angle(env, social, draws, 1 - ERROR, config.resamples)
        # Of centred totals, the region contains the origin where it would contain the true mean.
        centred = hotelling.confidence_ellipse(evidence.policy.totals - truth.policy, 1 - ERROR)
        tests = bound_tests(evidence.policy, FLOOR.bounds, ERROR, ERROR / 2)
        floor = {test.name: test for test in tests}
        towards_first = float((truth.references[1] - truth.policy) @ along)
        contained = (  # in the order of `INTERVALS`
            truth.regret <= regret.high,
            truth.regret >= regret.low,
            towards_first <= regret.references[1].high,
            angle.low <= truth.alpha_hat <= angle.high,
            centred.holds_origin,
            truth.at_fault <= floor["at_fault"].high,
            truth.at_fault >= floor["at_fault"].low,
            truth.struck <= floor["struck"].high,
            truth.arrival >= floor["arrival"].low,
            truth.arrival <= floor["arrival"].high,
            truth.timeout <= floor["timeout"].high,
        )
        covered.append(dict(zip(INTERVALS, contained, strict=True)))
    return [
        {"interval": name, "nominal": interval["nominal"]}
        | share("covered", sum(audit[name] for audit in covered), len(covered))
        | {"exact": int(interval["exact"])}
        for name, interval in INTERVALS.items()
    ]


def seeds_of(config: Any) -> range:
    """Return the seed of each audit."""
    return range(config.first_seed, config.first_seed + config.replications)


def verdict_rows(config: Any, on_stage: StageCallback = silent) -> list[Row]:
    """Return the shares of verdicts on every case.

    Cases that differ only in endings have the same rewards: their regret is tested once.

    Args:
        config: Configuration of the study; audit k of a case has the seed `first_seed` + k.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each of `CASES`, with the shares `passed`, `failed` and `inconclusive`.
    """
    decisions: dict[str, list[Decision]] = {case: [] for case in CASES}
    for current in tracked(seeds_of(config), on_stage, "error rates", "audits"):
        tested: dict[tuple[float, ...], RegretTest] = {}
        for case, truth in CASES.items():
            evidence = draw_evidence(truth, config.episodes, current)
            rewards = (truth.declared, truth.regret, truth.alpha_hat)
            if rewards not in tested:
                regrets = Regrets(evidence, current + _APART, config.resamples)
                test = regret_test(regrets, truth.declared, MARGIN, ERROR, ERROR / 2)
                tested[rewards] = test
            joined = join_tests(tested[rewards], evidence.policy, FLOOR.bounds, ERROR)
            decisions[case].append(joined.decision)
    return [
        {"case": case}
        | shares(
            len(verdicts),
            passed=verdicts.count(Decision.PASS),
            failed=verdicts.count(Decision.FAIL),
            inconclusive=verdicts.count(Decision.INCONCLUSIVE),
        )
        for case, verdicts in decisions.items()
    ]
