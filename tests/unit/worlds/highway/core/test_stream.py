"""The compiled random stream equals that of numpy's Generator."""

import numba
import numpy as np
import pytest

from socialiq.worlds.highway.core import splitmix, stream
from socialiq.worlds.highway.options import EPISODE

SEEDS = (0, 1, 5302, 2**31, 2**40 + 7, 2**63)
LARGEST = (0, 1, 2, 3, 6, 1000, 2**31, 3 * 2**30)  # the last two refuse many draws
UNIFORM, NORMAL, PAIR = -1, -2, -3  # other kinds are a place in LARGEST
TAIL = 3.654152885361009


@numba.njit
def draws(episode, seed, kinds, largest, first, second):
    stream.seed(episode[0], seed)
    for number in range(len(kinds)):
        if kinds[number] == UNIFORM:
            first[number] = stream.uniform(episode[0])
        elif kinds[number] == NORMAL:
            first[number] = stream.normal(episode[0])
        elif kinds[number] == PAIR:
            first[number], second[number] = stream.two_of(episode[0], 4)
        else:
            first[number] = stream.up_to(episode[0], largest[kinds[number]])


def drawn(seed, kinds):
    episode, found = np.zeros(1, EPISODE), np.zeros((2, len(kinds)))
    draws(episode, np.uint64(seed), kinds, np.array(LARGEST), *found)
    return found


def draw(generator, kind):
    if kind == UNIFORM:
        return generator.uniform(), 0
    if kind == NORMAL:
        return generator.normal(), 0
    if kind == PAIR:
        return tuple(generator.choice(4, 2, replace=False))
    return generator.integers(LARGEST[kind] + 1), 0


@pytest.mark.parametrize("seed", SEEDS)
def test_mixed_draws_are_numpys_to_the_last_bit(seed):
    kinds = np.random.default_rng(7).integers(PAIR, len(LARGEST), 20_000)
    generator = np.random.default_rng(seed)
    expected = np.array([draw(generator, kind) for kind in kinds], float).T
    np.testing.assert_array_equal(drawn(seed, kinds), expected)


def test_normal_draws_are_numpys_far_out_too():
    kinds = np.full(200_000, NORMAL)
    found = drawn(11, kinds)[0]
    np.testing.assert_array_equal(found, np.random.default_rng(11).normal(size=len(kinds)))
    assert (found > TAIL).sum() > 5 and (found < -TAIL).sum() > 5


def test_seeding_forgets_what_was_drawn_before():
    episode, kinds = np.zeros(1, EPISODE), np.array([2])  # leaves half a word
    found = np.zeros((3, 1))
    for one in found[:2]:
        draws(episode, np.uint64(3), kinds, np.array(LARGEST), one, found[2])
    assert found[0] == found[1] == np.random.default_rng(3).integers(3)


def test_splitmix_gives_the_published_numbers():
    """The first three of seed 1234567, as test vectors of other libraries have them."""
    words = np.uint64(1234567) + splitmix.GOLDEN * np.arange(3, dtype=np.uint64)
    numbers = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    assert splitmix.following(words).tolist() == numbers
