"""The largest loss that the reward's own limits allow."""

import gymnasium
import numpy as np
import pytest

from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.template import possible_loss
from socialiq.worlds.intersection.world import env_range, social_range
from socialiq.worlds.registry import make


def test_crossing5_by_hand():
    """From -20, waiting for ever, to 6."""
    assert possible_loss(make("crossing5"), 0.0) == 26.01
    # Rounded up to four digits; the same range the other way round.
    assert possible_loss(make("crossing5"), 180.0) == 26.01


@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0, 200.0])
def test_the_intersection_adds_both_sides(angle):
    world = make("intersection")
    cos, sin = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    exact = abs(cos) * np.diff(env_range(world.options))[0]
    exact += abs(sin) * np.diff(social_range(world.options))[0]
    assert exact <= possible_loss(world, angle) <= exact * 1.001


def test_an_environments_limits_are_not_known():
    env = gymnasium.make("CartPole-v1")
    assert possible_loss(Environment("CartPole-v1", {}, env), 0.0) is None


@pytest.mark.parametrize(
    ("value", "rounded"),
    [(26.0, 26.01), (283.55, 283.6), (0.123456, 0.1235), (12345.0, 12350.0), (0.0, 0.0)],
)
def test_it_is_rounded_up(value, rounded, monkeypatch):
    world = make("crossing5")
    monkeypatch.setattr(type(world), "largest_difference", lambda *_: value)
    limit = possible_loss(world, 0.0)
    assert limit == pytest.approx(rounded, rel=1e-12) and limit >= value
