"""Returns of every action by rollouts in copies."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.branching import Branching, branched_returns, equivalent_actions
from socialiq.evaluation.episodes import episodes_of
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.options import ACTIONS, FASTER, IDLE, SLOWER, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Batch

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


def test_the_worth_of_actions_counts_at_each_decision():
    """The first action has its own, also where two actions are one; later ones that of `follow`."""
    batch, own = batch_after((SLOWER,) * 4), np.array([1.0, 2.0, 4.0])
    plain = branched_returns(batch, follow)

    def worth(seen):
        return RewardPair(np.tile(own, (len(seen), 1)), np.zeros((len(seen), 3)))

    found = branched_returns(batch, follow, worth=worth)
    for action in range(len(ACTIONS)):
        copy = Batch(Options(), batch.size)
        copy.restore(batch.save())
        running, chosen = np.ones(batch.size, bool), np.full(batch.size, action)
        wanted = np.zeros(batch.size)
        while running.any():
            wanted[running] += own[chosen[running]]
            made = copy.step(chosen, auto_reset=False, rows=running)
            running &= made.ending == int(Ending.NONE)
            chosen = follow(made.observation)
        np.testing.assert_allclose(found.env[:, action] - plain.env[:, action], wanted)
    np.testing.assert_array_equal(found.social, plain.social)


def test_actions_that_select_one_speed_are_equivalent():
    """After SLOWER and some seconds at rest: SLOWER and IDLE both keep the target speed 0."""
    batch = batch_after((SLOWER,) * 4)
    same = equivalent_actions(batch.save(), batch.options)
    assert (same[:, SLOWER] == SLOWER).all()
    assert (same[:, IDLE] == SLOWER).mean() > 0.5
    assert (same[:, FASTER] == FASTER).all()


def test_labeller_leaves_no_trace_between_calls():
    label = Branching(Options(), states=50, episodes=20)
    one = label(follow, follow, np.random.default_rng(3))
    label(follow, follow, np.random.default_rng(4))
    again = label(follow, follow, np.random.default_rng(3))
    assert one.observation.shape == (50, 70) and one.returns.env.shape == (50, 3)
    np.testing.assert_array_equal(one.observation, again.observation)
    np.testing.assert_array_equal(one.returns.social, again.returns.social)


def test_with_a_clock_observations_end_with_the_time():
    label = Branching(Options(), states=60, episodes=20, clock=True)
    times = []

    def late(seen):
        times.append(seen[:, -1])
        return np.where(seen[:, -1] >= 2, FASTER, SLOWER)

    found = label(late, late, np.random.default_rng(3))
    assert found.observation.shape == (60, 71)
    assert found.observation[:, -1].reshape(3, 20).T.tolist() == [[0, 1, 2]] * 20
    assert max(one.max() for one in times) > 2  # rollouts go on from the time of the state


def test_no_states_are_refused():
    with pytest.raises(UserError, match="states must be at least 1"):
        Branching(Options(), states=0)
