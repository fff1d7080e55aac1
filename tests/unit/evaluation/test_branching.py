"""Returns of every action by rollouts in copies."""

import numpy as np
import pytest

from socialiq.evaluation.branching import (
    branched_fleet_returns,
    branched_returns,
)
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.fleet import drive
from socialiq.evaluation.road_training import CHUNK, dial_labeller, fleet_labeller
from socialiq.learners.policy_iteration import DialIterationConfig
from socialiq.types import Ending
from socialiq.worlds.intersection.options import ACTIONS, FASTER, IDLE, SLOWER, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make_fleet

GO = policy("go")


def follow(observation):
    return np.asarray(GO.predict(observation)[0])


def batch_after(actions, size=64):
    batch = Intersection().batch(size)
    batch.reset(700)
    for action in actions:
        batch.step(np.full(size, action))
    return batch


@pytest.mark.parametrize("actions", [(), (SLOWER,), (SLOWER, SLOWER, IDLE), (IDLE, SLOWER, FASTER)])
def test_returns_are_those_of_each_action_driven_alone(actions):
    batch = batch_after(actions)
    found = branched_returns(batch, follow)
    for action in range(len(ACTIONS)):
        copy = Intersection().batch(batch.size)
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
    alone = episodes_of(Intersection().batch(64), GO, np.arange(700, 764)).totals
    np.testing.assert_allclose(found.env[:, FASTER], alone.env)
    np.testing.assert_allclose(found.social[:, FASTER], alone.social)


def test_actions_that_select_one_speed_are_equivalent():
    """After SLOWER and some seconds at rest: SLOWER and IDLE both keep the target speed 0."""
    batch = batch_after((SLOWER,) * 4)
    same = batch.equivalent_actions
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
    once = label(at_any_angle, 0.1, np.random.default_rng(3))
    label(at_any_angle, 0.1, np.random.default_rng(4))
    again = label(at_any_angle, 0.1, np.random.default_rng(3))
    assert once.observation.shape == (CHUNK, 71) and once.returns.env.shape == (CHUNK, 3)
    np.testing.assert_array_equal(once.observation, again.observation)
    np.testing.assert_array_equal(once.returns.social, again.returns.social)


def test_with_a_clock_observations_have_the_time_before_the_angle():
    times, angles = [], []

    def late(observation):
        times.append(observation[:, -2].max())
        angles.append(set(observation[:, -1].tolist()))
        return np.where(observation[:, -2] >= 2, FASTER, SLOWER)

    labelled = labeller(clock=True)(late, 0.0, np.random.default_rng(3))
    assert labelled.observation.shape == (CHUNK, 72)
    assert labelled.observation[:, -2].reshape(4, 50).T.tolist() == [[0, 1, 2, 3]] * 50
    assert max(times) > 3  # rollouts go on from the time of the state
    by_episode = labelled.observation[:, -1].reshape(4, 50)
    np.testing.assert_array_equal(by_episode, np.tile(by_episode[0], (4, 1)))
    assert all(driven <= set(by_episode[0].tolist()) for driven in angles)


def accelerate(observation):
    return np.full(len(observation), FASTER)


@pytest.fixture(scope="module")
def fleets():
    """A batch of three fleets of four, and angles that no policy of these tests reads."""
    batch = make_fleet(agents=4, duration=12.0).batch(3)
    batch.reset([7, 8, 9])
    return batch, np.zeros((3, 4))


def test_an_action_that_the_policy_would_take_changes_nothing(fleets):
    """Own and others' sums are then those of the fleet that goes on by the policy."""
    batch, angles = fleets
    before = batch.save()
    chosen = np.array([0, 1, 3])
    returns = branched_fleet_returns(batch, accelerate, True, angles, chosen)
    for column, saved in zip(batch.save().arrays(), before.arrays(), strict=True):
        np.testing.assert_array_equal(column, saved)
    going = drive(make_fleet(agents=4, duration=12.0).batch(3), [policy("go")], [7, 8, 9])
    rows = np.arange(3)
    np.testing.assert_allclose(returns.env[:, FASTER], going.r_env[rows, chosen])
    everybody = (returns.env + returns.social)[:, FASTER]
    np.testing.assert_allclose(everybody, going.r_env.sum(axis=1))
    assert (returns.env[:, 0] != returns.env[:, FASTER]).any()
    assert (returns.social[:, 0] != returns.social[:, FASTER]).any()


def test_states_of_fleets_are_labelled_at_their_angles():
    structure = DialIterationConfig(states_per_update=1)
    label = fleet_labeller(structure, make_fleet(agents=4, duration=12.0), 8, True)
    labelled = label(accelerate, 0.0, np.random.default_rng(0))
    assert len(labelled.observation) == CHUNK
    angles = labelled.observation[:8, -1]
    assert (angles >= structure.low - structure.margin).all()
    assert (np.diff(angles[::2]) > 0).all()  # fleets of one angle, in the order of their angles
    assert (labelled.observation[:8, -2] == 0).all()  # the time
    assert (labelled.observation[8:16, -2] == 1).all()
    assert labelled.returns.env.shape == labelled.returns.social.shape == (CHUNK, 3)
