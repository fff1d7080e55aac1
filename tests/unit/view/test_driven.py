"""Episodes of a policy in any world as traffic of the page."""

import json
from typing import Any

import numpy as np
import pytest

from socialiq.audit.request import Trust
from socialiq.errors import UserError
from socialiq.evaluation.rollout import record
from socialiq.nn.q_policy import QPolicy
from socialiq.view.driven import CELL, EPISODES, driven_view
from socialiq.view.open import opened
from socialiq.worlds.registry import open_world
from socialiq.worlds.road_users import ROAD_USERS


def policy_of(world, folder, action):
    """A policy file that always takes one action."""
    values = np.eye(world.n_actions, dtype=np.float32)[action]
    policy = QPolicy(
        (np.zeros((world.n_actions, world.n_features), np.float32),), (values,), "relu", 1.0
    )
    policy.save(folder / "policy.safetensors")
    return str(folder / "policy.safetensors")


def episodes_of(view):
    """Return all frames, and those of each episode with its driver."""
    json.dumps([view.data, view.part(0)], allow_nan=False)
    frames = [frame for number in range(view.count) for frame in view.part(number)["frames"]]
    assert len(frames) == view.data["frames"] and len(view.data["drivers"]) == EPISODES
    return [(frames[one["frames"][0] : one["frames"][-1]], one) for one in view.data["drivers"]]


@pytest.mark.parametrize("name", ["merge", "roundabout"])
def test_a_scene_is_driven_as_evaluation_drives_it(name, tmp_path):
    world: Any = open_world(name)
    view = opened(policy_of(world, tmp_path, 3), None, Trust(), name)
    driver = QPolicy.load(tmp_path / "policy.safetensors")
    rows = record(world.batch(1), driver, range(1, 1 + EPISODES), "one").transitions
    rewards = np.concatenate([one["rewards"] for _, one in episodes_of(view)])
    np.testing.assert_allclose(rewards, np.stack(rows.rewards, axis=1), atol=1e-4)
    for frames, one in episodes_of(view):
        assert all(one["track"] in [row[0] for row in frame] for frame in frames)


def test_a_gridworld_has_a_frame_for_each_step_and_its_ego_goes_east(tmp_path):
    world = open_world("crossing7")
    view = driven_view(policy_of(world, tmp_path, 2), "crossing7", None, Trust())
    for frames, one in episodes_of(view):
        assert len(frames) == len(one["rewards"])
        ego = [next(row for row in frame if row[0] == one["track"]) for frame in frames]
        assert (np.diff([row[1] for row in ego]) % CELL == 0).all() and ego[-1][1] > ego[0][1]
    assert view.data["dt"] == 0.5 and not view.data["around"] and len(view.data["lanes"]) == 2


def test_people_on_foot_and_continuous_actions_are_shown():
    crosswalk = driven_view("gap_3s", "intersection-crosswalk", None, Trust())
    widths = {user["width"] for user in crosswalk.data["users"]}
    assert ROAD_USERS[0].width in widths and len(widths) == 2
    continuous = driven_view("gap_3s", "intersection-continuous", None, Trust())
    assert "in intersection-continuous" in continuous.title and len(episodes_of(continuous)) == 8


def test_an_angle_of_no_dial_and_a_policy_of_another_world_are_refused(tmp_path):
    with pytest.raises(UserError, match="leave it out"):
        driven_view("gap_3s", "intersection-continuous", 30.0, Trust())
    merging = policy_of(open_world("merge"), tmp_path, 1)
    with pytest.raises(UserError, match="features"):
        driven_view(merging, "crossing7", None, Trust())
