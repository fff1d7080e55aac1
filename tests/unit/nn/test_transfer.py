"""Transfer of a dial's network: the same values by the action's name."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.dial_network import DialNetwork, transferred
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair

OLD, NEW = ("slower", "idle", "faster"), ("lane_left", "idle", "lane_right", "faster", "slower")


def drawn(view="set", pairs=False, times=0):
    return DialNetwork.initialise(
        jax.random.key(0), 35 + bool(times), (8,), 3, view=view, times=times, pairs=pairs
    )


@pytest.mark.parametrize("pairs", [False, True])
def test_an_action_keeps_its_value_and_a_new_one_is_never_the_best(pairs):
    before = drawn(pairs=pairs)
    after = transferred(before, OLD, NEW, "idle", 3)
    seen = np.random.default_rng(0).uniform(-1, 1, 35).astype(np.float32)
    seen[::7] = [1, 1, 1, 0, 0]  # the last two rows are empty
    seen = jnp.asarray(seen)
    for angle in (0.0, 45.0, 90.0):
        direction = RewardPair(*map(jnp.float32, exact_weights(angle)))
        old = np.asarray(before(seen, direction))
        new = np.asarray(after(seen[:21], direction))
        np.testing.assert_allclose(new[[4, 1, 3]], old, rtol=1e-5, atol=1e-6)
        assert (new[[0, 2]] < new[1]).all()


def test_only_sets_without_the_time_are_transferred():
    for network in (drawn("flat"), drawn(times=5)):
        with pytest.raises(UserError, match="set of vehicles without the time"):
            transferred(network, OLD, NEW, "idle", 5)
    with pytest.raises(UserError, match="'brake'"):
        transferred(drawn(), OLD, NEW, "brake", 5)
