"""The learned influence zone: what a choice moves is known in a gridworld and in plain cases."""

import functools

import numpy as np
import pytest

from socialiq import tabulate
from socialiq.worlds.highway.options import VEHICLE
from socialiq.worlds.registry import make_grid, open_world
from studies.influence_zone import moved


def at_random(seed: int) -> moved.ActorOn:
    return functools.partial(moved.RandomActor, seed=seed)


def planted_zone(features: np.ndarray, options: dict[str, str]) -> np.ndarray:
    """Whether a vehicle would enter the conflict cell, to which the ego may come or not."""
    x_ego, _, place, _ = features.T
    enters = (place >= 1) & (place <= (1 if options == {"conflict": "end_cell"} else 2))
    return (x_ego >= 1) & (x_ego <= 3) & enters


@pytest.mark.parametrize(
    "options", [{}, {"conflict": "end_cell"}, {"braking": "one_level"}], ids=str
)
def test_a_choice_moves_whom_the_rules_say(options):
    """In crossing7 a vehicle that would enter the conflict cell brakes for the ego."""
    features, is_moved = moved.grid_vehicles(tabulate(make_grid("crossing7", **options)))
    np.testing.assert_array_equal(is_moved, planted_zone(features, options))


@pytest.mark.parametrize(
    "name", ["intersection-caused", pytest.param("merge-caused", marks=pytest.mark.slow)]
)
def test_the_zone_by_hand_is_that_of_the_reward(name):
    """Eq 4.2 credits (1 - v/v_max) for each vehicle that the zone of the next decision has."""
    world, episodes = open_world(name), 30
    credited = np.full(episodes, np.nan)
    compared = 0
    for decision in moved.decisions(world, at_random(3), np.arange(episodes)):
        counts = np.bincount(decision.episode, decision.in_hand_zone, episodes)
        speed = np.full(episodes, np.nan)
        speed[decision.episode] = decision.features[:, 3]
        expected = (1.0 - np.clip(speed / world.options.max_speed, 0.0, 1.0)) * counts
        both = ~np.isnan(speed) & ~np.isnan(credited)
        np.testing.assert_allclose(credited[both], expected[both], atol=1e-6)
        compared += int((expected[both] > 0).sum())
        credited = decision.signals["yielding"].copy()
    assert compared > 20


def test_who_is_far_away_is_not_moved():
    driven = list(moved.decisions(open_world("intersection-caused"), at_random(0), np.arange(30)))
    distance = np.concatenate([decision.features[:, 2] for decision in driven])
    metres = np.concatenate([decision.metres for decision in driven])
    spread, far = metres.max(axis=1) - metres.min(axis=1), distance > 120.0
    assert far.sum() > 20
    assert (spread[far] < moved.MOVED).all()
    assert (spread[distance < 20.0] > moved.MOVED).mean() > 0.2


def test_fear_is_the_share_of_actions_that_a_choice_takes():
    """An ego that keeps its speed takes none; one that drives into a vehicle's way takes some."""
    ego, other = np.zeros(1, VEHICLE), np.zeros(1, VEHICLE)
    ego["speed"] = other["speed"] = 4.0
    other["x"], other["y"], other["heading"] = 20.0, -20.0, np.pi / 2
    assert moved.feasible_action_reduction(ego, np.array([4.0]), other) == 0.0
    speeds = np.array([4.5, 9.0])
    taken = [moved.feasible_action_reduction(ego, np.array([speed]), other)[0] for speed in speeds]
    assert 0.0 <= taken[0] < taken[1] < 1.0
    other["x"] = 500.0
    assert moved.feasible_action_reduction(ego, np.array([9.0]), other) == 0.0
