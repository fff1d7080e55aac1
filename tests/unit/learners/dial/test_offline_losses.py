"""Losses of the offline dial, by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.dial.config import OfflineDialConfig
from socialiq.learners.dial.offline_losses import (
    Critic,
    Rows,
    behaviour_loss,
    critic_loss,
    critic_target,
    dial_loss,
    price,
    regularised_policy,
)
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import QNetwork
from socialiq.types import RewardPair

UNIT = jnp.array([2.0, 1.0])
ALONG_BOTH = RewardPair(jnp.array([0.6]), jnp.array([0.8]))


def constant(values: list[list[float]]) -> Critic:
    """An ensemble whose members tell these pairs, in units of reward, of each action."""
    static = OfflineDialConfig(view="flat", hidden=(), members=len(values))
    drawn = Critic.ensemble(jax.random.key(0), (1, 2), static)
    biases = jnp.array(values).reshape(len(values), 2, 2) / UNIT
    leaves = [jnp.zeros_like(jax.tree.leaves(drawn)[0]), biases.reshape(len(values), 4)]
    return jax.tree.unflatten(jax.tree.structure(drawn), leaves)


def one_row(*, ended: bool = False, action: int = 0) -> Rows:
    """A row with β = (3/4, 1/4), and rewards (1, 2)."""
    log_behaviour = jnp.log(jnp.array([[0.75, 0.25]]))
    one = jnp.ones((1, 1))
    return Rows(
        one,
        jnp.array([action]),
        one,
        jnp.array([ended]),
        jnp.array([[1.0, 2.0]]),
        jnp.zeros(1),
        jnp.full(1, 0.5),
        log_behaviour,
        log_behaviour,
    )


def test_the_regularised_policy_by_hand():
    """β = (3/4, 1/4), Q = (0, η ln 6): weights 3/4 and 6/4, so (1/3, 2/3)."""
    found = regularised_policy(jnp.log(jnp.array([0.75, 0.25])), jnp.array([0.0, np.log(6)]), 1.0)
    np.testing.assert_allclose(found, [1 / 3, 2 / 3], rtol=1e-5)


def test_the_regularised_policy_maximises_its_objective():
    """E_π[Q] - η KL(π, β) is largest at π, on a fine grid of policies over two actions."""
    behaviour, value, temperature = np.array([0.9, 0.1]), np.array([0.2, 1.0]), 0.4
    share = np.linspace(0.001, 0.999, 999)
    grid = np.stack([share, 1 - share], axis=1)
    price = (grid * np.log(grid / behaviour)).sum(axis=1)
    best = grid[(grid @ value - temperature * price).argmax()]
    found = regularised_policy(jnp.log(jnp.asarray(behaviour)), jnp.asarray(value), temperature)
    np.testing.assert_allclose(found, best, atol=1e-3)


def test_the_price_by_hand():
    """0.3 to 15 degrees and from 75 on, 0.1 from 30 to 60, and half-way between their sines."""
    half = np.rad2deg(np.arcsin((0.5 + np.sqrt(0.75)) / 2)) / 2
    angles = [-5.0, 0.0, 15.0, half, 30.0, 45.0, 60.0, 90.0 - half, 75.0, 90.0, 95.0]
    radians = jnp.deg2rad(jnp.array(angles))
    found = price(RewardPair(jnp.cos(radians), jnp.sin(radians)), 0.1, 0.3)
    wanted = [0.3, 0.3, 0.3, 0.2, 0.1, 0.1, 0.1, 0.2, 0.3, 0.3, 0.3]
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_an_action_that_no_driver_takes_has_no_weight():
    found = regularised_policy(jnp.array([0.0, -80.0]), jnp.array([0.0, 5.0]), 0.1)
    np.testing.assert_allclose(found, [1.0, 0.0], atol=1e-6)


def test_targets_by_hand():
    """Members (0, 0; 1, 3) and (0, 0; 3, 1): mean (0, 0; 2, 2), scored 2.8 at cos 0.6, sin 0.8.

    With η = 2.8 / ln 3 both actions weigh 3/4, so π = (1/2, 1/2) and E_π Q = (1, 1).
    """
    critics = constant([[0, 0, 1, 3], [0, 0, 3, 1]])
    given = (ALONG_BOTH, UNIT, 2.8 / np.log(3), 0.5)
    np.testing.assert_allclose(critic_target(critics, one_row(), *given), [[1.5, 2.5]], rtol=1e-5)
    ended = critic_target(critics, one_row(ended=True), *given)
    np.testing.assert_allclose(ended, [[1.0, 2.0]], rtol=1e-5)


@pytest.mark.parametrize(("action", "loss"), [(0, 0.0), (1, 2 * 1.0 + 2 * 9.0)])
def test_the_critics_loss_by_hand(action, loss):
    """Target (1, 2). Action 0 is told exactly; action 1 as (3, 5), one unit of 2 and three of 1."""
    critics = constant([[1, 2, 3, 5], [1, 2, 3, 5]])
    row = one_row(action=action)
    found = critic_loss(critics, jnp.array([[1.0, 2.0]]), row, ALONG_BOTH, UNIT)
    assert float(found) == pytest.approx(loss, rel=1e-5)


def test_the_dials_best_policy_is_the_regularised_one():
    """At its logits the loss is -log Σ β exp((Q - max Q) / η), and elsewhere larger.

    Q = (0, 2.8) with η = 2.8 / ln 3 weighs (3/4 / 3, 1/4), so π is (1/2, 1/2) and the sum 1/2.
    """
    critics, row = constant([[0, 0, 2, 2]]), one_row()
    drawn = DialNetwork.initialise(jax.random.key(0), 1, (), 2)
    temperature = 2.8 / np.log(3)

    def loss(*logits: float) -> float:
        leaves = [jnp.zeros((2, 3)), jnp.array(logits)]
        network = jax.tree.unflatten(jax.tree.structure(drawn), leaves)
        return float(dial_loss(network, critics, row, ALONG_BOTH, UNIT, temperature))

    assert loss(0.0, 0.0) == pytest.approx(np.log(2), rel=1e-5)
    assert loss(0.0, 0.5) > np.log(2) < loss(0.5, 0.0)


def test_the_behaviour_loss_by_hand():
    drawn = QNetwork.initialise(jax.random.key(0), 1, (), 2)
    leaves = [jnp.zeros((2, 1)), jnp.array([0.0, np.log(3)])]
    network = jax.tree.unflatten(jax.tree.structure(drawn), leaves)
    assert float(behaviour_loss(network, one_row(action=0))) == pytest.approx(np.log(4), rel=1e-5)
