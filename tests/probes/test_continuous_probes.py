"""A world of one state and continuous actions, whose solutions are known by integration."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import norm

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.behaviour_cloning import GaussianCloning
from socialiq.learners.continuous import config
from socialiq.learners.continuous.train import train
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import train as train_discrete
from socialiq.types import Ending, RewardPair, Step

FULL_COMPILER = True
ONLY_STATE = np.ones((1, 1), np.float32)
GRID = np.linspace(-0.9995, 0.9995, 2000)  # the middles of 2000 cells of actions
RUNS = 4096  # demonstrated actions
SMALL = {"hidden": (32, 32), "batch_size": 64}


def env_reward(action: Any) -> Any:
    return -((action - 0.5) ** 2)


def social_reward(action: Any) -> Any:
    return -((action + 0.5) ** 2)


@dataclass(frozen=True)
class Bandit:
    """One state; the action a pays -(a - 0.5)² to the ego and -(a + 0.5)² to the others."""

    action_size = 1
    n_features = 1
    description = "bandit"

    def reset(self, key: Any) -> tuple[Any, Any]:
        return jnp.zeros(()), jnp.ones(1)

    def advance(self, key: Any, episode: Any, action: Any) -> tuple[Any, Step]:
        pair = RewardPair(env_reward(action[0]), social_reward(action[0]))
        return episode, Step(jnp.ones(1), pair, jnp.array(int(Ending.OTHER), jnp.int32))


def moments(density: np.ndarray) -> tuple[float, float]:
    """Mean and deviation of an action with this density on `GRID`."""
    share = density / density.sum()
    mean = share @ GRID
    return float(mean), float(np.sqrt(share @ (GRID - mean) ** 2))


def shown(policy: Any) -> tuple[float, float]:
    """Mean and deviation of a policy's action."""
    mean, deviation = policy.gaussian(ONLY_STATE)
    u = mean + deviation * np.random.default_rng(0).standard_normal((100_000, 1))
    return float(np.tanh(u).mean()), float(np.tanh(u).std())


def demonstrated() -> np.ndarray:
    """Actions of a squashed Gaussian: the middles of as many equally likely parts."""
    return np.tanh(0.2 + 0.5 * norm.ppf((np.arange(RUNS) + 0.5) / RUNS))


def demonstrated_density() -> np.ndarray:
    """Density of `demonstrated` on `GRID`."""
    u = np.arctanh(GRID)
    return np.exp(-0.5 * ((u - 0.2) / 0.5) ** 2) / (0.5 * np.sqrt(2 * np.pi)) / (1 - GRID**2)


def table(action: np.ndarray, n_actions: int = 0) -> Demonstrations:
    """One-step episodes with these actions, continuous or in so many equal cells."""
    count = len(action)
    cells = np.minimum(((action + 1) / 2 * n_actions).astype(int), n_actions - 1)
    middles = (cells + 0.5) * 2 / n_actions - 1 if n_actions else action
    return Demonstrations.of(
        observation=np.ones((count, 1)),
        action=cells if n_actions else action[:, None],
        next_observation=np.ones((count, 1)),
        ending=np.full(count, int(Ending.OTHER)),
        rewards=RewardPair(env_reward(middles), social_reward(middles)),
        episode=np.arange(count),
        n_actions=n_actions,
    )


@pytest.mark.slow
def test_the_soft_optimum_of_a_bandit_is_boltzmanns():
    static = config.SACConfig(
        **SMALL, updates=1200, random_steps=1200, replay_capacity=1200, schedule="linear"
    )
    numbers = {"strength": 4.0, "temperature": 0.4, "learning_rate": 5e-3, "polyak": 0.05}
    runs = [config.SACHyperparameters(angle, **numbers) for angle in (0.0, 90.0)]
    trained = train(static, runs, simulator=Bandit(), chunk=1200)
    for run, reward in enumerate((env_reward(GRID), social_reward(GRID))):
        wanted = moments(np.exp(4.0 * reward / 0.4))
        assert shown(trained.policy(run)) == pytest.approx(wanted, abs=0.03)


