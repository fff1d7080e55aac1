from itertools import product

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.types import Ending


def enumerate_episodes(mdp, policy, horizon):
    """(probability, visited pairs, ending) of every episode, by brute force."""

    def follow(state, time, chance, path):
        if time == horizon:
            yield chance, path, Ending.TIMEOUT
            return
        for action, outcome in product(range(mdp.n_actions), range(mdp.successor.shape[2])):
            here = (state, action, outcome)
            p = chance * policy[time, state, action] * mdp.probability[here]
            visited = [*path, (state, action)]
            if mdp.ending[here] != Ending.NONE:
                yield p, visited, mdp.ending[here]
            else:
                yield from follow(mdp.successor[here], time + 1, p, visited)

    for state in range(mdp.n_states):
        yield from follow(state, 0, mdp.initial[state], [])


@pytest.mark.parametrize("seed", range(4))
def test_evaluation_equals_brute_force(seed, random_mdp, random_policy):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 3, 2, 2, 0.3)
    policy = random_policy(rng, 4, 3, 2)
    env = social = length = 0.0
    endings, visits = np.zeros(len(Ending)), np.zeros((3, 2))
    for chance, path, ending in enumerate_episodes(mdp, policy, 4):
        endings[ending] += chance
        length += chance * len(path)
        for pair in path:
            visits[pair] += chance
            env += chance * mdp.rewards.env[pair]
            social += chance * mdp.rewards.social[pair]
    result = horizon_evaluation(mdp, policy, 4)
    np.testing.assert_allclose(result.totals, (env, social), atol=1e-12)
    np.testing.assert_allclose(result.visits, visits, atol=1e-12)
    np.testing.assert_allclose(result.endings, endings, atol=1e-12)
    assert result.length == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("ending_probability", [0.0, 0.2])
def test_endings_are_a_distribution(seed, ending_probability, random_mdp, random_policy):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 8, 3, 3, ending_probability)
    result = horizon_evaluation(mdp, random_policy(rng, 8, 3), 6)
    assert result.endings.sum() == pytest.approx(1.0, rel=1e-12)
    assert result.endings[Ending.NONE] == 0.0
    assert result.length == pytest.approx(result.visits.sum())
    if ending_probability == 0.0:
        assert result.endings[Ending.TIMEOUT] == pytest.approx(1.0)
        assert result.length == pytest.approx(6.0)
    else:
        assert 0.0 < result.endings[Ending.TIMEOUT] < 0.9


def test_evaluation_by_hand(small_road):
    # Wait, go, then arrive: three steps, or two when it collides.
    go_later = np.eye(2)[[[0, 0, 0], [1, 1, 1], [1, 1, 1]]]
    result = horizon_evaluation(small_road, go_later, 3)
    assert result.totals == (-1 - 1 + 0.75 * 10, 2.0)
    assert result.length == 2.75
    expected = {Ending.ARRIVAL: 0.75, Ending.COLLISION: 0.25, Ending.TIMEOUT: 0.0}
    assert {kind: result.endings[kind] for kind in expected} == expected
    early = horizon_evaluation(small_road, go_later[:2], 2)
    assert early.endings[Ending.TIMEOUT] == 0.75


def test_a_stationary_policy_equals_its_repetition(random_mdp, random_policy):
    rng = np.random.default_rng(0)
    mdp, policy = random_mdp(rng, 5, 2, 2, 0.1), random_policy(rng, 5, 2)
    once = horizon_evaluation(mdp, policy, 7)
    repeated = horizon_evaluation(mdp, np.repeat(policy[None], 7, axis=0), 7)
    np.testing.assert_array_equal(once.visits, repeated.visits)


def test_optimum_by_hand(small_road):
    # Paid for waiting, the ego waits while the neighbour gains more than its own way is worth.
    reward = small_road.rewards.env + 0.75 * small_road.rewards.social
    best = horizon_optimum(small_road, reward, 3)
    np.testing.assert_allclose(best.values[:, 0], [7.0, 6.5, 0.5])
    assert best.actions[:, 0].tolist() == [0, 1, 0]
    assert best.value == pytest.approx(7.0)


@pytest.mark.parametrize("seed", range(5))
def test_optimum_equals_its_evaluation_and_beats_random_policies(seed, random_mdp, random_policy):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 6, 3, 2, 0.1)
    reward = mdp.rewards.env
    best = horizon_optimum(mdp, reward, 8)
    own = horizon_evaluation(mdp, best.probabilities(3), 8)
    assert own.totals.env == pytest.approx(best.value, rel=1e-12)
    assert best.value == pytest.approx(mdp.initial @ best.values[0])
    other = horizon_evaluation(mdp, random_policy(rng, 8, 6, 3), 8)
    assert other.totals.env < best.value


@pytest.mark.parametrize("seed", range(3))
def test_optimum_is_the_best_of_all_deterministic_policies(seed, random_mdp):
    mdp = random_mdp(np.random.default_rng(seed), 2, 2, 2, 0.2)
    totals = [
        horizon_evaluation(mdp, np.eye(2)[np.reshape(choice, (3, 2))], 3).totals.social
        for choice in product(range(2), repeat=6)
    ]
    assert horizon_optimum(mdp, mdp.rewards.social, 3).value == pytest.approx(max(totals))


def test_ties_go_to_the_first_action(small_road):
    nothing = np.zeros((3, 2))
    assert (horizon_optimum(small_road, nothing, 2).actions == 0).all()


def test_mistakes_are_refused(small_road):
    uniform = np.full((3, 2), 0.5)
    with pytest.raises(UserError, match="horizon 0"):
        horizon_evaluation(small_road, uniform, 0)
    with pytest.raises(UserError, match="horizon -1"):
        horizon_optimum(small_road, uniform, -1)
    with pytest.raises(UserError, match="2 times"):
        horizon_evaluation(small_road, np.stack([uniform] * 2), 3)
    with pytest.raises(UserError, match="no more axes"):
        horizon_evaluation(small_road, uniform[None, None], 1)
    with pytest.raises(UserError, match="sum to 1"):
        horizon_evaluation(small_road, uniform * 2, 3)
    with pytest.raises(UserError, match="reward has shape"):
        horizon_optimum(small_road, np.zeros((3, 3)), 3)
