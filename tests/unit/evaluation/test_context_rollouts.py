import jax
import numpy as np

from socialiq.evaluation.context import losses_of
from socialiq.evaluation.episodes import episodes_of
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import exact_weights, score
from socialiq.social.angle_rule import AngleRule
from socialiq.worlds.intersection.policies import policy as rule_based
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.situation import ContextPolicy

SEEDS = np.arange(50_400_000, 50_400_012)
CONSTANT = AngleRule.of({"format": 1, "world": "intersection", "default": 50})
WHEN = {"angle": 80, "crossing": {"at_least": 1}}
BY_CONTEXT = AngleRule.of({"format": 1, "world": "intersection", "default": 5, "when": [WHEN]})


def some_dial() -> DialPolicy:
    network = DialNetwork.initialise(
        jax.random.key(3), 71, (16,), 3, pairs=True, view="flat_scaled", times=25
    )
    return DialPolicy.of(network, 0.1, 0.0, 90.0, {})


def test_at_a_constant_angle_the_losses_of_an_episode_are_its_regret():
    batch, dial = Intersection().batch(8), some_dial()
    driven, found = losses_of(batch, rule_based("gap_3s"), SEEDS, dial, CONSTANT, (20.0, 50.0))
    best = episodes_of(batch, dial.at(50.0), SEEDS)
    regret = score(exact_weights(50.0), best.totals) - score(exact_weights(50.0), driven.totals)
    np.testing.assert_allclose(found.declared.sum(axis=1), regret, atol=1e-9)
    np.testing.assert_array_equal(found.by_angle[..., 1], found.declared)
    assert np.abs(regret).max() > 0.1
    assert found.decisions.sum(axis=1).tolist() == driven.length.tolist()


def test_the_driver_that_follows_the_rule_loses_nothing():
    batch, dial = Intersection().batch(8), some_dial()
    policy = ContextPolicy.of(dial, BY_CONTEXT)
    driven, found = losses_of(batch, policy, SEEDS, dial, BY_CONTEXT, (5.0, 80.0))
    assert not found.declared.any()
    assert not found.by_angle[:, 0, 1].any() and not found.by_angle[:, 1, 0].any()
    alone = episodes_of(batch, policy, SEEDS)
    np.testing.assert_array_equal(alone.totals.env, driven.totals.env)
