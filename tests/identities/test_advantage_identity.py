"""Shaping invariance: with a table and the full gradient, advantages and rewards are one target."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import softmax

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.objective import Batches, objective
from socialiq.learners.state import stack
from socialiq.nn.q_network import QNetwork
from socialiq.social.angle import exact_weights, score
from socialiq.types import RewardPair

N_STATES, N_ACTIONS = 4, 3
NUMBERS = IQLearnHyperparameters(
    angle=30.0, strength=0.8, prior_weight=0.7, temperature=0.6, discount=0.9
)
SHRINKAGE = NUMBERS.prior_weight / (1 / (4 * NUMBERS.chi2_alpha) + NUMBERS.prior_weight)


def wandering(seed: int, rows: int = 240) -> Demonstrations:
    """Random walk over one-hot states; episodes end at random, with every kind of ending."""
    rng = np.random.default_rng(seed)
    state = rng.integers(N_STATES, size=rows)
    action = rng.integers(N_ACTIONS, size=rows)
    ended = rng.random(rows) < 0.2
    ended[-1] = True
    ending = np.where(ended, rng.integers(1, 5, rows), 0).astype(np.int8)
    episode = np.concatenate([[0], np.cumsum(ended)[:-1]]).astype(np.int32)
    after = np.where(ended, rng.integers(N_STATES, size=rows), np.roll(state, -1))
    one_hot = np.eye(N_STATES, dtype=np.float32)
    return Demonstrations.of(
        observation=one_hot[state],
        action=action,
        next_observation=one_hot[after],
        ending=ending,
        rewards=RewardPair(rng.normal(size=rows) + action, rng.normal(size=rows) - action),
        episode=episode,
        n_actions=N_ACTIONS,
    )


class Problem:
    """All rows of one set as a batch, those of another as replay, and a table of Q."""

    def __init__(self, seed: int, **choices: Any) -> None:
        self.data, self.replay = wandering(seed), wandering(seed + 100)
        offline = {"online": False, "value_term": "value_expert", "next_value": "online"}
        size = self.data.n_transitions
        self.static = IQLearnConfig(**{"hidden": (), "batch_size": size, **offline, **choices})
        self.hyperparameters = stack([NUMBERS])[0]

    def loss(self, kind: str):
        """The loss as a function of a flat table of Q, with its gradient."""
        rows = columns(self.data, self.data.returns(kind, NUMBERS.discount))
        replay = columns(self.replay, self.replay.rewards) if self.static.online else None
        batches = Batches(rows, replay, None)

        @jax.jit
        @jax.value_and_grad
        def loss(flat: jax.Array) -> jax.Array:
            table = network(flat.reshape(N_STATES, N_ACTIONS))
            return objective(table, table, batches, self.hyperparameters, self.static)[0]

        return loss

    def value(self) -> np.ndarray:
        """Mean return-to-go of each state, scored at the angle."""
        to_go = score(exact_weights(NUMBERS.angle), self.data.returns("to_go", NUMBERS.discount))
        state = self.data.observation.argmax(axis=1)
        return np.array([to_go[state == one].mean() for one in range(N_STATES)])


def columns(data: Demonstrations, target: RewardPair) -> Batch:
    """All rows of a set."""
    ending = data.ending.astype(int)
    rows = Batch(data.observation, data.action, data.next_observation, ending, target)
    return jax.tree.map(jnp.asarray, rows)


def network(q: jax.Array) -> QNetwork:
    """A linear network on one-hot states whose values are this table."""
    drawn = QNetwork.initialise(jax.random.key(0), N_STATES, (), N_ACTIONS)
    return jax.tree.unflatten(jax.tree.structure(drawn), [q.T, jnp.zeros(N_ACTIONS)])


@pytest.fixture(autouse=True)
def double_precision():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("next_value", ["online", "target"])
@pytest.mark.parametrize(
    "rows", [{}, {"online": True, "value_term": "value"}], ids=["offline", "online"]
)
def test_the_loss_of_the_advantage_is_that_of_the_reward_at_a_shifted_table(next_value, rows):
    """Q - (w λ / κ) V in every state: the same gradient, and a loss that differs by a constant."""
    problem, rng = Problem(1, next_value=next_value, **rows), np.random.default_rng(1)
    shift = SHRINKAGE * NUMBERS.strength * problem.value()[:, None]
    steps, advantages = problem.loss("instantaneous"), problem.loss("advantage")
    differences = []
    for _ in range(3):
        q = rng.normal(size=(N_STATES, N_ACTIONS))
        one, slope = steps(jnp.asarray(q.ravel()))
        other, its_slope = advantages(jnp.asarray((q - shift).ravel()))
        np.testing.assert_allclose(slope, its_slope, rtol=1e-6, atol=1e-8)
        differences.append(float(other - one))
    assert np.ptp(differences) < 1e-7
    assert np.abs(shift).max() > 0.1


def test_advantage_and_reward_give_one_policy_and_returns_to_go_another():
    problem, policies = Problem(0), {}
    for kind in ("instantaneous", "advantage", "to_go"):
        loss = problem.loss(kind)

        def in_numpy(flat: np.ndarray, loss=loss) -> tuple[float, np.ndarray]:
            value, slope = loss(jnp.asarray(flat))
            return float(value), np.asarray(slope)

        found = minimize(in_numpy, np.zeros(N_STATES * N_ACTIONS), jac=True, tol=1e-12)
        table = found.x.reshape(N_STATES, N_ACTIONS)
        policies[kind] = softmax(table / NUMBERS.temperature, axis=1)
    np.testing.assert_allclose(policies["advantage"], policies["instantaneous"], atol=1e-5)
    assert np.abs(policies["to_go"] - policies["instantaneous"]).max() > 0.01
