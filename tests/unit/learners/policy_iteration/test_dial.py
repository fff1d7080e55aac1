"""Direct policy iteration of a dial on problems with known values."""

import dataclasses

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.branching import Branching
from socialiq.learners.dial.rows import stratified_angles
from socialiq.learners.policy_iteration.dial import (
    DialIteration,
    DialIterationConfig,
    greedy,
    train,
)
from socialiq.learners.policy_iteration.train import IterationHyperparameters, Labelled
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import RewardPair
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Batch

SMALL = DialIterationConfig(
    hidden=(32,), batch_size=64, updates=600, states_per_update=4, replay_capacity=2_000, knots=5
)
NUMBERS = IterationHyperparameters(
    learning_rate=1e-2, final_learning_rate=1e-3, polyak=0.05, temperature=0.3, seed=1
)


def choice(_follow, _visit, rng):
    """One state: action 0 gives (3, 0), action 1 gives (0, 3), and 2 gives (2, 2) on average."""
    count = 400
    angles = stratified_angles(SMALL, count, rng)
    seen = np.column_stack([np.ones(count), angles]).astype(np.float32)
    coin, nothing = rng.choice([0.0, 4.0], size=count), np.zeros(count)
    env = np.stack([nothing + 3.0, nothing, coin], axis=1)
    social = np.stack([nothing, nothing + 3.0, coin], axis=1)
    return Labelled(seen, RewardPair(env, social))


def made(**changes):
    numbers = dataclasses.replace(NUMBERS, **changes)
    return train(SMALL, [numbers], [choice], (1, 3), chunk=100).policy(0)


@pytest.mark.parametrize("regression", [0.6, 1.0])
def test_each_angle_has_its_own_best_action(regression):
    """(3, 0), (0, 3) and (2, 2) are the best scores below 26.6, above 63.4, and between."""
    dial, angles = made(regression=regression), (0.0, 15.0, 35.0, 55.0, 75.0, 90.0)
    actions = [int(dial.at(angle).predict(np.ones(1))[0]) for angle in angles]
    assert actions == [0, 0, 2, 2, 1, 1]


def test_regression_learns_the_returns_of_both_rewards():
    dial = made(regression=1.0)
    for angle in (5.0, 45.0, 85.0):
        env, social = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
        wanted = [3 * env, 3 * social, 2 * env + 2 * social]
        q = dial.at(angle).q_values(np.ones((1, 1)))[0]
        np.testing.assert_allclose(q, wanted, atol=0.5)


def test_fast_greedy_actions_are_those_of_the_dial_at_each_angle():
    static = DialIterationConfig(view="set", times=20, hidden=(16,), knots=5)
    batch = Batch(Options(), 30)
    sizes = (batch.observation.shape[1] + 1, 3)
    network = DialIteration(static, sizes).network(jax.random.key(0))
    dial = DialPolicy.of(network, 1.0, 0.0, 90.0, {})
    batch.reset(np.arange(30, dtype=np.uint64))
    seen = np.column_stack([batch.observation, batch.time])
    angles = np.repeat([0.0, 40.0, 90.0], 10)
    acted = greedy(dial)(np.column_stack([seen, angles]).astype(np.float32))
    wanted = [
        dial.at(angle).predict(row)[0] for angle, row in zip(angles.tolist(), seen, strict=True)
    ]
    assert acted.tolist() == [int(one) for one in wanted]
    assert len(set(acted.tolist())) > 1


def test_copies_are_driven_at_the_angle_of_their_episode():
    seen = []

    def follow(observation):
        seen.append(observation)
        return np.zeros(len(observation), int)

    def angles(count, _rng):
        return np.linspace(0.0, 90.0, count)

    labelled = Branching(Options(), 8, 4, True, angles)(follow, follow, np.random.default_rng(0))
    np.testing.assert_allclose(labelled.observation[:, -1], np.tile([0.0, 30.0, 60.0, 90.0], 2))
    np.testing.assert_array_equal(labelled.observation[:, -2], np.repeat([0.0, 1.0], 4))
    ahead = [rows for rows in seen if len(rows) > 4]
    assert ahead and all(set(rows[:, -1]) <= {0.0, 30.0, 60.0, 90.0} for rows in ahead)


def test_a_run_begins_with_the_dial_that_it_improves():
    start = made()
    numbers = dataclasses.replace(NUMBERS, learning_rate=1e-9, final_learning_rate=1e-9)
    again = train(SMALL, [numbers], [choice], (1, 3), chunk=100, start=start).policy(0)
    seen = np.ones((1, 1))
    np.testing.assert_allclose(
        again.at(45.0).q_values(seen), start.at(45.0).q_values(seen), atol=1e-4
    )
    other = dataclasses.replace(SMALL, hidden=(8,))
    with pytest.raises(UserError, match="another network"):
        train(other, [numbers], [choice], (1, 3), start=start)
