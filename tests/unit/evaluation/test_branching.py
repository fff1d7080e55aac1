"""Returns of every action by rollouts in copies."""

import numpy as np
import pytest

from socialiq.evaluation.branching import branched_returns, equivalent_actions
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.road_training import CHUNK, dial_labeller
from socialiq.learners.policy_iteration import DialIterationConfig
from socialiq.types import Ending
from socialiq.worlds.intersection.options import ACTIONS, FASTER, IDLE, SLOWER, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Batch, Intersection

GO = policy("go")


def follow(observation):
    return np.asarray(GO.predict(observation)[0])


def batch_after(actions, size=64):
    batch = Batch(Options(), size)
    batch.reset(700)
    for action in actions:
        batch.step(np.full(size, action))
    return batch


@pytest.mark.parametrize("actions", [(), (SLOWER,), (SLOWER, SLOWER, IDLE), (IDLE, SLOWER, FASTER)])
def test_returns_are_those_of_each_action_driven_alone(actions):
    batch = batch_after(actions)
    found = branched_returns(batch, follow)
    for action in range(len(ACTIONS)):
        copy = Batch(Options(), batch.size)
        copy.restore(batch.save())
        running, chosen = np.ones(batch.size, bool), np.full(batch.size, action)
        env = np.zeros(batch.size)
        while running.any():
            made = copy.step(chosen, auto_reset=False, rows=running)
            env[running] += made.rewards.env[running]
            running &= made.ending == int(Ending.NONE)
            chosen = follow(made.observation)
        np.testing.assert_array_equal(found.env[:, action], env)


def test_the_policys_own_action_gives_its_episode():
    batch = batch_after(())
    found = branched_returns(batch, follow)
    alone = episodes_of(Batch(Options(), 64), GO, np.arange(700, 764)).totals
    np.testing.assert_allclose(found.env[:, FASTER], alone.env)
    np.testing.assert_allclose(found.social[:, FASTER], alone.social)


def test_actions_that_select_one_speed_are_equivalent():
    """After SLOWER and some seconds at rest: SLOWER and IDLE both keep the target speed 0."""
    batch = batch_after((SLOWER,) * 4)
    same = equivalent_actions(batch.save(), batch.options)
    assert (same[:, SLOWER] == SLOWER).all()
    assert (same[:, IDLE] == SLOWER).mean() > 0.5
    assert (same[:, FASTER] == FASTER).all()


def labeller(clock=False):
    return dial_labeller(
        DialIterationConfig(states_per_update=1), Intersection(Options()), 50, clock
    )


def test_labeller_leaves_no_trace_between_calls():
    def at_any_angle(observation):
        return follow(observation[:, :-1])

    label = labeller()
    once = label(at_any_angle, at_any_angle, np.random.default_rng(3))
    label(at_any_angle, at_any_angle, np.random.default_rng(4))
    again = label(at_any_angle, at_any_angle, np.random.default_rng(3))
    assert once.observation.shape == (CHUNK, 71) and once.returns.env.shape == (CHUNK, 3)
    np.testing.assert_array_equal(once.observation, again.observation)
    np.testing.assert_array_equal(once.returns.social, again.returns.social)


def test_with_a_clock_observations_have_the_time_before_the_angle():
    times, angles = [], []

    def late(observation):
        times.append(observation[:, -2].max())
        angles.append(set(observation[:, -1].tolist()))
        return np.where(observation[:, -2] >= 2, FASTER, SLOWER)

    labelled = labeller(clock=True)(late, late, np.random.default_rng(3))
    assert labelled.observation.shape == (CHUNK, 72)
    assert labelled.observation[:, -2].reshape(4, 50).T.tolist() == [[0, 1, 2, 3]] * 50
    assert max(times) > 3  # rollouts go on from the time of the state
    by_episode = labelled.observation[:, -1].reshape(4, 50)
    np.testing.assert_array_equal(by_episode, np.tile(by_episode[0], (4, 1)))
    assert all(driven <= set(by_episode[0].tolist()) for driven in angles)
