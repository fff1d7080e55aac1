"""Equations of every policy's occupancy, on which IQ-Learn's loss is based."""

import numpy as np
import pytest

from socialiq.mdp.horizon import horizon_evaluation
from socialiq.mdp.solve import discounted_occupancy, evaluate_policy
from socialiq.mdp.tabular import TabularMDP
from socialiq.types import Ending, RewardPair

N_STATES, N_ACTIONS = 12, 3
SHAPE = (N_STATES, N_ACTIONS, 3)


def world(seed: int, ending_probability: float) -> tuple[np.random.Generator, TabularMDP]:
    rng = np.random.default_rng(seed)
    ends = rng.random(SHAPE) < ending_probability
    return rng, TabularMDP(
        successor=rng.integers(N_STATES, size=SHAPE),
        probability=rng.dirichlet(np.ones(3), SHAPE[:2]),
        ending=np.where(ends, Ending.ARRIVAL, Ending.NONE),
        rewards=RewardPair(rng.normal(size=SHAPE[:2]), rng.normal(size=SHAPE[:2])),
        initial=rng.dirichlet(np.ones(N_STATES)),
    )


def any_policy(rng: np.random.Generator) -> np.ndarray:
    return rng.dirichlet(np.full(N_ACTIONS, 0.5), N_STATES)


each = pytest.mark.parametrize("seed", range(6))
endings = pytest.mark.parametrize("ending_probability", [0.0, 0.15])
discounts = pytest.mark.parametrize("discount", [0.3, 0.9, 0.99])


@each
@endings
@discounts
def test_value_gap_under_an_occupancy_is_the_initial_value(seed, ending_probability, discount):
    """E_ρ[V(s) - γ V(s')] = (1 - γ) E_p0[V(s_0)] for any V and any policy."""
    rng, mdp = world(seed, ending_probability)
    rho = discounted_occupancy(mdp, any_policy(rng), discount)
    values = rng.normal(size=N_STATES) * 10
    gap = (rho * (values[:, None] - discount * mdp.expected_next(values))).sum()
    initial = (1 - discount) * mdp.initial @ values
    assert gap == pytest.approx(initial, rel=1e-10, abs=1e-11)


@each
@endings
@discounts
def test_mass_is_one_without_endings_and_the_discounted_length_with(
    seed, ending_probability, discount
):
    rng, mdp = world(seed, ending_probability)
    policy = any_policy(rng)
    rho = discounted_occupancy(mdp, policy, discount)
    assert (rho >= 0).all()
    length = mdp.initial @ evaluate_policy(mdp, policy, np.ones(SHAPE[:2]), discount).v
    assert rho.sum() == pytest.approx((1 - discount) * length, rel=1e-11)
    if ending_probability == 0.0:
        assert rho.sum() == pytest.approx(1.0, rel=1e-11)
    else:
        assert rho.sum() < 0.99


@each
@endings
@discounts
def test_reward_under_an_occupancy_is_the_policy_value(seed, ending_probability, discount):
    """E_ρ[r] = (1 - γ) J(π), Eq 2.1."""
    rng, mdp = world(seed, ending_probability)
    policy = any_policy(rng)
    rho = discounted_occupancy(mdp, policy, discount)
    value = mdp.initial @ evaluate_policy(mdp, policy, mdp.rewards.env, discount).v
    assert (rho * mdp.rewards.env).sum() == pytest.approx(
        (1 - discount) * value, rel=1e-10, abs=1e-12
    )


@each
@discounts
def test_occupancy_remembers_its_policy(seed, discount):
    rng, mdp = world(seed, 0.15)
    policy = any_policy(rng)
    rho = discounted_occupancy(mdp, policy, discount)
    np.testing.assert_allclose(rho / rho.sum(axis=1, keepdims=True), policy, rtol=1e-10)


@each
def test_occupancy_is_the_discounted_sum_over_time(seed):
    rng, mdp = world(seed, 0.15)
    policy = any_policy(rng)
    state, summed = mdp.initial, np.zeros(SHAPE[:2])
    for time in range(150):
        mass = state[:, None] * policy
        summed += 0.3 * 0.7**time * mass
        state = mdp.arrivals(mass)
    np.testing.assert_allclose(discounted_occupancy(mdp, policy, 0.7), summed, atol=1e-13)


@each
def test_a_discount_near_one_and_a_long_horizon_agree_where_everything_ends(seed):
    rng, mdp = world(seed, 0.5)
    policy = any_policy(rng)
    visits = horizon_evaluation(mdp, policy, 200).visits
    rho = discounted_occupancy(mdp, policy, 1 - 1e-9)
    np.testing.assert_allclose(rho / 1e-9, visits, rtol=1e-6)
