import numpy as np
import pytest
from scipy.special import logsumexp

from socialiq.errors import UserError
from socialiq.mdp import solve
from socialiq.mdp.solve import discounted_occupancy
from socialiq.mdp.tabular import TabularMDP
from socialiq.types import Ending, RewardPair

SEEDS = range(5)


def make(seed, random_mdp):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 9, 3, 3, 0.1)
    return rng, mdp, rng.normal(size=(9, 3))


def test_value_iteration_by_hand(small_road):
    solution = solve.value_iteration(small_road, small_road.rewards.env, 0.9)
    # Going: -1 + .9 * .75 * 10 = 5.75; waiting first: -1 + .9 * 5.75 = 4.175.
    np.testing.assert_allclose(solution.q[:2], [[4.175, 5.75], [9.0, 10.0]], rtol=1e-12)
    # State 2 earns nothing itself: action 0 leads to 0 or 1 evenly, action 1 stays.
    assert solution.q[2, 0] == pytest.approx(0.9 * (5.75 + 10.0) / 2, rel=1e-12)
    assert solution.q[2, 1] == pytest.approx(0.9 * solution.q[2, 0], rel=1e-12)


def test_waiting_forever_is_a_geometric_sum(small_road):
    solution = solve.value_iteration(small_road, small_road.rewards.social, 0.9)
    assert solution.v[0] == pytest.approx(2.0 / (1.0 - 0.9), rel=1e-11)


