from types import SimpleNamespace

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.exact import (
    Metrics,
    Optimum,
    action_table,
    evaluate_exactly,
    exact_monitor,
)
from socialiq.mdp.horizon import horizon_optimum
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.worlds.tabular_policy import expert_policy

WAIT, GO = 0, 1
STOP, FAST = 0, 2


def by_hand(env, social, length, speed, stopped, arrival=0.0, collision=0.0, timeout=0.0):
    angle = np.degrees(np.arctan2(social, env))
    expected = Metrics(env, social, angle, collision, arrival, timeout, speed, stopped, length)
    return pytest.approx(expected, abs=1e-9)


@pytest.fixture(scope="module")
def optima(table5, table7):
    return {"crossing5": (table5, Optimum(table5)), "crossing7": (table7, Optimum(table7))}


@pytest.mark.parametrize(
    ("angle", "env", "social", "length"),
    # GGGG blocks the other for one of its steps; WGGGG and WWWWGGGG don't
    [(0.0, 6.0, -4.0, 4), (45.0, 5.0, 6.0, 5), (90.0, 2.0, 6.0, 8)],
)
def test_experts_of_crossing5(angle, env, social, length, table5):
    found = evaluate_exactly(table5, expert_policy(table5, angle))
    waits = length - 4
    expected = by_hand(env, social, length, 4 / length, waits / length, arrival=1.0)
    assert tuple(found) == expected


def test_waiting_for_ever_times_out(table5, always):
    found = evaluate_exactly(table5, always(table5, WAIT))
    assert tuple(found) == by_hand(-20.0, 6.0, 20.0, 0.0, 1.0, timeout=1.0)


def test_a_coin_at_the_start_averages_two_episodes(table5, always):
    policy = always(table5, GO)
    policy[table5.world.index((0, 2, 2, 0))] = [0.5, 0.5]
    found = evaluate_exactly(table5, policy)
    # GGGG is worth (6, -4) and WGGGG (5, 6)
    assert tuple(found) == by_hand(5.5, 1.0, 4.5, 4 / 4.5, 0.5 / 4.5, arrival=1.0)


def test_policies_may_know_the_time(table5, always):
    policy = np.repeat(always(table5, GO)[None], 20, axis=0)
    policy[:4] = always(table5, WAIT)
    found = evaluate_exactly(table5, policy)
    assert tuple(found) == by_hand(2.0, 6.0, 8.0, 0.5, 0.5, arrival=1.0)


def test_driving_fast_in_crossing7(table7, always):
    found = evaluate_exactly(table7, always(table7, FAST))
    assert tuple(found) == by_hand(2.2, -2.0, 3.0, 2.0, 0.0, arrival=1.0)


def test_driving_fast_into_a_vehicle_that_cannot_stop(tabulated, always):
    table = tabulated("crossing7", braking="one_level")
    found = evaluate_exactly(table, always(table, FAST))
    assert tuple(found) == by_hand(0.1 - 5.0, -1.0 - 5.0, 2.0, 2.0, 0.0, collision=1.0)


def test_the_reachable_part_is_evaluated_alike(table7, random_policy):
    policy = random_policy(table7, 0)
    part = table7.reachable_part()
    small = evaluate_exactly(part, policy[table7.mdp.reachable()])
    assert tuple(small) == pytest.approx(tuple(evaluate_exactly(table7, policy)), abs=1e-12)


@pytest.mark.parametrize("name", ["crossing5", "crossing7"])
@pytest.mark.parametrize("angle", [0.0, 30.0, 62.0, 75.0, 90.0, 180.0, 300.0])
def test_the_optimal_policy_with_a_clock_has_no_regret(angle, name, optima):
    table, optimum = optima[name]
    part = table.reachable_part()
    reward = score(weights(angle), part.mdp.rewards)
    best = horizon_optimum(part.mdp, reward, part.world.horizon)
    found = evaluate_exactly(part, best.probabilities(part.mdp.n_actions))
    assert optimum.regret(found, angle) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", ["crossing5", "crossing7"])
@pytest.mark.parametrize("seed", range(5))
def test_nobody_has_negative_regret(seed, name, optima, random_policy):
    table, optimum = optima[name]
    found = evaluate_exactly(table, random_policy(table, seed))
    regrets = [optimum.regret(found, angle) for angle in np.arange(0.0, 360.0, 5.0)]
    assert min(regrets) > 0.0


@pytest.mark.parametrize(
    ("expert", "angle", "regret"),
    [
        (0.0, 45.0, (1.81 + 0.32 - 2.2 + 2.0) / np.sqrt(2)),
        (45.0, 0.0, 2.2 - 1.81),
        (90.0, 0.0, 2.2 + 7.1),
        (90.0, 45.0, 3.871),
    ],
)
def test_regret_of_the_wrong_expert(expert, angle, regret, optima):
    table, optimum = optima["crossing7"]
    found = evaluate_exactly(table, expert_policy(table, expert))
    assert optimum.regret(found, angle) == pytest.approx(regret, abs=1e-3)


def test_stationary_experts_regret_the_missing_clock(optima):
    table, optimum = optima["crossing7"]
    found = evaluate_exactly(table, expert_policy(table, 75.0, "stochastic"))
    assert optimum.regret(found, 75.0) == pytest.approx(0.442, abs=1e-3)


def linear(temperature):
    """Q(s) = (0, 1) everywhere: it prefers to go."""
    return QPolicy((np.zeros((2, 4), np.float32),), (np.float32([0.0, 1.0]),), "relu", temperature)


def test_greedy_readout_takes_the_best_action(table5, always):
    table = action_table(linear(1.0), table5, "greedy")
    np.testing.assert_array_equal(table, always(table5, GO))


def test_soft_readout_is_the_softmax(table5):
    table = action_table(linear(0.5), table5, "soft")
    np.testing.assert_allclose(table[:, GO], 1.0 / (1.0 + np.exp(-2.0)), rtol=1e-12)
    np.testing.assert_allclose(table.sum(axis=1), 1.0, atol=1e-12)


def test_unknown_readouts_are_refused(table5):
    with pytest.raises(UserError, match=r"^unknown readout 'best': choose one of"):
        # the annotation is checked first under the runtime type checker
        getattr(action_table, "__wrapped__", action_table)(linear(1.0), table5, "best")


def test_the_monitor_evaluates_every_lane(table7):
    part = table7.reachable_part()
    keys = jax.random.split(jax.random.key(0), 2)
    runs = [QNetwork.initialise(key, 6, (8,), 3) for key in keys]
    state = SimpleNamespace(network=jax.tree.map(lambda *leaves: jax.numpy.stack(leaves), *runs))
    values = exact_monitor(part, [1.0, 0.2])(state)
    assert set(values) == {
        f"{readout}_{n}" for readout in ("greedy", "soft") for n in Metrics._fields
    }
    for run, temperature in enumerate([1.0, 0.2]):
        policy = QPolicy.of(network_of(state.network, run), temperature, {})
        for readout in ("greedy", "soft"):
            expected = evaluate_exactly(part, action_table(policy, part, readout))
            found = [values[f"{readout}_{name}"][run] for name in Metrics._fields]
            assert found == pytest.approx(list(expected), abs=1e-12)
