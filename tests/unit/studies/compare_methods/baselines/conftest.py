"""Networks that give the same numbers in every state, and rows of one state."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.unit.learners.conftest import demonstrations_fixture

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.expert_table import Batch
from socialiq.nn.q_network import QNetwork
from socialiq.types import Ending, RewardPair


def constant(*values: float) -> QNetwork:
    """A network that gives these values in every state."""
    drawn = QNetwork.initialise(jax.random.key(0), 1, (), len(values))
    leaves = [jnp.zeros((len(values), 1)), jnp.array(values)]
    return jax.tree.unflatten(jax.tree.structure(drawn), leaves)


def rows_of(
    actions: Sequence[int], social: Sequence[float], ending: Ending = Ending.ARRIVAL
) -> Batch:
    """Rows of one state; r_social is R at 90 degrees."""
    count = len(actions)
    one = jnp.ones((count, 1))
    pair = RewardPair(jnp.zeros(count), jnp.array(social, jnp.float32))
    return Batch(one, jnp.array(actions), one, jnp.full(count, int(ending)), pair)


def bandit(actions: Sequence[int], env: Sequence[float], social: Sequence[float]) -> Demonstrations:
    """Episodes of one step in one state."""
    count = len(actions)
    one = np.ones((count, 1), np.float32)
    return Demonstrations.of(
        observation=one,
        action=actions,
        next_observation=one,
        ending=np.full(count, int(Ending.ARRIVAL)),
        rewards=RewardPair(np.array(env, float), np.array(social, float)),
        episode=np.arange(count),
        n_actions=2,
    )


@pytest.fixture(name="constant", scope="session")
def constant_fixture():
    return constant


@pytest.fixture(name="rows_of", scope="session")
def rows_fixture():
    return rows_of


@pytest.fixture(name="bandit", scope="session")
def bandit_fixture():
    return bandit


__all__ = ["demonstrations_fixture"]  # a fixture of the learners' tests
