"""Optima inside a set of allowed actions, and soft optima of a finite horizon."""

import itertools

import jaxtyping
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.mdp.front import attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum, soft_horizon_optimum
from socialiq.mdp.solve import soft_value


def test_barred_actions_are_never_taken(random_mdp):
    rng = np.random.default_rng(0)
    mdp = random_mdp(rng, 4, 3, 2, 0.1)
    allowed = rng.random((4, 3)) < 0.6
    allowed[0] = False  # nothing known here: anything may be done
    best = horizon_optimum(mdp, mdp.rewards.env, 5, allowed=allowed)
    for state in (1, 2, 3):
        if allowed[state].any():
            assert allowed[state, best.actions[:, state]].all()


@pytest.mark.parametrize("timed", [False, True])
def test_the_best_allowed_policy_is_found(random_mdp, timed):
    """Compare with every deterministic policy of a tiny world within the allowed actions."""
    rng = np.random.default_rng(1)
    mdp = random_mdp(rng, 2, 2, 2, 0.2)
    horizon = 2
    allowed = np.ones((horizon, 2, 2), bool)
    allowed[:, 0, 1] = False
    if timed:
        allowed[0] = True
    given = allowed if timed else allowed[0]
    best = horizon_optimum(mdp, mdp.rewards.env, horizon, allowed=given).value
    values = []
    for actions in itertools.product(range(2), repeat=4):
        chosen = np.array(actions).reshape(horizon, 2)
        if all(allowed[t, s, chosen[t, s]] for t in range(horizon) for s in range(2)):
            values.append(horizon_evaluation(mdp, np.eye(2)[chosen], horizon).totals.env)
    assert best == pytest.approx(max(values))


def test_less_support_never_attains_more(random_mdp):
    rng = np.random.default_rng(2)
    mdp = random_mdp(rng, 4, 3, 2, 0.1)
    whole = attainable_set(mdp, 4)
    allowed = np.zeros((4, 3), bool)
    allowed[:, :2] = True
    part = attainable_set(mdp, 4, allowed)
    for angle in np.arange(0.0, 360.0, 15.0).tolist():
        assert part.optimum(angle).value <= whole.optimum(angle).value + 1e-9
    assert part.optimum(0.0).value < whole.optimum(0.0).value


def test_a_mask_of_another_shape_is_refused(small_road, monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # as a user runs it
    with pytest.raises(UserError, match="allowed has shape"):
        horizon_optimum(small_road, small_road.rewards.env, 3, allowed=np.ones((2, 2), bool))


def test_a_soft_optimum_by_hand(small_road):
    """One step: V = τ log Σ exp(r / τ), probabilities its softmax."""
    reward, temperature = small_road.rewards.env, 0.7
    found = soft_horizon_optimum(small_road, reward, 1, temperature)
    assert found.value == pytest.approx(small_road.initial @ soft_value(reward, temperature))
    odds = np.exp(reward / temperature)
    np.testing.assert_allclose(found.probabilities[0], odds / odds.sum(axis=1, keepdims=True))


@pytest.mark.parametrize("seed", range(3))
def test_a_soft_optimum_is_its_own_value_and_no_policy_has_more(seed, random_mdp, random_policy):
    rng = np.random.default_rng(seed)
    mdp, horizon, temperature = random_mdp(rng, 4, 3, 2, 0.2), 4, 0.5

    def worth(policy: np.ndarray) -> float:
        running, total = mdp.initial, 0.0
        for time in range(horizon):
            mass = running[:, None] * policy[time]
            surprise = -np.log(np.maximum(policy[time], 1e-300))
            total += float((mass * (mdp.rewards.env + temperature * surprise)).sum())
            running = mdp.arrivals(mass)
        return total

    best = soft_horizon_optimum(mdp, mdp.rewards.env, horizon, temperature)
    assert worth(best.probabilities) == pytest.approx(best.value)
    for _ in range(20):
        assert worth(random_policy(rng, horizon, 4, 3)) < best.value


def test_a_cold_soft_optimum_is_the_hard_one(random_mdp):
    mdp = random_mdp(np.random.default_rng(5), 4, 3, 2, 0.2)
    cold = soft_horizon_optimum(mdp, mdp.rewards.env, 4, 1e-3)
    hard = horizon_optimum(mdp, mdp.rewards.env, 4)
    assert cold.value == pytest.approx(hard.value, abs=4 * 1e-3 * np.log(3))
    np.testing.assert_array_equal(cold.probabilities.argmax(axis=2), hard.actions)