def test_value_iteration_at_discount_one_where_the_optimum_is_finite(small_road):
    solution = solve.value_iteration(small_road, small_road.rewards.env, 1.0)
    assert solution.v[0] == pytest.approx(-1 + 0.75 * 10, rel=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("discount", [0.0, 0.5, 0.99])
def test_value_iteration_satisfies_bellman(seed, discount, random_mdp):
    _, mdp, reward = make(seed, random_mdp)
    q, v, sweeps, residual = solve.value_iteration(mdp, reward, discount)
    assert residual <= 1e-12 * np.abs(v).max()
    assert sweeps >= 1
    np.testing.assert_array_equal(v, q.max(axis=1))
    np.testing.assert_allclose(q, reward + discount * mdp.expected_next(v), atol=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_deterministic_policy_beats_value_iteration(seed, random_mdp):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 4, 2, 2, 0.1)
    reward = rng.normal(size=(4, 2))
    values = [
        solve.evaluate_policy(mdp, np.eye(2)[[(code >> s) & 1 for s in range(4)]], reward, 0.9).v
        for code in range(16)
    ]
    best = solve.value_iteration(mdp, reward, 0.9).v
    np.testing.assert_allclose(best, np.max(values, axis=0), atol=1e-11)


def test_values_far_below_the_others_are_not_given_up():
    # A chain of 30 states to an arrival worth 1e-16, beside a state that settles in one sweep.
    n = 32
    successor = np.minimum(np.arange(n) + 1, n - 1)[:, None, None]
    ending = np.where(np.arange(n) >= n - 2, Ending.ARRIVAL, Ending.NONE)[:, None, None]
    reward = np.zeros((n, 1))
    reward[n - 2], reward[n - 1] = 1e-16, 1.0
    mdp = TabularMDP(
        successor, np.ones((n, 1, 1)), ending, RewardPair(reward, reward), np.full(n, 1 / n)
    )
    assert solve.value_iteration(mdp, reward, 1.0).v[0] == 1e-16


def test_values_that_swing_by_a_rounding_still_stop():
    # States 0 and 1 swap for ever, and settle into a cycle of one rounding; 2 cancels to 0.
    first, second, discount = 0.93, -0.97, 0.9
    value = (first + discount * second) / (1 - discount**2)
    reward = np.array([[first], [second], [-discount * value]])
    shape = (3, 1, 1)
    mdp = TabularMDP(
        np.reshape([1, 0, 0], shape),
        np.ones(shape),
        np.zeros(shape, np.int64),
        RewardPair(reward, reward),
        np.full(3, 1 / 3),
    )
    solution = solve.value_iteration(mdp, reward, discount, max_sweeps=2000)
    np.testing.assert_allclose(solution.v[[0, 2]], [value, 0.0], atol=1e-14)
    assert solution.residual > 0.0


def test_value_iteration_that_does_not_converge_is_refused(small_road):
    with pytest.raises(UserError, match="after 50 sweeps"):
        solve.value_iteration(small_road, small_road.rewards.social, 1.0, max_sweeps=50)


def test_value_iteration_solves_a_world_of_the_thesis_size_to_the_last_digit(random_mdp):
    mdp = random_mdp(np.random.default_rng(0), 12_096, 3, 2, 0.0)
    found = solve.value_iteration(mdp, mdp.rewards.env, 0.99)
    backup = (mdp.rewards.env + 0.99 * mdp.expected_next(found.v)).max(axis=1)
    np.testing.assert_allclose(found.v, backup, rtol=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_reward_follows_from_the_values(seed, random_mdp):
    _, mdp, reward = make(seed, random_mdp)
    q, v, _, _ = solve.value_iteration(mdp, reward, 0.95)
    np.testing.assert_allclose(solve.bellman_reward(mdp, q, v, 0.95), reward, atol=1e-10)


@pytest.mark.parametrize("seed", SEEDS)
def test_evaluation_equals_iterated_backups(seed, random_mdp, random_policy):
    rng, mdp, reward = make(seed, random_mdp)
    policy = random_policy(rng, 9, 3)
    q, v, sweeps, residual = solve.evaluate_policy(mdp, policy, reward, 0.9)
    iterated = np.zeros(9)
    for _ in range(400):
        iterated = (policy * (reward + 0.9 * mdp.expected_next(iterated))).sum(axis=1)
    np.testing.assert_allclose(v, iterated, atol=1e-11)
    np.testing.assert_allclose(q, reward + 0.9 * mdp.expected_next(v), atol=1e-12)
    assert sweeps == 0
    assert residual < 1e-12


def test_undiscounted_evaluation_by_hand(small_road):
    # From 0 the policy waits half the time: two steps before it goes, once going.
    policy = np.array([[0.5, 0.5], [0.0, 1.0], [1.0, 0.0]])
    v = solve.evaluate_policy(small_road, policy, small_road.rewards.env, 1.0).v
    # v0 = -1 + .5 v0 + .5 * .75 * 10, v2 = (v0 + v1) / 2.
    np.testing.assert_allclose(v, [5.5, 10.0, 7.75], rtol=1e-12)


def test_undiscounted_evaluation_of_a_policy_that_never_ends_is_refused(small_road):
    waits = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(UserError, match="never ends"):
        solve.evaluate_policy(small_road, waits, small_road.rewards.env, 1.0)
    assert solve.evaluate_policy(small_road, waits, small_road.rewards.env, 0.5).v[0] == -2.0


def test_greedy_takes_the_first_or_last_of_relative_ties():
    q = np.array(
        [
            [1.0, 1.0 + 1e-13, 0.0],
            [1.0, 1.0 + 1e-11, 0.0],
            [1e-16, 3e-16, -1.0],
            [-2.0, -2.0, -2.0],
            [0.0, 0.0, -1e-300],
        ]
    )
    first = solve.greedy_policy(q)
    last = solve.greedy_policy(q, prefer="last")
    assert first.argmax(axis=1).tolist() == [0, 1, 1, 0, 0]
    assert last.argmax(axis=1).tolist() == [1, 1, 1, 2, 1]
    assert first.sum(axis=1).tolist() == [1.0] * 5


@pytest.mark.parametrize("temperature", [0.02, 1.0, 20.0])
def test_soft_value_is_logsumexp(temperature):
    q = np.random.default_rng(0).normal(size=(20, 4)) * 30
    expected = temperature * logsumexp(q / temperature, axis=1)
    np.testing.assert_allclose(solve.soft_value(q, temperature), expected, rtol=1e-13)


def test_soft_value_by_hand():
    assert solve.soft_value(np.array([[1.0, 1.0]]), 0.5)[0] == pytest.approx(1 + 0.5 * np.log(2))


def test_soft_policy_by_hand():
    policy = solve.soft_policy(np.array([[np.log(3.0), 0.0], [500.0, 0.0]]), 0.5)
    np.testing.assert_allclose(policy, [[0.9, 0.1], [1.0, 0.0]], atol=1e-15)


@pytest.mark.parametrize("temperature", [0.0, -1.0, np.nan, np.inf])
def test_bad_temperatures_are_refused(temperature):
    with pytest.raises(UserError, match="temperature"):
        solve.soft_policy(np.zeros((1, 2)), temperature)


def test_bad_rewards_and_discounts_are_refused(small_road):
    with pytest.raises(UserError, match="reward has shape"):
        solve.value_iteration(small_road, np.zeros((2, 3)), 0.9)
    with pytest.raises(UserError, match="finite"):
        solve.value_iteration(small_road, np.full((3, 2), np.nan), 0.9)
    with pytest.raises(UserError, match=r"discount 1\.5"):
        solve.value_iteration(small_road, np.zeros((3, 2)), 1.5)


def test_occupancy_by_hand(small_road):
    policy = np.array([[0.5, 0.5], [0.0, 1.0], [1.0, 0.0]])
    # Visits to 0: 1 / (1 - .8 * .5); to 1: .8 * .5 * .75 of those; to 2: none.
    first = 1 / 0.6
    expected = 0.2 * np.array([[first / 2, first / 2], [0.0, 0.3 * first], [0.0, 0.0]])
    found = discounted_occupancy(small_road, policy, 0.8)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=0)


def test_discount_zero_is_the_first_step(random_mdp, random_policy):
    rng = np.random.default_rng(0)
    mdp, policy = random_mdp(rng, 5, 2, 2, 0.2), random_policy(rng, 5, 2)
    found = discounted_occupancy(mdp, policy, 0.0)
    np.testing.assert_allclose(found, mdp.initial[:, None] * policy, rtol=1e-14)


def test_mistakes_are_refused(small_road):
    uniform = np.full((3, 2), 0.5)
    for discount in (1.0, -0.1, np.nan):
        with pytest.raises(UserError, match=r"outside \[0, 1\)"):
            discounted_occupancy(small_road, uniform, discount)
    with pytest.raises(UserError, match="sum to 1"):
        discounted_occupancy(small_road, uniform / 2, 0.9)
