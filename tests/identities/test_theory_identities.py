"""Theorems about the regularized objective, on random worlds (docs/theory.md)."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialiq.mdp.solve import discounted_occupancy, soft_policy, soft_value
from socialiq.mdp.tabular import TabularMDP
from socialiq.theory import response
from socialiq.theory.closed_form import (
    centre,
    closed_form,
    conservative_loss,
    dual_value,
    offset,
    primal_value,
)
from socialiq.theory.demonstrators import mean_target, occupancies
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem, shaped
from socialiq.theory.semi_gradient import fixed_point
from socialiq.types import Ending, RewardPair

N_STATES, N_ACTIONS, DISCOUNT = 5, 3, 0.9
SHAPE = (N_STATES, N_ACTIONS, 2)
each = pytest.mark.parametrize("seed", range(5))


class Pool:
    """Random world with three demonstrators, which don't take every action everywhere."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.mdp = TabularMDP(
            successor=rng.integers(N_STATES, size=SHAPE),
            probability=rng.dirichlet(np.ones(2), SHAPE[:2]),
            ending=np.where(rng.random(SHAPE) < 0.15, Ending.COLLISION, Ending.NONE),
            rewards=RewardPair(rng.normal(size=SHAPE[:2]), rng.normal(size=SHAPE[:2])),
            initial=rng.dirichlet(np.ones(N_STATES)),
        )
        allowed = rng.random(SHAPE[:2]) < 0.8
        allowed[:, 0] = True
        self.policies = []
        for _ in range(3):
            policy = rng.dirichlet(np.full(N_ACTIONS, 0.7), N_STATES) * allowed
            self.policies.append(policy / policy.sum(axis=1, keepdims=True))
        self.parts = occupancies(self.mdp, self.policies, [0.2, 0.3, 0.5], DISCOUNT)

    def problem(self, kind: str = "instantaneous", **numbers: float) -> Problem:
        reward = self.mdp.rewards.social
        target = mean_target(self.mdp, self.policies, self.parts, reward, kind, DISCOUNT)
        whole = self.parts.sum(axis=0)
        return Problem(self.mdp, whole, target, discount=DISCOUNT, **numbers)


@settings(max_examples=15)
@given(
    seed=st.integers(0, 10_000),
    strength=st.floats(0.0, 3.0),
    temperature=st.floats(0.01, 3.0),
    prior_weight=st.floats(0.0, 2.0),
    chi2_alpha=st.floats(0.1, 2.0),
)
def test_the_minimum_has_the_closed_form_and_no_duality_gap(
    seed, strength, temperature, prior_weight, chi2_alpha
):
    """The occupancy of the closed form is computed independently, by mdp.solve."""
    problem = Pool(seed).problem(
        "to_go",
        strength=strength,
        temperature=temperature,
        prior_weight=prior_weight,
        chi2_alpha=chi2_alpha,
    )
    found, on = minimise(problem), problem.support
    occupancy = discounted_occupancy(problem.mdp, found.policy, DISCOUNT)
    # Newton stops at 1e-10 of the greatest reward, which is below 100 here.
    np.testing.assert_allclose(found.reward[on], closed_form(problem, occupancy)[on], atol=1e-7)
    bound = centre(problem)[on] + 1 / (2 * problem.curvature)
    assert (found.reward[on] <= bound + 1e-7).all()
    gap = dual_value(problem, found.loss) - primal_value(problem, occupancy)
    assert abs(gap) < 1e-8 * (1.0 + abs(primal_value(problem, occupancy)))


@each
def test_every_q_bounds_every_policy(seed):
    pool = Pool(seed)
    problem = pool.problem("to_go", strength=0.8, temperature=0.3)
    on, best = problem.support, primal_value(problem, minimise(problem).occupancy)
    for _ in range(5):
        q = np.where(on, pool.rng.normal(size=on.shape), -np.inf)
        assert dual_value(problem, problem.loss(q, soft_value(q, 0.3))) > best
        policy = soft_policy(q, 1.0)
        occupancy = discounted_occupancy(problem.mdp, policy, DISCOUNT)
        assert primal_value(problem, occupancy) < best


