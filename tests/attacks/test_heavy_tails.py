"""A policy that is perfect but for a rare, enormous loss.

The loss comes in so few episodes that an audit often shows none or one of them; a bound that is
computed from the sample alone then says that the policy is good. Its true regret lies at the
margin or beyond, so at most 5 % of audits may pass it.
"""

import datetime

import numpy as np
import pytest

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.profile.profile import Floor, Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, regret_test
from socialiq.audit.verdict.verdict import join_tests, judge
from socialiq.evaluation.measures import Episodes
from socialiq.statistics.intervals import wilson
from socialiq.types import Ending

AUDITS, EPISODES = 100, 500
ANY = Floor(1.0, 1.0, 0.0, 1.0)
SIZE, SHARE = 100.0, 0.002  # of the loss
SCENARIO = "made up"


def drawn_losses(seed: int, share: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.where(rng.random(EPISODES) < share, SIZE, 0.0)


def evidence_of(losses: np.ndarray, seed: int, scenario: str = SCENARIO) -> Evidence:
    """Small noise keeps the ordinary bound from its rule for equal episodes."""
    rng = np.random.default_rng(10_000 + seed)
    still = np.zeros((len(losses), 2))
    own = np.stack([-losses + 0.1 * rng.normal(size=len(losses)), still[:, 1]], axis=1)
    columns = {"ending": np.full(len(losses), Ending.ARRIVAL), "length": np.ones(len(losses))}
    columns["contact"] = np.zeros(len(losses))
    drivers = [
        Outcomes(name, Episodes(columns, r_env=totals[:, 0], r_social=totals[:, 1]))
        for name, totals in (("policy", own), ("reference", still))
    ]
    return Evidence(scenario, np.arange(len(losses)), drivers[0], (drivers[1],), {})


def passes(share: float, **bound: float) -> float:
    """Return the lower end of a 99 % interval of the share of passes, at the margin."""
    count = 0
    for seed in range(AUDITS):
        evidence = evidence_of(drawn_losses(seed, share), seed)
        regrets = Regrets(evidence, seed, 200, **bound)
        regret = regret_test(regrets, 0.0, SIZE * SHARE, 0.05, 0.025)
        found = join_tests(regret, evidence.policy, ANY.bounds, 0.05)
        count += found.decision is Decision.PASS
    return wilson(count, AUDITS, 0.99).low


@pytest.mark.parametrize("times", [1.0, 1.5])
def test_a_rare_loss_does_not_pass_with_a_declared_bound(times):
    """The true regret is the margin, or 1.5 times as much; the noise adds less than 1."""
    assert passes(times * SHARE, largest_loss=SIZE + 1.0) <= 0.05


def verdict_of(losses: np.ndarray, margin: Margin, seed: int = 0):
    day = datetime.date(2026, 1, 31)
    declared = declare(0.0, "An owner", "crossing5", margin, day, competence=ANY)
    scenario = declared.world().description
    return judge(declared, evidence_of(losses, seed, scenario), seed, resamples=200)


def test_without_a_bound_the_first_words_are_the_assumption():
    found = verdict_of(np.zeros(EPISODES), Margin(0.2, 10.0))
    assert found.decision is Decision.PASS
    assert found.reason.startswith("If no loss is too rare to show in 500 episodes")


def test_a_loss_beyond_the_declared_one_fails():
    """An owner can't buy a pass with a bound that is too low, once the loss comes."""
    losses = np.zeros(EPISODES)
    losses[17] = SIZE
    found = verdict_of(losses, Margin(1.0, 10.0, largest_loss=5.0))
    assert found.decision is Decision.FAIL
    assert "lost 100 against reference, where at most 5 was declared" in found.reason


def test_a_loss_that_a_declared_bound_allows_is_not_excluded_by_not_coming():
    found = verdict_of(np.zeros(EPISODES), Margin(0.2, 10.0, largest_loss=SIZE))
    assert found.decision is Decision.INCONCLUSIVE
    # 1 - 0.05^(1 / n) = 0.2 / 100 after 1,497 episodes without a loss
    assert found.needed is not None and 1497 <= found.needed <= 1800
