"""Fleets at the intersection: rules whose fate is known, and groups."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.population import fleet
from socialiq.types import Ending
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.registry import make_fleet

SEEDS = np.arange(7_100_000, 7_100_006)
EVERYBODY = np.zeros((6, 4), np.int64)


@pytest.fixture(scope="module")
def world():
    return make_fleet("intersection", 4, duration=12.0)


def test_who_waits_is_out_of_time(world):
    episodes = fleet.drive(world, [policy("wait")], EVERYBODY, SEEDS)
    ran_out = episodes.ending == Ending.TIMEOUT
    assert ran_out.mean() > 0.7  # others may strike who stands
    assert (episodes.seconds[ran_out] == 12.0).all()
    row = fleet.summary(episodes, 0)
    assert row["arrival"] + row["collision"] + row["timeout"] == pytest.approx(1.0)
    assert row["timeout_low"] <= row["timeout"] <= row["timeout_high"]


def test_equal_drivers_in_two_groups_are_one_fleet(world):
    go = policy("go")
    together = fleet.drive(world, [go], EVERYBODY, SEEDS)
    group = fleet.mixed(6, (3, 1), 5)
    apart = fleet.drive(world, [go, go], group, SEEDS)
    for name in ("r_env", "r_social", "ending", "seconds"):
        np.testing.assert_array_equal(together[name], apart[name])
    whole = fleet.means(together, 0).r_env * 4
    parts = fleet.means(apart, 0).r_env * 3 + fleet.means(apart, 1).r_env
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
    parts = fleet.drive(world, [policy("go")], EVERYBODY, SEEDS)
    for name, column in whole.items():
        np.testing.assert_array_equal(column, parts[name])


def test_mistakes_are_one_line(world):
    with pytest.raises(UserError, match="at least 1"):
        fleet.drive(world, [policy("go")], EVERYBODY[:0], [])
