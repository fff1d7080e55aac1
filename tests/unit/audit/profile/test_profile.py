"""Differences that the two hashes show."""

import pytest

from socialiq.audit.profile.profile import identity, scenario_sha256, world_of
from socialiq.errors import UserError


def reward_sha256(world):
    return identity(world)["reward.sha256"]


@pytest.mark.parametrize(
    ("world", "options", "same_reward"),
    [
        ("intersection", {"spawn_probability": 0.6}, True),
        ("intersection", {"population": "thesis"}, True),
        ("intersection", {"yielding_weight": 0.3}, False),
        ("intersection", {"progress_unit": 1}, False),
        ("intersection", {"zone": "last_8_m"}, False),
        ("crossing7", {"spawn_probability": 0.6}, True),
        ("crossing7", {"full_stop": "flat"}, False),
        ("crossing5", {"arrival": "override"}, False),
    ],
)
def test_traffic_is_scenario_and_weights_are_reward(world, options, same_reward):
    plain, other = world_of(world, {}), world_of(world, options)
    assert (reward_sha256(plain) == reward_sha256(other)) == same_reward
    assert scenario_sha256(plain) != scenario_sha256(other)


def test_naming_a_default_changes_nothing():
    plain, named = world_of("intersection", {}), world_of("intersection", {"duration": 20})
    assert scenario_sha256(plain) == scenario_sha256(named)


def test_the_reward_is_spelled_out():
    found = world_of("intersection", {}).reward
    assert found["env"] == {
        "progress": 2.0,
        "speed": 0.5,
        "step": -0.15,
        "collision": -2.0,
        "arrival": 1.0,
        "timeout": -0.5,
    }
    assert found["social"] == {"yielding": 0.2, "disruption": -1.0, "neighbour_collision": -5.0}
    assert found["units"]["target_speeds"] == (0.0, 4.5, 9.0)


def test_worlds_do_not_share_their_rewards():
    found = {reward_sha256(world_of(name, {})) for name in ("crossing5", "crossing7")}
    assert len(found | {reward_sha256(world_of("intersection", {}))}) == 3


def test_an_unknown_world_is_refused():
    with pytest.raises(UserError, match="unknown world 'moon'"):
        world_of("moon", {})
