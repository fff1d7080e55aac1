"""A policy that plays its actions out in its head."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.play import episodes_of
from socialiq.evaluation.thinking_ahead import ThinkingAhead
from socialiq.thesis import atlas
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options


class Indifferent:
    """Values that tell nothing: only what is played out counts."""

    def q_values(self, observations):
        return np.zeros((len(observations), 3))


class Weary:
    """Worth nothing at the end of the thought, and slower is always best."""

    def q_values(self, observations):
        return np.tile([0.0, -1.0, -1.0], (len(observations), 1))


def test_one_decision_is_worth_its_reward():
    """Without a future that counts, an egoist in free road goes faster: r_env of that decision."""
    batch = Batch(Options(), 4)
    seen = batch.reset([3, 4, 5, 6])
    values = ThinkingAhead(Indifferent(), Options(), 0.0, draws=1, decisions=1).values(seen)
    now = batch.save()
    for action in range(3):
        batch.restore(now)
        made = batch.step(np.full(4, action), auto_reset=False)
        # The ego's own second is known but for vehicles it meets: none at the start.
        np.testing.assert_allclose(values[:, action], made.rewards.env, atol=2e-2)
    assert (values.argmax(axis=1) == 2).mean() >= 0.75


def test_the_networks_drive_goes_on_after_the_first_action():
    batch = Batch(Options(), 1)
    seen = batch.reset([3])
    one, two = (
        ThinkingAhead(Weary(), Options(), 0.0, draws=1, decisions=d).values(seen) for d in (1, 2)
    )
    now = batch.save()
    for action in range(3):
        batch.restore(now)
        first = batch.step(np.array([action]), auto_reset=False).rewards.env[0]
        second = batch.step(np.array([0]), auto_reset=False).rewards.env[0]
        assert one[0, action] == pytest.approx(first, abs=2e-2)
        assert two[0, action] == pytest.approx(first + 0.99 * second, abs=5e-2)


def test_it_depends_on_the_view_alone():
    policy = ThinkingAhead(atlas.load("set_egoistic"), Options(), 0.0, draws=2, decisions=2)
    seen = Batch(Options(), 6).reset(0)
    values = policy.values(seen)
    np.testing.assert_allclose(policy.values(seen[::-1])[::-1], values, atol=1e-6)
    action, state = policy.predict(seen[2])
    assert action == values[2].argmax() and action.shape == () and state is None


def test_thinking_betters_the_atlas_egoist():
    """300 episodes; the study has the numbers over five training seeds."""
    seeds = np.arange(51_000_000, 51_000_300)
    network = atlas.load("set_egoistic")
    plain = episodes_of(Batch(Options(), 128), network, seeds)
    thought = episodes_of(
        Batch(Options(), 128), ThinkingAhead(network, Options(), 0.0, draws=4, decisions=3), seeds
    )
    assert (thought.totals.env - plain.totals.env).mean() > 0.0
    assert thought.metrics().collision < plain.metrics().collision


@pytest.mark.parametrize("wrong", [{"draws": 0}, {"decisions": 0}])
def test_thinking_of_nothing_is_refused(wrong):
    with pytest.raises(UserError, match="at least 1"):
        ThinkingAhead(Indifferent(), Options(), 0.0, **wrong)
