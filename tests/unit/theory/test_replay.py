import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.mdp.solve import bellman_reward, soft_policy, soft_value
from socialiq.theory.closed_form import centre
from socialiq.theory.demonstrators import drawn_rows
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem
from socialiq.theory.semi_gradient import equilibrium, replayed

HORIZON, DISCOUNT = 6, 0.9


@pytest.fixture(name="rows")
def rows_fixture(random_world, random_pool):
    mdp = random_world(0)
    drawn = drawn_rows(
        mdp, random_pool(0), [0.5, 0.3, 0.2], mdp.rewards.env, "instantaneous", HORIZON, DISCOUNT
    )
    return mdp, Problem(drawn.mdp, drawn.shares, drawn.target, discount=DISCOUNT)


def test_replay_is_what_episodes_visit(random_world, random_pool):
    mdp, policy = random_world(1), random_pool(1)[0]
    own = replayed(mdp, policy, HORIZON, DISCOUNT)
    visits = horizon_evaluation(mdp, policy, HORIZON).visits
    np.testing.assert_allclose(own.states, visits.sum(axis=1) / visits.sum(), rtol=1e-12)


def test_entry_is_term_2_for_any_value(random_world, random_pool):
    """Σ over rows of V(s) - γ (1 - d) V(s'), where the last row of the clock has d = 1."""
    mdp, policy = random_world(1), random_pool(1)[0]
    v = np.random.default_rng(0).normal(size=6)
    running, total, count = mdp.initial, 0.0, 0.0
    for time in range(HORIZON):
        mass = running[:, None] * policy
        follows = mdp.expected_next(v) if time < HORIZON - 1 else 0.0
        total += (mass * (v[:, None] - DISCOUNT * follows)).sum()
        count += mass.sum()
        running = mdp.arrivals(mass)
    own = replayed(mdp, policy, HORIZON, DISCOUNT)
    assert own.entry @ v == pytest.approx(total / count, rel=1e-12)


def test_a_learner_that_is_the_demonstrator_sees_the_demonstrations(random_world, random_pool):
    """One demonstrator without entropy: replay adds nothing, so the minimum stays."""
    mdp, policies = random_world(2), random_pool(2)[:1]
    drawn = drawn_rows(mdp, policies, [1.0], mdp.rewards.env, "instantaneous", HORIZON, DISCOUNT)
    numbers = {"discount": DISCOUNT, "temperature": 1e-5, "strength": 0.0}
    problem = Problem(drawn.mdp, drawn.shares, drawn.target, **numbers)
    own = replayed(mdp, policies[0], HORIZON, DISCOUNT)
    np.testing.assert_allclose(own.entry, problem.entry, atol=1e-12)
    q = equilibrium(problem, mdp, HORIZON, "online")
    found = soft_policy(q[problem.support.any(axis=1)], 1e-5)
    expected = minimise(problem).policy[problem.support.any(axis=1)]
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_the_equilibrium_fulfils_its_own_equation(rows):
    mdp, problem = rows
    on, temperature = problem.support, problem.temperature
    q = equilibrium(problem, mdp, HORIZON, "target")
    policy = soft_policy(q, temperature)
    own = replayed(mdp, policy, HORIZON, DISCOUNT)
    seen = (problem.demonstrated.sum(axis=1) + own.states) / 2
    push = 1.0 - (seen[:, None] * policy)[on] / problem.demonstrated[on]
    reward = bellman_reward(problem.mdp, q, soft_value(q, temperature), DISCOUNT)
    expected = centre(problem)[on] + push / (2 * problem.curvature)
    np.testing.assert_allclose(reward[on], expected, atol=1e-5)


def test_the_gradient_through_v_sees_the_mixture_s_entry(rows):
    mdp, problem = rows
    q = equilibrium(problem, mdp, HORIZON, "online")
    own = replayed(mdp, soft_policy(q, problem.temperature), HORIZON, DISCOUNT)
    again = minimise(problem, q, (problem.entry + own.entry) / 2)
    np.testing.assert_allclose(again.q[problem.support], q[problem.support], atol=1e-5)
    offline = minimise(problem).q[problem.support]
    assert np.abs(offline - q[problem.support]).max() > 1e-3


def test_an_unknown_next_value_is_refused(rows):
    with pytest.raises(UserError, match="unknown next value"):
        equilibrium(rows[1], rows[0], HORIZON, "slow")
