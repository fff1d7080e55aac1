import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.shared_reward.angles import infer
from socialiq.learners.shared_reward.exact import Group, Settings, fit
from socialiq.mdp.horizon import horizon_evaluation, soft_horizon_optimum
from socialiq.mdp.tabular import TabularMDP
from socialiq.social.angle import score, weights
from socialiq.types import Ending, RewardPair

SETTINGS = Settings(horizon=4, temperature=0.5, shrinkage=1e-4, spread=1e-3, tolerance=1e-8)


def bandit() -> TabularMDP:
    """One state, one step, two actions; the first pays the ego 1, the second the neighbour 1."""
    return TabularMDP(
        successor=np.zeros((1, 2, 1), np.int64),
        probability=np.ones((1, 2, 1)),
        ending=np.full((1, 2, 1), Ending.ARRIVAL),
        rewards=RewardPair(np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])),
        initial=np.ones(1),
    )


def chain(seed: int) -> TabularMDP:
    """Four states, three actions, no ends before the horizon."""
    rng = np.random.default_rng(seed)
    return TabularMDP(
        successor=rng.integers(4, size=(4, 3, 2)),
        probability=rng.dirichlet(np.ones(2), (4, 3)),
        ending=np.zeros((4, 3, 2), np.int64),
        rewards=RewardPair(rng.normal(size=(4, 3)), rng.normal(size=(4, 3))),
        initial=np.array([0.5, 0.5, 0.0, 0.0]),
    )


def test_a_bandits_maximiser_by_hand() -> None:
    """With demonstrations (p, 1 - p) and a small c, m + f has the log odds of p at τ."""
    visits = np.array([[0.8, 0.2]])
    centre = np.array([[0.0, 1.0]])
    found = fit(bandit(), [Group(1.0, visits, centre)], SETTINGS._replace(horizon=1))
    reward = (centre + found.correction)[0]
    assert (reward[0] - reward[1]) / 0.5 == pytest.approx(np.log(0.8 / 0.2), abs=1e-2)
    assert found.slope <= SETTINGS.tolerance


def test_a_strong_shrinkage_leaves_the_centre() -> None:
    visits, centre = np.array([[0.8, 0.2]]), np.array([[0.0, 1.0]])
    settings = SETTINGS._replace(horizon=1, shrinkage=1e4)
    found = fit(bandit(), [Group(1.0, visits, centre)], settings)
    np.testing.assert_allclose(found.correction, 0.0, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_the_stationary_point_is_the_closed_form(seed: int) -> None:
    """f = (ρ_E - ρ_π) / (2 c (ρ_E + ε)), with ρ_π the mean of the groups' own policies."""
    mdp, settings = chain(seed), SETTINGS._replace(shrinkage=0.2)
    rng = np.random.default_rng(seed)
    groups = []
    for angle in (0.0, 90.0):
        policy = rng.dirichlet(np.ones(3), 4)
        visits = horizon_evaluation(mdp, policy, settings.horizon).visits
        groups.append(Group(0.5, visits, score(weights(angle), mdp.rewards)))
    found = fit(mdp, groups, settings)
    reached = [
        horizon_evaluation(
            mdp,
            soft_horizon_optimum(
                mdp, one.centre + found.correction, settings.horizon, settings.temperature
            ).probabilities,
            settings.horizon,
        ).visits
        for one in groups
    ]
    demonstrated, learned = (
        np.mean([one.visits for one in groups], axis=0),
        np.mean(reached, axis=0),
    )
    expected = (demonstrated - learned) / (2 * 0.2 * (demonstrated + settings.spread))
    np.testing.assert_allclose(found.correction, expected, atol=1e-4)


def demonstrate(mdp: TabularMDP, skill: np.ndarray, angle: float) -> np.ndarray:
    """Expected counts of a soft-optimal driver by time, state and action."""
    reward = score(weights(angle), mdp.rewards) + skill
    policy = soft_horizon_optimum(mdp, reward, SETTINGS.horizon, SETTINGS.temperature)
    counts, running = [], mdp.initial
    for time in range(SETTINGS.horizon):
        mass = running[:, None] * policy.probabilities[time]
        counts.append(mass)
        running = mdp.arrivals(mass)
    return np.array(counts)


def test_a_skill_that_all_share_is_found_and_goes_with_an_unseen_angle() -> None:
    mdp = chain(7)
    skill = np.zeros((4, 3))
    skill[:, 1] = -3.0  # everybody shuns the second action
    angles = (0.0, 45.0, 90.0)
    counts = [demonstrate(mdp, skill, angle) for angle in angles]
    groups = [
        Group(1 / 3, one.sum(axis=0), score(weights(angle), mdp.rewards))
        for one, angle in zip(counts, angles, strict=True)
    ]
    found = fit(mdp, groups, SETTINGS)
    truth, learned = (demonstrate(mdp, one, 70.0).sum(axis=0) for one in (skill, found.correction))
    without = demonstrate(mdp, np.zeros((4, 3)), 70.0).sum(axis=0)
    assert np.abs(learned - truth).sum() < 0.05
    assert np.abs(without - truth).sum() > 0.5


def test_angles_are_inferred_beside_the_skill() -> None:
    mdp = chain(7)
    skill = np.zeros((4, 3))
    skill[:, 1] = -3.0
    angles = (0.0, 40.0, 80.0)
    episodes = [2000] * 3
    counts = [2000 * demonstrate(mdp, skill, angle) for angle in angles]
    found = infer(mdp, counts, episodes, np.arange(0.0, 91.0, 10.0).tolist(), SETTINGS, rounds=15)
    grid = np.arange(0.0, 91.0, 10.0)
    assert found.posterior.shape == (3, 10)
    np.testing.assert_allclose(found.posterior.sum(axis=1), 1.0)
    estimates = found.posterior @ grid
    assert np.abs(estimates - angles).max() <= 10.0
    assert (np.diff(estimates) > 0).all()


def test_bad_calls_are_refused() -> None:
    mdp = bandit()
    with pytest.raises(UserError, match="at least one group"):
        fit(mdp, [], SETTINGS)
    with pytest.raises(UserError, match="visits has shape"):
        fit(mdp, [Group(1.0, np.ones((2, 2)), np.ones((1, 2)))], SETTINGS)
    with pytest.raises(UserError, match="inference needs"):
        infer(mdp, [], [], [0.0], SETTINGS)
