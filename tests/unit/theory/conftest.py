from typing import Any

import numpy as np
import pytest

from socialiq.mdp.tabular import TabularMDP
from socialiq.theory.demonstrators import mean_target, occupancies
from socialiq.theory.objective import Problem
from socialiq.types import Ending, RewardPair

DISCOUNT = 0.9


def bandit(shares: list[float], targets: list[float], **numbers: Any) -> Problem:
    """MDP of a single state in which every action ends the episode."""
    shape = (1, len(shares), 1)
    target = np.array([targets])
    mdp = TabularMDP(
        successor=np.zeros(shape, np.int64),
        probability=np.ones(shape),
        ending=np.full(shape, int(Ending.ARRIVAL)),
        rewards=RewardPair(target, 0.0 * target),
        initial=np.ones(1),
    )
    demonstrated = (1 - DISCOUNT) * np.array([shares])
    return Problem(mdp, demonstrated, target, discount=DISCOUNT, **numbers)


def random_world(seed: int, n_states: int = 6, n_actions: int = 3) -> TabularMDP:
    rng = np.random.default_rng(seed)
    shape = (n_states, n_actions, 2)
    return TabularMDP(
        successor=rng.integers(n_states, size=shape),
        probability=rng.dirichlet(np.ones(2), shape[:2]),
        ending=np.where(rng.random(shape) < 0.15, Ending.ARRIVAL, Ending.NONE),
        rewards=RewardPair(rng.normal(size=shape[:2]), rng.normal(size=shape[:2])),
        initial=rng.dirichlet(np.ones(n_states)),
    )


def random_pool(seed: int, n_actions: int = 3) -> list[np.ndarray]:
    """Three demonstrators, none of which takes the last action of state 0."""
    rng = np.random.default_rng(1000 + seed)
    policies = [rng.dirichlet(np.full(n_actions, 0.7), 6) for _ in range(3)]
    for policy in policies:
        policy[0, -1] = 0.0
        policy[0] /= policy[0].sum()
    return policies


def random_problem(seed: int, kind: str = "instantaneous", **numbers: Any) -> Problem:
    mdp, policies = random_world(seed), random_pool(seed)
    parts = occupancies(mdp, policies, [0.5, 0.3, 0.2], DISCOUNT)
    target = mean_target(mdp, policies, parts, mdp.rewards.env, kind, DISCOUNT)
    return Problem(mdp, parts.sum(axis=0), target, discount=DISCOUNT, **numbers)


@pytest.fixture(name="bandit")
def bandit_fixture():
    return bandit


@pytest.fixture(name="random_world")
def random_world_fixture():
    return random_world


@pytest.fixture(name="random_pool")
def random_pool_fixture():
    return random_pool


@pytest.fixture(name="random_problem")
def random_problem_fixture():
    return random_problem
