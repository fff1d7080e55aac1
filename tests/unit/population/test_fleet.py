"""Fleets at the intersection: rules whose fate is known, groups, and experience of self-play."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.road_training import fleet_source
from socialiq.population import fleet
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection

SEEDS = np.arange(7_100_000, 7_100_006)
EVERYBODY = np.zeros((6, 4), np.int64)


@pytest.fixture(scope="module")
def world():
    return fleet.fleet_of(Intersection(), 4, 12.0)


def test_who_waits_is_stuck(world):
    episodes = fleet.drive(world, [policy("wait")], EVERYBODY, SEEDS)
    ran_out = episodes.ending == Ending.TIMEOUT
    assert ran_out.mean() > 0.7  # others may strike who stands
    assert (episodes.seconds[ran_out] == 12.0).all()
    row = fleet.summary(episodes, 0)
    assert row["arrival"] + row["collision"] + row["stuck"] == pytest.approx(1.0)
    assert row["stuck_low"] <= row["stuck"] <= row["stuck_high"]


def test_equal_drivers_in_two_groups_are_one_fleet(world):
    go = policy("go")
    together = fleet.drive(world, [go], EVERYBODY, SEEDS)
    group = fleet.mixed(6, (3, 1), 5)
    apart = fleet.drive(world, [go, go], group, SEEDS)
    for name in ("r_env", "r_social", "ending", "seconds"):
        np.testing.assert_array_equal(getattr(together, name), getattr(apart, name))
    whole = together.means(0)["r_env"] * 4
    parts = apart.means(0)["r_env"] * 3 + apart.means(1)["r_env"]
    np.testing.assert_allclose(whole, parts)


def test_invaders_that_are_residents_gain_what_their_places_do(world):
    go = policy("go")
    uniform = fleet.drive(world, [go], EVERYBODY, SEEDS)
    mixture = fleet.drive(world, [go, go], fleet.mixed(6, (3, 1), 5), SEEDS)
    row = fleet.fitness(mixture, uniform)
    assert row["gain"] == pytest.approx(-3 * row["residents"])


def test_who_waits_among_those_who_go_loses(world):
    drivers = [policy("go"), policy("wait")]
    uniform = fleet.drive(world, drivers[:1], EVERYBODY, SEEDS)
    mixture = fleet.drive(world, drivers, fleet.mixed(6, (2, 2), 5), SEEDS)
    assert fleet.fitness(mixture, uniform)["gain"] < 0.0
    assert not (mixture.ending[mixture.group == 1] == Ending.ARRIVAL).any()


def test_places_are_drawn_by_the_seed():
    group = fleet.mixed(200, (6, 2), 3)
    assert (np.sort(group, axis=1) == [0] * 6 + [1] * 2).all()
    np.testing.assert_array_equal(group, fleet.mixed(200, (6, 2), 3))
    assert (group != fleet.mixed(200, (6, 2), 4)).any()
    assert group.mean(axis=0) == pytest.approx(0.25, abs=0.1)


def test_blocks_do_not_matter(world, monkeypatch):
    whole = fleet.drive(world, [policy("go")], EVERYBODY, SEEDS)
    monkeypatch.setattr(fleet, "SIDE_BY_SIDE", 4)
    for column, other in zip(
        whole, fleet.drive(world, [policy("go")], EVERYBODY, SEEDS), strict=True
    ):
        np.testing.assert_array_equal(column, other)


def test_experience_of_a_fleet(world):
    """Rows are of agents that drive; r_social and r_env of a decision add up over a fleet."""

    def act(observation):
        act.direction = RewardPair(np.arange(len(observation)), -np.arange(len(observation)))
        return np.full(len(observation), 2)  # FASTER

    rows = fleet_source(world, 3, 200, True)(act, np.random.default_rng(0))
    assert rows.observation.shape == (200, world.n_features + 1)
    assert np.abs(rows.observation[:, 0] - 1.0).max() == 0.0  # every agent is there
    times = np.asarray(rows.observation[:, -1])
    np.testing.assert_array_equal(rows.next_observation[:, -1], times + 1)
    begun = times[:12] == 0  # 3 fleets of 4, the first and the last at angles in a row
    assert begun.all()
    turned = np.asarray(rows.direction.env[:12]).reshape(3, 4)
    np.testing.assert_array_equal(np.diff(turned[[0, 2]], axis=1), 1)
    np.testing.assert_array_equal(np.sort(turned.ravel()), np.arange(12))
    env, others = (np.asarray(side[:12]).reshape(3, 4) for side in rows.target)
    np.testing.assert_allclose(env + others, env.sum(axis=1, keepdims=True) * np.ones(4), rtol=1e-5)
    ended = np.asarray(rows.ending) != Ending.NONE
    assert ended.any()


def test_mistakes_are_one_line(world):
    with pytest.raises(UserError, match="discrete actions"):
        fleet.fleet_of(Intersection(ContinuousOptions()), 4, 20.0)
    with pytest.raises(UserError, match="agents must be at most"):
        fleet.fleet_of(Intersection(Options()), 40, 20.0)
    with pytest.raises(UserError, match="at least 1"):
        fleet.drive(world, [policy("go")], EVERYBODY[:0], [])
