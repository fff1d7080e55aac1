import numpy as np
import pytest

from socialiq.worlds.enumerate import Table


@pytest.fixture(scope="session")
def always():
    """The policy that takes one action everywhere."""

    def make(table: Table, action: int) -> np.ndarray:
        return np.eye(table.mdp.n_actions)[np.full(table.mdp.n_states, action)]

    return make


@pytest.fixture(scope="session")
def random_policy():
    """Action probabilities drawn at random for every state, the first action's the largest.

    It stops the ego, so some episodes run out of time.
    """

    def make(table: Table, seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        concentration = [5.0] + [1.0] * (table.mdp.n_actions - 1)
        return rng.dirichlet(concentration, table.mdp.n_states)

    return make
