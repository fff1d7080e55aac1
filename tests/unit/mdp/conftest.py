import numpy as np
import pytest

from socialiq.mdp.tabular import TabularMDP
from socialiq.types import Ending, RewardPair


def random_mdp(
    rng: np.random.Generator,
    n_states: int,
    n_actions: int,
    n_outcomes: int,
    ending_probability: float,
) -> TabularMDP:
    shape = (n_states, n_actions, n_outcomes)
    kinds = rng.choice([Ending.ARRIVAL, Ending.COLLISION, Ending.OTHER], shape)
    return TabularMDP(
        successor=rng.integers(n_states, size=shape),
        probability=rng.dirichlet(np.ones(n_outcomes), shape[:2]),
        ending=np.where(rng.random(shape) < ending_probability, kinds, Ending.NONE),
        rewards=RewardPair(rng.normal(size=shape[:2]), rng.normal(size=shape[:2])),
        initial=rng.dirichlet(np.ones(n_states)),
    )


def random_policy(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.dirichlet(np.ones(shape[-1]), shape[:-1])


def small_road() -> TabularMDP:
    """Three states in a row, the last never visited; action 0 waits, action 1 goes.

    Waiting in 0 costs the ego 1 and pays the neighbour 2. Going from 0 leads to 1 (.75) or to a
    collision (.25) that costs 4. In 1 both actions arrive, going for 10, waiting for 9.
    """
    go, arrival, collision = Ending.NONE, Ending.ARRIVAL, Ending.COLLISION
    return TabularMDP(
        successor=np.array([[[0, 0], [1, 2]], [[1, 2], [1, 2]], [[0, 1], [2, 2]]]),
        probability=np.array([[[1.0, 0], [0.75, 0.25]], [[1.0, 0], [1.0, 0]], [[0.5, 0.5]] * 2]),
        ending=np.array([[[go, go], [go, collision]], [[arrival, go]] * 2, [[go, go]] * 2]),
        rewards=RewardPair(
            env=np.array([[-1.0, -1.0], [9.0, 10.0], [0.0, 0.0]]),
            social=np.array([[2.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        ),
        initial=np.array([1.0, 0.0, 0.0]),
    )


@pytest.fixture(name="small_road")
def small_road_fixture():
    return small_road()


@pytest.fixture(name="random_mdp")
def random_mdp_fixture():
    return random_mdp


@pytest.fixture(name="random_policy")
def random_policy_fixture():
    return random_policy