@each
@pytest.mark.parametrize("temperature", [1.0, 0.05])
def test_no_minimum_feels_shaping(seed, temperature):
    pool = Pool(seed)
    problem = pool.problem(temperature=temperature)
    base, semi = minimise(problem), fixed_point(problem)
    potential = 10 * pool.rng.normal(size=N_STATES)
    target = shaped(pool.mdp, problem.target, potential, DISCOUNT)
    other = dataclasses.replace(problem, target=target)
    np.testing.assert_allclose(minimise(other).policy, base.policy, atol=1e-7)
    on = problem.support.any(axis=1)
    found = soft_policy(fixed_point(other)[on], temperature)
    np.testing.assert_allclose(found, soft_policy(semi[on], temperature), atol=1e-6)


@each
def test_the_pool_s_advantage_is_the_instantaneous_target_and_returns_are_not(seed):
    pool = Pool(seed)
    base = minimise(pool.problem()).policy
    np.testing.assert_allclose(minimise(pool.problem("advantage")).policy, base, atol=1e-7)
    for kind in ("to_go", "own_advantage"):
        assert np.abs(minimise(pool.problem(kind)).policy - base).max() > 1e-3


@each
def test_one_demonstrator_s_returns_are_steps_and_a_constant(seed):
    """Q = A + V: the target Q has the policy of R + V."""
    pool = Pool(seed)
    pool.policies = pool.policies[:1]
    pool.parts = occupancies(pool.mdp, pool.policies, [1.0], DISCOUNT)
    problem, to_go = pool.problem(), pool.problem("to_go")
    policy = pool.policies[0]
    value = (policy * np.where(to_go.support, to_go.target, 0.0)).sum(axis=1, keepdims=True)
    paid = dataclasses.replace(problem, target=problem.target + value)
    np.testing.assert_allclose(minimise(to_go).policy, minimise(paid).policy, atol=1e-7)


@each
def test_the_slope_is_the_path_s_as_the_temperature_falls(seed):
    """At τ = 1e-7 entropy weighs 6e-7 against χ², and the path is straight within its reach."""
    problem = Pool(seed).problem(temperature=1e-7)
    slope = response.occupancy_slope(problem)
    reach = response.reach(np.where(problem.support, problem.demonstrated, 0.0), slope)
    strength = 0.8 * reach
    found = minimise(dataclasses.replace(problem, strength=strength)).occupancy
    expected = problem.demonstrated + strength * slope
    np.testing.assert_allclose(found, expected, atol=1e-5)
    moved = ((found - problem.demonstrated) * problem.target)[problem.support].sum()
    assert moved == pytest.approx(strength * response.target_slope(problem), rel=1e-3)


@each
def test_strength_zero_is_the_baseline_of_another_alpha(seed):
    """w = 1 turns α_χ = 1/2 into 1/6; the thesis says that λ = 0 recovers IQ-Learn (4.3.1)."""
    problem = Pool(seed).problem()
    zero = minimise(dataclasses.replace(problem, strength=0.0)).policy
    sixth = minimise(dataclasses.replace(problem, prior_weight=0.0, chi2_alpha=1 / 6)).policy
    plain = minimise(dataclasses.replace(problem, prior_weight=0.0)).policy
    np.testing.assert_allclose(zero, sixth, atol=1e-7)
    assert np.abs(zero - plain).max() > 0.01


@each
def test_the_objective_is_conservative_q_learning_at_every_q(seed):
    """Exact measures; for rows and networks see test_objective_identities."""
    pool = Pool(seed)
    problem = pool.problem("to_go", strength=0.6, prior_weight=0.4, temperature=0.5)
    for _ in range(5):
        q = np.where(problem.support, 3 * pool.rng.normal(size=SHAPE[:2]), -np.inf)
        v = soft_value(q, 0.5)
        other = conservative_loss(problem, q, v) + offset(problem)
        assert problem.loss(q, v) == pytest.approx(other, rel=1e-10, abs=1e-12)
