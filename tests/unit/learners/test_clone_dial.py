"""Clones at every angle: shares by hand, and a state in which the mixture is known."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.clone_dial import CloneDial, Hyperparameters, StaticConfig, shares
from socialiq.types import Ending, RewardPair

SMALL = StaticConfig(
    view="flat", demonstrators=(0.0, 90.0), hidden=(32,), batch_size=128, updates=600
)


def acting(action: int, rows: int) -> Demonstrations:
    """Episodes of one step in one state, in which a demonstrator takes its action."""
    state, nothing = np.ones((rows, 1), np.float32), np.zeros(rows)
    return Demonstrations(
        observation=state,
        action=np.full(rows, action, np.int32),
        next_observation=state,
        terminated=np.ones(rows, bool),
        truncated=np.zeros(rows, bool),
        ending=np.full(rows, int(Ending.ARRIVAL), np.int8),
        rewards=RewardPair(nothing, nothing),
        mode=np.zeros(rows, np.int8),
        episode=np.arange(rows, dtype=np.int32),
        step=np.zeros(rows, np.int32),
        mode_names=("alike",),
        n_actions=3,
        source={},
    )


def test_a_share_is_whole_about_its_own_angle_and_falls_to_the_next_one():
    angles = jnp.array([-5.0, 0.0, 5.0, 22.5, 40.0, 45.0, 50.0, 57.0, 85.0, 95.0])
    found = shares(angles, (0.0, 45.0, 90.0), 5.0)
    first = [1.0, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    last = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 1.0, 1.0]
    np.testing.assert_allclose(found[:, 0], first, atol=1e-6)
    np.testing.assert_allclose(found[:, 2], last, atol=1e-6)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-6)


def test_one_demonstrator_is_shown_at_every_angle():
    np.testing.assert_allclose(shares(jnp.array([0.0, 90.0]), (45.0,), 5.0), 1.0)


def test_a_clone_is_each_demonstrator_at_its_angle_and_their_mixture_between():
    """One state, two drivers of one action each; their numbers of rows don't matter."""
    learner = CloneDial.of(SMALL, [acting(0, 100), acting(2, 400)])
    dial = learner.train([Hyperparameters(learning_rate=1e-2)]).policy(0)
    wanted = {0.0: (1.0, 0.0), 25.0: (0.75, 0.25), 45.0: (0.5, 0.5), 90.0: (0.0, 1.0)}
    for angle, (first, last) in wanted.items():
        logits = dial.at(angle).q_values(np.ones((1, 1)))[0]
        chances = np.exp(logits) / np.exp(logits).sum()
        np.testing.assert_allclose(chances[[0, 2]], (first, last), atol=0.1)


def test_angles_that_overlap_are_refused():
    for angles in ((), (45.0, 0.0), (0.0, 8.0)):
        with pytest.raises(UserError, match="rising order"):
            dataclasses.replace(SMALL, demonstrators=angles)
