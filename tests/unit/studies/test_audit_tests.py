"""A small version of the study; its full size is `socialiq reproduce audit-tests`."""

import numpy as np
import pytest

from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.direction import drivers_of
from socialiq.audit.verdict.results import order_dependence
from socialiq.social.angle import exact_weights
from studies.audit_tests.study import (
    MEMORIES,
    POSITIONS,
    PROFILE,
    SHAPES,
    decisions_of,
    driven,
    latent_of,
    rule_of,
)


@pytest.mark.parametrize("shape", SHAPES)
def test_drivers_within_and_beyond_every_limit_get_their_decisions(shape):
    for position, decision in (("within", Decision.PASS), ("beyond", Decision.FAIL)):
        decided = decisions_of(shape, POSITIONS[position], 1000, 7)
        assert set(decided.values()) == {decision}, (position, decided)


def test_a_driver_on_the_limit_of_the_direction_is_the_reference_of_its_end():
    """D(30) is 0 by the rewards of the study's driver: loss .5, and turned as far."""
    loss = PROFILE.margin.regret
    ahead, aside = exact_weights(75.0)
    along, across = (np.array(exact_weights(angle)) for angle in (45.0, 135.0))
    totals = (4.0 - loss) * along + (loss - 4.0) * ahead / aside * across
    evidence = driven(np.tile(totals, (9, 1)), np.zeros(9, bool), np.zeros(9))
    end = drivers_of(evidence.references)[0]
    difference = end.outcomes.values(120.0) - evidence.policy.values(120.0)
    assert end.low == 30.0 and difference == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_deviations_have_mean_0_and_change_no_clipped_reward(shape):
    latent = latent_of(shape, np.random.default_rng(5), 200_000, 1)
    assert SHAPES[shape](latent).mean() == pytest.approx(0.0, abs=0.03)
    assert np.abs(SHAPES[shape](latent)).max() <= 6.0
    assert np.std(latent) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("shape", ["normal", *MEMORIES])
def test_a_memory_alone_is_found(shape):
    rewards = latent_of(shape, np.random.default_rng(5), 500, 2)
    found = order_dependence(driven(rewards, np.zeros(500, bool), np.zeros(500)))
    assert (found != "") == (shape in MEMORIES)


def test_a_rule_has_a_case_for_each_situation():
    rule = rule_of([15.0, 75.0, 15.0, 75.0])
    assert rule.angles == (15.0, 75.0, 15.0, 75.0)
    assert rule.features == ("crossing_with_priority", "nearest_on_the_left")
