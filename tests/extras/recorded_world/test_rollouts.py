"""Returns of every action by rollouts in copies: they are those of driving on."""

import numpy as np
import pytest

from socialiq.types import Ending
from socialiq_recordings.world.gym import JunctionBatch
from socialiq_recordings.world.practice import visit

SEEDS = np.arange(4) + 50_000_000


def go(observation: np.ndarray) -> np.ndarray:
    return np.full(len(observation), 5)


def wait(observation: np.ndarray) -> np.ndarray:
    return np.zeros(len(observation), np.int64)


@pytest.mark.parametrize("policy", [go, wait])
def test_an_action_is_worth_what_driving_on_earns(world, policy):
    visited, driven = visit(JunctionBatch(world, 4), policy, SEEDS), JunctionBatch(world, 4)
    np.testing.assert_array_equal(visited.observation[:4], driven.reset(SEEDS))
    for first in (0, 5):
        driven.reset(SEEDS)
        action, running = np.full(4, first), np.ones(4, bool)
        total, fault = np.zeros((4, 2)), np.zeros(4, bool)
        while running.any():
            made = driven.step(action, auto_reset=False, rows=running)
            total[running] += np.column_stack(made.rewards)[running]
            fault |= running & (made.ending == Ending.COLLISION) & (made.contact == 1)
            running &= made.ending == Ending.NONE
            action = policy(driven.observation)
        np.testing.assert_allclose(visited.returns[:4, first], total, atol=1e-12)
        np.testing.assert_array_equal(visited.at_fault[:4, first], fault)


def test_every_visited_state_is_branched(world):
    found = visit(JunctionBatch(world, 4), wait, SEEDS)
    assert len(found.observation) == len(found.time) == len(found.returns)
    assert (found.time == 0).sum() == 4 and (found.action == 0).all()
    assert found.returns.shape[1:] == (world.n_actions, 2)
