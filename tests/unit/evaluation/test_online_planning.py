"""A policy that plays its actions out in its head."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.online_planning import RolloutPolicy
from socialiq.types import Ending
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection


class Indifferent:
    """Values that tell nothing: only what is played out counts."""

    def q_values(self, observations):
        return np.zeros((len(observations), 3))


class Weary:
    """Worth nothing at the end of the thought, and slower is always best."""

    def q_values(self, observations):
        return np.tile([0.0, -1.0, -1.0], (len(observations), 1))


def test_one_decision_is_worth_its_reward():
    """The ego's own second is known, but for vehicles it meets; at the start there are none."""
    batch = Intersection().batch(4)
    seen = batch.reset([3, 4, 5, 6])
    values = RolloutPolicy(Indifferent(), Options(), 0.0, draws=1, decisions=1).values(seen)
    now = batch.save()
    for action in range(3):
        batch.restore(now)
        made = batch.step(np.full(4, action), auto_reset=False)
        np.testing.assert_allclose(values[:, 0, action], made.rewards.env, atol=1e-5)
    assert (values[:, 0, 0] < values[:, 0, 2] - 0.1).all()  # slower earns less


def test_the_networks_drive_goes_on_after_the_first_action():
    batch = Intersection().batch(1)
    seen = batch.reset([3])
    one, two = (
        RolloutPolicy(Weary(), Options(), 0.0, draws=1, decisions=d).values(seen) for d in (1, 2)
    )
    now = batch.save()
    for action in range(3):
        batch.restore(now)
        first = batch.step(np.array([action]), auto_reset=False).rewards.env[0]
        second = batch.step(np.array([0]), auto_reset=False).rewards.env[0]
        assert one[0, 0, action] == pytest.approx(first, abs=1e-5)
        assert two[0, 0, action] == pytest.approx(first + 0.99 * second, abs=1e-5)


class Timed(Indifferent):
    """Values that tell nothing, of a policy that sees the time; it notes the times."""

    n_features = 71

    def __init__(self):
        self.times = []

    def q_values(self, observations):
        self.times.append(observations[:, -1])
        return super().q_values(observations)


def test_the_time_goes_on_in_simulated_decisions_and_ends_the_episode():
    options = Options()
    seen = np.repeat(Intersection(options).batch(1).reset([3]), 2, axis=0)
    times = np.array([2.0, options.decisions - 1.0], np.float32)
    policy = Timed()
    planned = RolloutPolicy(policy, options, 0.0, draws=1, decisions=3)
    assert planned.n_features == 71
    early, late = planned.values(np.column_stack([seen, times]))[:, 0]
    assert [sorted({*one.tolist()})[0] for one in policy.times[:2]] == [3.0, 4.0]
    once = RolloutPolicy(Indifferent(), options, 0.0, draws=1, decisions=1).values(seen)[1, 0]
    np.testing.assert_allclose(late, once + options.timeout_weight, atol=1e-5)
    assert (early > late).all()


def test_it_depends_on_the_view_alone():
    policy = RolloutPolicy(atlas.load("set_egoistic"), Options(), 0.0, draws=2, decisions=2)
    seen = Intersection().batch(6).reset(0)
    actions, state = policy.predict(seen)
    np.testing.assert_array_equal(policy.predict(seen[::-1])[0][::-1], actions)
    alone, _ = policy.predict(seen[2])
    assert alone == actions[2] and alone.shape == () and state is None


def test_the_networks_action_stays_where_nothing_surely_beats_it():
    """Of two draws with means 1 and 2 and errors of their size, doubt decides."""
    policy = RolloutPolicy(Weary(), Options(), 0.0, draws=2, decisions=1, doubt=1.0)
    bold = RolloutPolicy(Weary(), Options(), 0.0, draws=2, decisions=1, doubt=0.0)
    values = np.array([[[0.0, 0.0, 0.0], [0.0, 2.0, -1.0]]])  # draws by actions
    for one in (policy, bold):
        one.values = lambda _: values  # type: ignore[method-assign]
    seen = np.zeros((1, 70), np.float32)
    assert bold.predict(seen)[0] == [1]  # mean 1
    assert policy.predict(seen)[0] == [0]  # 1 minus an error of 1 is no gain


def test_thinking_betters_the_atlas_egoist():
    """Episodes that the network alone ends with a collision; the study has all."""
    seeds = np.arange(51_000_000, 51_000_200)
    network = atlas.load("set_egoistic")
    plain = episodes_of(Intersection().batch(128), network, seeds)
    lost = seeds[plain.ending == int(Ending.COLLISION)]
    thought = RolloutPolicy(network, Options(), 0.0)
    again = episodes_of(Intersection().batch(len(lost)), thought, lost)
    assert (again.ending == int(Ending.ARRIVAL)).mean() > 0.3


@pytest.mark.parametrize("wrong", [{"draws": 0}, {"decisions": 0}])
def test_thinking_of_nothing_is_refused(wrong):
    with pytest.raises(UserError, match="at least 1"):
        RolloutPolicy(Indifferent(), Options(), 0.0, **wrong)
