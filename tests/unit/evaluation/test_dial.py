import dataclasses

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.dial import (
    DialRollouts,
    Sweep,
    calibrated,
    ceiling_regrets,
    rollout_dial,
    support_ceiling,
    sweep,
)
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.exact import Metrics, Optimum, action_table, evaluate_exactly, visit_counts
from socialiq.evaluation.measures import Episodes
from socialiq.evaluation.rollout import rollout_table, rollout_totals
from socialiq.mdp.horizon import horizon_optimum
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import angle_of, score, weights
from socialiq.social.dial import mixture, setting
from socialiq.types import RewardPair
from socialiq.worlds import registry
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.intersection.world import Intersection


@pytest.fixture(scope="module", name="part")
def clocked_part():
    return tabulate(registry.make_grid("crossing7").with_clock()).reachable_part()


@pytest.fixture(scope="module", name="best")
def optimum(part):
    return Optimum(part)


@pytest.fixture(scope="module", name="dial")
def some_dial():
    network = DialNetwork.initialise(jax.random.key(3), 7, (16,), 3)
    return DialPolicy.of(network, 1.0, 0.0, 90.0, {})


def test_a_sweep_is_the_exact_evaluation_of_each_turned_policy(part, best, dial):
    found = sweep(dial, part, "greedy", (0.0, 45.0, 90.0))
    alone = evaluate_exactly(part, action_table(dial.at(45.0), part, "greedy"))
    assert found.metrics[1] == alone
    np.testing.assert_allclose(found.points[1], alone.totals)
    regrets = found.regrets(best.attainable)
    assert regrets[1] == pytest.approx(best.regret(alone, 45.0))
    assert (regrets >= 0).all()


def test_by_default_every_degree_of_the_range_is_asked(part, dial):
    narrow = dataclasses.replace(dial, low=10.0, high=12.0)
    assert sweep(narrow, part).angles == (10.0, 11.0, 12.0)


def test_steps_against_the_dials_sense_are_found(part, dial):
    one = sweep(dial, part, "greedy", (0.0,)).metrics[0]
    totals = [(2.0, 0.0), (1.0, 1.0), (1.3, 0.6), (0.0, 2.0)]
    metrics = [one._replace(r_env=env, r_social=social) for env, social in totals]
    back = Sweep((0.0, 1.0, 2.0, 3.0), tuple(metrics)).backward_steps()
    assert back == pytest.approx((0.3, 0.4))
    forward = Sweep((0.0, 1.0), tuple(metrics[:2])).backward_steps()
    assert forward == (0.0, 0.0)


def timed_optimum(part, angle: float) -> np.ndarray:
    reward = score(weights(angle), part.mdp.rewards)
    return horizon_optimum(part.mdp, reward, 25).probabilities(3)


def test_a_tally_counts_what_was_done(part):
    rollout = rollout_table(part, timed_optimum(part, 45.0), 30, seed=0)
    data = rollout.transitions
    counts = visit_counts(data, part)
    assert counts.sum() == data.n_transitions
    assert counts[0].sum() == 30
    assert (counts * part.mdp.rewards.env).sum() == pytest.approx(data.rewards.env.sum())


def test_demonstrations_of_another_world_are_not_tallied(part, table5):
    policy = np.full((table5.mdp.n_states, 2), 0.5)
    data = rollout_table(table5, policy, 3, seed=0).transitions
    with pytest.raises(UserError, match="are not of crossing7"):
        visit_counts(data, part)


def test_totals_of_rollouts_are_those_of_the_recorded_episodes(part):
    policy = timed_optimum(part, 75.0)
    totals = rollout_totals(part, policy, 200, seed=4)
    recorded = rollout_table(part, policy, 200, seed=4).transitions.totals()
    np.testing.assert_allclose(totals, np.stack(recorded, axis=1))


