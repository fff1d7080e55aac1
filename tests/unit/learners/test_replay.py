import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.expert_table import Batch, Replay
from socialiq.types import RewardPair

CAPACITY = 5


def transitions(first: int, count: int) -> Batch:
    """Rows numbered from `first`; every column is a function of the number."""
    number = jnp.arange(first, first + count)
    real = number.astype(jnp.float32)
    pair = RewardPair(real / 2, -real)
    return Batch(real[:, None] * jnp.ones(2), number, real[:, None] + jnp.ones(2), number % 5, pair)


def filled(count: int) -> Replay:
    ring = Replay.empty(CAPACITY, Batch.empty(2))
    for number in range(count):
        ring = Replay.add(ring, jax.tree.map(lambda column: column[0], transitions(number, 1)))
    return ring


def test_an_empty_ring_has_room_and_nothing_added():
    ring = Replay.empty(CAPACITY, Batch.empty(2))
    assert ring.columns.observation.shape == (CAPACITY, 2)
    assert ring.added == 0


@pytest.mark.parametrize(
    ("count", "numbers"), [(3, [0, 1, 2, 0, 0]), (5, [0, 1, 2, 3, 4]), (7, [5, 6, 2, 3, 4])]
)
def test_a_full_ring_forgets_the_oldest(count, numbers):
    ring = filled(count)
    assert ring.added == count
    assert ring.columns.action.tolist() == numbers
    if count >= CAPACITY:
        assert ring.columns.target.social.tolist() == [-number for number in numbers]
        assert ring.columns.ending.tolist() == [number % 5 for number in numbers]


@pytest.mark.parametrize("before", [0, 3, 9])
@pytest.mark.parametrize("count", [1, 4, 5, 8, 13])
def test_adding_many_is_adding_one_by_one(assert_same, before, count):
    """Also more than the ring holds: the newest stay."""
    together = Replay.add_many(filled(before), transitions(before, count))
    assert_same(together, filled(before + count))


def test_sampling_draws_evenly_and_only_what_was_added():
    drawn = Replay.sample(filled(3), jax.random.key(0), 3000)
    np.testing.assert_allclose(np.bincount(drawn.action) / 3000, [1 / 3] * 3, atol=0.04)
    drawn = Replay.sample(filled(7), jax.random.key(0), 500)
    assert set(drawn.action.tolist()) == {2, 3, 4, 5, 6}
    np.testing.assert_array_equal(drawn.target.env, drawn.action / 2)