IQ = config.ActorIQLearnHyperparameters(
    0.0, strength=4.0, prior_weight=2.0, temperature=0.5, learning_rate=3e-3
)


def optimum() -> tuple[float, float]:
    """Solve r̂ = m + (1 - π / ρ_E) / (2κ) (docs/theory.md), π = softmax(r̂/τ), on `GRID`."""
    reward = env_reward(GRID)
    demonstrated = demonstrated_density() / demonstrated_density().sum()
    kappa = 1.0 / (4.0 * IQ.chi2_alpha) + IQ.prior_weight
    centre = IQ.prior_weight * IQ.strength * reward / kappa
    found = centre
    for _ in range(2000):
        gap = centre + (1.0 - softmax(found / IQ.temperature) / demonstrated) / (2 * kappa) - found
        found = found + 0.02 * gap
    return moments(softmax(found / IQ.temperature))


@pytest.mark.slow
def test_continuous_iq_learn_finds_the_fixed_point_of_the_objective():
    static = config.ActorIQLearnConfig(
        **SMALL,
        updates=1500,
        schedule="linear",
        online=False,
        value_term="value_expert",
        actions_per_state=4,
    )
    trained = train(static, [IQ], [table(demonstrated())], chunk=1500)
    assert shown(trained.policy(0)) == pytest.approx(optimum(), abs=0.03)


def test_with_many_cells_the_discrete_learner_has_the_same_policy():
    cells = 21
    static = IQLearnConfig(
        online=False,
        value_term="value_expert",
        target_kind="instantaneous",
        hidden=(),
        batch_size=256,
        updates=2000,
    )
    run = IQLearnHyperparameters(
        0.0, strength=4.0, prior_weight=2.0, temperature=0.5, learning_rate=2e-3
    )
    trained = train_discrete(static, [run], [table(demonstrated(), cells)], chunk=2000)
    chances = trained.policy(0).probabilities(ONLY_STATE)[0]
    middles = (np.arange(cells) + 0.5) * 2 / cells - 1
    mean = chances @ middles
    found = (mean, np.sqrt(chances @ (middles - mean) ** 2))
    assert found == pytest.approx(optimum(), abs=0.03)


def test_the_clone_has_the_density_of_the_data():
    static = GaussianCloning.StaticConfig(hidden=(16,), batch_size=128, updates=800)
    run = GaussianCloning.Hyperparameters(learning_rate=3e-3)
    trained = GaussianCloning.train_on(static, [run], [table(demonstrated())], chunk=800)
    mean, deviation = trained.policy(0).gaussian(ONLY_STATE)
    assert mean[0, 0] == pytest.approx(0.2, abs=0.05)
    assert deviation[0, 0] == pytest.approx(0.5, abs=0.05)


@pytest.mark.slow
def test_td3_bc_stands_where_distance_and_value_balance():
    """With Q = -(a + 1/2)² and data of mean m: (a - m) (a + 1/2) = -w.

    The loss is (a - m)² + w |Q| / sg|Q| but for a constant; its slope is 2 (a - m) + 2 w / (a + ½).
    For w > (m + ½)² / 4 it is positive for every a > -½, so no action balances. How near such runs
    come to the best action, -½, differs between seeds, from -1.0 to -0.3: there sg|Q| is 0.
    """
    static = config.TD3BCConfig(hidden=(32, 32), batch_size=128, updates=800, schedule="linear")
    weights = (0.0, 0.025, 0.05)
    runs = [
        config.TD3BCHyperparameters(90.0, q_weight=weight, learning_rate=3e-3)
        for weight in (*weights, 1.0)
    ]
    trained = train(static, runs, [table(demonstrated())], chunk=800)
    *balanced, strong = (
        float(trained.policy(run).predict(ONLY_STATE)[0][0, 0]) for run in range(len(runs))
    )
    mean = demonstrated().mean()
    roots = np.sqrt((mean + 0.5) ** 2 / 4 - np.array(weights))
    np.testing.assert_allclose(balanced, (mean - 0.5) / 2 + roots, atol=0.03)
    assert strong < (mean - 0.5) / 2  # below every action that balances