def test_what_an_expert_shows_allows_the_expert_and_not_more(part, best):
    data = rollout_table(part, timed_optimum(part, 45.0), 400, seed=1).transitions
    for timed in (True, False):
        ceiling = support_ceiling(data, part, timed)
        regrets = ceiling_regrets(ceiling, best, (0.0, 45.0, 90.0))
        assert regrets[1] == pytest.approx(0.0, abs=1e-9)
        assert regrets[2] > 1.0  # no demonstrator waits
    strict, loose = (
        ceiling_regrets(
            support_ceiling(data, part, timed), best, (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
        )
        for timed in (True, False)
    )
    assert (strict >= loose - 1e-9).all()


@pytest.fixture(name="driver", scope="module")
def untrained():
    network = DialNetwork.initialise(jax.random.key(3), 70, (4,), 3)
    return DialPolicy.of(network, temperature=0.1, low=0.0, high=90.0, provenance={})


def test_every_angle_drives_the_same_episodes(driver):
    batch, seeds = Intersection().batch(4), np.arange(6)
    found = rollout_dial(driver, batch, (0.0, 90.0), seeds)
    assert found.sweep.angles == (0.0, 90.0)
    for angle, metrics, totals in zip((0.0, 90.0), found.sweep.metrics, found.totals, strict=True):
        alone = episodes_of(batch, driver.at(angle), seeds)
        np.testing.assert_array_equal(totals, np.stack(alone.totals, axis=1))
        assert metrics == alone.metrics()
        np.testing.assert_allclose(totals.mean(axis=0), metrics.totals)


def rollouts(totals) -> DialRollouts:
    """Rollouts at 0 and 90 degrees whose episodes have these totals."""
    episodes = tuple(Episodes(r_env=sums[:, 0], r_social=sums[:, 1]) for sums in totals)
    return DialRollouts(Sweep((0.0, 90.0), ()), episodes)


def test_one_half_of_the_episodes_chooses_and_the_other_measures():
    rng = np.random.default_rng(0)
    totals = tuple(rng.normal(center, 0.3, (200, 2)) for center in ((3.0, 0.0), (0.0, 2.0)))
    one, shown = rollouts(totals).mixture(45.0, seed=7)
    chosen = setting(np.array([sums[:100].mean(axis=0) for sums in totals]), 45.0)
    assert one == chosen and 0.0 < one.share < 1.0
    means = np.array([sums[100:].mean(axis=0) for sums in totals])
    assert shown.angle == pytest.approx(angle_of(*mixture(means, one)))
    assert shown.low <= 45.0 <= shown.high and shown.angle != 45.0


def test_the_interval_knows_that_both_drove_the_same_episodes():
    """With opposite rewards the mixture's angle is nearly certain."""
    rng = np.random.default_rng(0)
    luck, east, north = rng.normal(0.0, 1.0, (400, 2)), np.array([3.0, 0.0]), np.array([0.0, 3.0])
    widths = []
    for sign in (1.0, -1.0):
        totals = (luck + east, sign * luck + north)
        _, shown = rollouts(totals).mixture(45.0, seed=7)
        widths.append(shown.high - shown.low)
    assert widths[1] < 0.2 * widths[0]


def test_a_mixture_out_of_reach_and_too_few_episodes_are_said(driver):
    totals = (np.ones((4, 2)), np.ones((4, 2)))
    with pytest.raises(UserError, match="no mixture of these policies lies at 90 degrees"):
        rollouts(totals).mixture(90.0, seed=0)
    with pytest.raises(UserError, match="two episodes or more"):
        rollout_dial(driver, Intersection().batch(1), (0.0,), np.arange(1))


def test_a_calibrated_dial_is_the_upper_hull_of_its_points(dial):
    """By hand: (2, 0) to (1, 2) at atan(1/2), to (0, 2.5) at atan(2); the others are never best."""
    metrics = metrics_of([(1.5, 0.2), (2.0, 0.0), (1.0, 2.0), (0.5, 2.25), (0.0, 2.5), (-1.0, 2.4)])
    told = calibrated(dial, Sweep((0.0, 10.0, 20.0, 30.0, 40.0, 90.0), metrics))
    firsts, networks = zip(*told.settings, strict=True)
    assert networks == (10.0, 20.0, 40.0)  # the points of 20, 30 and 40 lie on one line
    turns = np.degrees(np.arctan([0.5, 2.0]))
    np.testing.assert_allclose(firsts, [0.0, *turns])
    with pytest.raises(UserError, match="calibrated already"):
        calibrated(told, Sweep((0.0,), metrics[:1]))


def test_a_calibrated_dial_is_never_worse_and_moves_one_way(part, best):
    network = DialNetwork.initialise(jax.random.key(9), 7, (16,), 3)
    uneven = jax.tree.map(lambda weight: 3 * weight, network)
    dial = DialPolicy.of(uneven, 1.0, 0.0, 90.0, {})
    found = sweep(dial, part, "greedy", (0.0, 30.0, 60.0, 90.0))
    again = sweep(calibrated(dial, found), part, "greedy", found.angles)
    assert (again.regrets(best.attainable) <= found.regrets(best.attainable) + 1e-9).all()
    assert max(again.backward_steps()) < 1e-9
    assert max(found.backward_steps()) > 0.1


def metrics_of(totals: list[tuple[float, float]]) -> tuple[Metrics, ...]:
    """Metrics with these totals, and otherwise of no meaning."""
    return tuple(
        Metrics.of(RewardPair(*one), np.full(5, 0.2), mean_speed=0.0, stopped=0.0, length=1.0)
        for one in totals
    )
