import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.dqn import losses

KINDS = jnp.arange(5)  # NONE, ARRIVAL, COLLISION, TIMEOUT, OTHER


def column(*values: float) -> jax.Array:
    return jnp.array(values, jnp.float32)


@pytest.mark.parametrize(("double", "expected"), [(False, [3, 7]), (True, [1, 7])])
def test_next_value_by_hand(double: bool, expected: list[float]) -> None:
    """The network would take actions 0 and 1, the target network actions 2 and 1."""
    target_network, fast = jnp.array([[1.0, 2, 3], [6, 7, 5]]), jnp.array([[9.0, 8, 0], [0, 4, 3]])
    np.testing.assert_array_equal(losses.next_value(target_network, fast, double), expected)


@pytest.mark.parametrize(
    ("through_timeouts", "expected"), [(True, [6, 1, 1, 21, 1]), (False, [6, 1, 1, 1, 1])]
)
def test_the_target_goes_on_where_nothing_ended(
    through_timeouts: bool, expected: list[float]
) -> None:
    """r = 1 and γ = 1/2; the states reached are worth 10, 20, 30, 40 and 50."""
    value, reward = column(10, 20, 30, 40, 50), jnp.ones(5)
    found = losses.bootstrapped_target(reward, value, KINDS, 0.5, through_timeouts)
    np.testing.assert_array_equal(found, expected)


def test_the_loss_is_square_near_the_target_and_straight_far_from_it() -> None:
    """Errors 0.5 and -3 cost 0.5 · 0.25 and 3 - 0.5."""
    q, action = jnp.array([[1.5, 99.0], [99.0, -3.0]]), jnp.array([0, 1])
    found = losses.td_loss(q, action, column(1, 0))
    assert found == pytest.approx((0.125 + 2.5) / 2)


def test_only_the_action_taken_is_moved_and_by_one_at_most() -> None:
    q, action = jnp.array([[1.5, 99.0], [99.0, -3.0]]), jnp.array([0, 1])
    gradient = jax.grad(losses.td_loss)(q, action, column(1, 0))
    np.testing.assert_allclose(gradient, [[0.5 / 2, 0], [0, -1 / 2]])
