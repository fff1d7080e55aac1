"""Policy iteration near a clone, where the price at which it leaves the clone is known."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.dial.rows import stratified_angles
from socialiq.learners.policy_iteration.config import Hyperparameters
from socialiq.learners.policy_iteration.dial import StaticConfig, train
from socialiq.learners.policy_iteration.regularised import Likeness, RegularisedIteration
from socialiq.learners.policy_iteration.train import Labelled
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import RewardPair

SMALL = StaticConfig(
    hidden=(16,), batch_size=64, updates=200, states_per_update=4, replay_capacity=2_000
)
NUMBERS = Hyperparameters(
    learning_rate=2e-2,
    final_learning_rate=1e-3,
    polyak=0.05,
    temperature=1.0,
    regression=0.0,
    seed=1,
)


def clone(chances: tuple[float, ...]) -> DialPolicy:
    """A clone that has these chances of the actions in every state."""
    network = DialNetwork.initialise(jax.random.key(0), 1, (16,), 3)
    last = [network.layers[-1].weight * 0.0, jnp.log(jnp.array(chances))]
    network = eqx.tree_at(lambda n: [n.layers[-1].weight, n.layers[-1].bias], network, last)
    return DialPolicy.of(network, 1.0, 0.0, 90.0, {})


@pytest.mark.parametrize("angle", [0.0, 60.0])
def test_likeness_is_the_price_of_the_log_ratio_along_the_angle(angle):
    likeness = Likeness(clone((0.2, 0.8, 1e-9)), 0.5, arbitrary=0.03)
    found = likeness(np.array([[1.0, angle]], np.float32))
    wanted = 0.5 * np.log(np.array([0.204, 0.786, 0.01]) / 0.786)
    np.testing.assert_allclose(found.env[0], np.cos(np.deg2rad(angle)) * wanted, atol=1e-5)
    np.testing.assert_allclose(found.social[0], np.sin(np.deg2rad(angle)) * wanted, atol=1e-5)


@pytest.mark.parametrize(("price", "best"), [(0.6, 0), (0.9, 1)])
def test_a_clone_is_left_where_the_reward_is_worth_more_than_the_likelihood(price, best):
    """Action 0 has a reward of 1, and is less likely by log 4 = 1.39 nats: worth 1 at 0.72."""
    start = clone((0.2, 0.8, 1e-9))
    likeness = Likeness(start, price, arbitrary=0.0)

    def label(_follow, _visit, rng):
        angles = np.minimum(stratified_angles(SMALL, 400, rng), 0.0)
        seen = np.column_stack([np.ones(400), angles]).astype(np.float32)
        env, social = likeness(seen)
        return Labelled(seen, RewardPair(env + np.array([1.0, 0.0, 0.0]), social))

    kind = RegularisedIteration
    made = train(SMALL, [NUMBERS], [label], (1, 3), chunk=100, start=start, kind=kind).policy(0)
    assert made.provenance["learner"] == "regularised-dial-iteration"
    assert int(made.at(0.0).predict(np.ones(1))[0]) == best
