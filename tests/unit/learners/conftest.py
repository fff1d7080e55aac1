from typing import Any

import jax
import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.types import Ending, RewardPair


def demonstrations(
    seed: int = 0, episodes: int = 5, length: int = 8, n_features: int = 6, n_actions: int = 3
) -> Demonstrations:
    """Random episodes of integer observations; row i observes i as its first feature."""
    rng = np.random.default_rng(seed)
    rows = episodes * length
    observation = rng.integers(0, 3, (rows, n_features)).astype(np.float32)
    observation[:, 0] = np.arange(rows)
    ending = np.zeros((episodes, length), np.int8)
    ending[:, -1] = [
        (Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT)[i % 3] for i in range(episodes)
    ]
    ending = ending.ravel()
    return Demonstrations(
        observation=observation,
        action=rng.integers(0, n_actions, rows).astype(np.int32),
        next_observation=np.roll(observation, -1, axis=0),
        terminated=(ending != Ending.NONE) & (ending != Ending.TIMEOUT),
        truncated=ending == Ending.TIMEOUT,
        ending=ending,
        rewards=RewardPair(rng.normal(size=rows), rng.normal(size=rows)),
        mode=np.zeros(rows, np.int8),
        episode=np.repeat(np.arange(episodes, dtype=np.int32), length),
        step=np.tile(np.arange(length, dtype=np.int32), episodes),
        mode_names=("random",),
        n_actions=n_actions,
        source={},
    )


@pytest.fixture(scope="session", name="demonstrations")
def demonstrations_fixture():
    return demonstrations


@pytest.fixture(scope="session")
def data():
    """Random demonstrations that no test may change."""
    return demonstrations()


def assert_same(one: Any, other: Any) -> None:
    """Equal trees, bit for bit."""
    leaves, others = jax.tree.leaves(one), jax.tree.leaves(other)
    assert len(leaves) == len(others) > 0
    for a, b in zip(leaves, others, strict=True):
        if jax.numpy.issubdtype(a.dtype, jax.dtypes.prng_key):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        np.testing.assert_array_equal(a, b, strict=True)


@pytest.fixture(scope="session", name="assert_same")
def assert_same_fixture():
    return assert_same
