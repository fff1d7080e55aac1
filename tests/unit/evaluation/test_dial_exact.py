import dataclasses

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.dial_exact import Sweep, ceiling_regrets, support_ceiling, sweep
from socialiq.evaluation.exact import Optimum, action_table, evaluate_exactly
from socialiq.evaluation.rollout import rollout_table, rollout_totals
from socialiq.evaluation.visit_counts import tally
from socialiq.mdp.horizon import horizon_optimum
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import weights
from socialiq.social.score import score
from socialiq.worlds import registry
from socialiq.worlds.enumerate import tabulate


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


def test_a_sweep_is_the_exact_evaluation_of_each_turned_policy(part, best, dial) -> None:
    found = sweep(dial, part, "greedy", (0.0, 45.0, 90.0))
    alone = evaluate_exactly(part, action_table(dial.at(45.0), part, "greedy"))
    assert found.metrics[1] == alone
    np.testing.assert_allclose(found.points[1], alone.totals)
    regrets = found.regrets(best.attainable)
    assert regrets[1] == pytest.approx(best.regret(alone, 45.0))
    assert (regrets >= 0).all()


def test_by_default_every_degree_of_the_range_is_asked(part, dial) -> None:
    narrow = dataclasses.replace(dial, low=10.0, high=12.0)
    assert sweep(narrow, part).angles == (10.0, 11.0, 12.0)


def test_steps_against_the_dials_sense_are_found(part, dial) -> None:
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


def test_a_tally_counts_what_was_done(part) -> None:
    rollout = rollout_table(part, timed_optimum(part, 45.0), 30, seed=0)
    data = rollout.transitions
    counts = tally(data, part)
    assert counts.sum() == data.n_transitions
    assert counts[0].sum() == 30
    env = tally(data, part, data.rewards.env)
    assert env.sum() == pytest.approx(data.rewards.env.sum())
    np.testing.assert_allclose(
        env[counts > 0] / counts[counts > 0],
        np.broadcast_to(part.mdp.rewards.env, counts.shape)[counts > 0],
    )


def test_demonstrations_of_another_world_are_not_tallied(part, table5) -> None:
    policy = np.full((table5.mdp.n_states, 2), 0.5)
    data = rollout_table(table5, policy, 3, seed=0).transitions
    with pytest.raises(UserError, match="are not of crossing7"):
        tally(data, part)


def test_totals_of_rollouts_are_those_of_the_recorded_episodes(part) -> None:
    policy = timed_optimum(part, 75.0)
    totals = rollout_totals(part, policy, 200, seed=4)
    recorded = rollout_table(part, policy, 200, seed=4).transitions.totals()
    np.testing.assert_allclose(totals, np.stack(recorded, axis=1))


def test_what_an_expert_shows_allows_the_expert_and_not_more(part, best) -> None:
    data = rollout_table(part, timed_optimum(part, 45.0), 400, seed=1).transitions
    for timed in (True, False):
        ceiling = support_ceiling(data, part, timed)
        regrets = ceiling_regrets(ceiling, best, (0.0, 45.0, 90.0))
        assert regrets[1] == pytest.approx(0.0, abs=1e-9)
        assert regrets[2] > 1.0  # nobody showed how to wait
    strict, loose = (
        ceiling_regrets(
            support_ceiling(data, part, timed), best, (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
        )
        for timed in (True, False)
    )
    assert (strict >= loose - 1e-9).all()
