"""The advantage as a target of a table of demonstrations."""

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.nn import regression
from socialiq.nn.regression import cross_fitted
from socialiq.types import RewardPair

Make = Callable[..., Demonstrations]


@pytest.fixture(name="table")
def three_rows(make):
    """A -> B -> end and A -> end, with rewards (1, 4) and (5); r_social is twice r_env."""
    observation = np.array([[0, 1], [1, 0], [0, 1]], np.float32)
    env = np.array([1.0, 4.0, 5.0])
    return dataclasses.replace(
        make([2, 1]), observation=observation, rewards=RewardPair(env, 2 * env)
    )


def test_both_rewards_by_hand(table):
    """At discount 1/2: G = 3, 4, 5; V = 4, 4, 4; A = 1 + 4/2 - 4, 4 - 4, 5 - 4."""
    found = table.returns("advantage", 0.5)
    np.testing.assert_array_equal(found.env, [-1.0, 0.0, 1.0])
    np.testing.assert_array_equal(found.social, [-2.0, 0.0, 2.0])


def test_what_is_given_is_the_callers_own(table):
    table.returns("advantage", 0.5).env[:] = 99.0
    np.testing.assert_array_equal(table.returns("advantage", 0.5).env, [-1.0, 0.0, 1.0])
    np.testing.assert_array_equal(table.returns("advantage", 0.0).env, [1 - 3, 0.0, 5 - 3])


def test_states_that_never_repeat(make):
    with pytest.raises(UserError, match="advantage_fitted"):
        make([3, 2]).returns("advantage", 0.9)


def test_a_network_finds_nearly_what_the_table_gives(make, monkeypatch):
    """Four states that pay by chance; the network sees them as numbers that differ in each row."""
    monkeypatch.setattr(regression, "cross_fitted", partial(cross_fitted, steps=500))
    rng = np.random.default_rng(0)
    state = rng.integers(4, size=900)
    pays = state + rng.normal(size=900)
    exact = np.stack([state, 0 * state], axis=1).astype(np.float32)
    blurred = exact + rng.normal(scale=0.01, size=(900, 2)).astype(np.float32)
    table = dataclasses.replace(make([3] * 300), rewards=RewardPair(pays, -pays))
    wanted = dataclasses.replace(table, observation=exact).returns("advantage", 0.9)
    found = dataclasses.replace(table, observation=blurred).returns("advantage_fitted", 0.9)
    for one, other in zip(wanted, found, strict=True):
        assert np.sqrt(np.mean((one - other) ** 2)) < 0.4 * one.std()


def test_a_fit_is_made_once(table, monkeypatch):
    calls = []

    def counted(*_: object) -> np.ndarray:
        calls.append("fit")
        return np.zeros((3, 2))

    monkeypatch.setattr(regression, "cross_fitted", counted)
    for _ in range(2):
        table.returns("advantage_fitted", 0.9)
    assert calls == ["fit"]


def test_gaps_are_refused(table):
    with pytest.raises(UserError, match="misses steps"):
        table.subsample(2).returns("advantage", 0.9)
