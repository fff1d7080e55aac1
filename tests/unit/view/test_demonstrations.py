"""Demonstrations as content of the page."""

import dataclasses
import json

import numpy as np
import pytest

from socialiq.demonstrations import files
from socialiq.errors import UserError
from socialiq.evaluation.rollout import record
from socialiq.view.demonstrations import demonstrations_view, scenes_of, seeds_of
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.world import Intersection


@pytest.fixture(scope="module")
def table():
    driver = policies.policy("go")
    return record(Intersection().batch(4), driver, range(70, 74), "go").transitions


def shown(table, folder):
    path = folder / "some.safetensors"
    files.save(path, table)
    return demonstrations_view(path)


def test_an_episode_has_its_seed_decisions_and_scenes(table, tmp_path):
    found = shown(table, tmp_path)
    assert (found.kind, found.count, found.title) == ("episodes", 4, "some.safetensors")
    one = found.part(2)
    rows = table.episode == 2
    assert one["seed"] == 72 and one["mode"] == "go"
    assert one["actions"] == table.action[rows].tolist()
    assert one["ending"] == table.ending[rows][-1]
    assert np.array(one["rewards"]).sum(0) == pytest.approx(
        [table.rewards.env[rows].sum(), table.rewards.social[rows].sum()]
    )
    assert len(one["scenes"]) == rows.sum() + 1
    assert one["scenes"][0][0][:2] == pytest.approx(
        (100 * table.observation[rows][0, 1:3]).tolist(), abs=1e-4
    )
    json.dumps([one, found.data], allow_nan=False)


def test_means_of_the_modes_are_those_of_the_episodes(table, tmp_path):
    found = shown(table, tmp_path)
    (mode,) = found.data["modes"]
    totals = table.totals()
    assert mode["env"][0] == pytest.approx(totals.env.mean())
    assert mode["env"][1] < mode["env"][0] < mode["env"][2]
    worst = {one["why"]: one["episode"] for one in found.data["notable"]}["worst for others"]
    assert worst == int(totals.social.argmin())


def test_steps_that_are_left_out_take_the_seed_with_them(table, tmp_path):
    assert shown(table.subsample(2), tmp_path).part(0)["seed"] is None


def test_the_time_as_a_last_feature_does_no_harm(table, tmp_path):
    one = shown(table.with_clock(), tmp_path).part(1)
    assert len(one["observations"][0]) == 70


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ({"first_seed": 5, "episodes": 2}, [5, 6]),
        ({"seeds": [9, 3]}, [9, 3]),
        ({"first_seed": 5, "episodes": 3}, None),
        ({"seeds": [9]}, None),
        ({"seeds": [9, -1]}, None),
        ({"seeds": ["9", "3"]}, None),
        ({"seeds": [1, 2**53]}, None),
        ({}, None),
    ],
)
def test_seeds_are_those_that_the_file_says(source, found):
    assert seeds_of(source, 2) == found


@pytest.mark.parametrize("made_by", ["socialiq data world", "ego swap"])
def test_drivers_of_a_recorded_road_are_refused_in_one_line(made_by, table, tmp_path):
    with pytest.raises(UserError, match="name the recording itself"):
        shown(dataclasses.replace(table, source={"made_by": made_by}), tmp_path)


def test_another_world_is_refused_in_one_line(table, tmp_path):
    other = dataclasses.replace(table, observation=table.observation * np.float32(0.5))
    with pytest.raises(UserError, match=r"not of the intersection \(70 and 3"):
        shown(other, tmp_path)
    small = dataclasses.replace(
        table,
        observation=table.observation[:, :14],
        next_observation=table.next_observation[:, :14],
    )
    with pytest.raises(UserError, match="14 features and 3 actions"):
        shown(small, tmp_path)


def row(x, y, vx, vy):
    speed = np.hypot(vx, vy) or 1.0
    return [1.0, x / 100, y / 100, vx / 20, vy / 20, vx / speed, vy / speed]


EMPTY = [0.0] * 7


def test_places_and_speeds_are_in_metres():
    seen = np.array([[*row(10, -20, 3, 4), *EMPTY]], np.float32)
    ((ego,),) = scenes_of(seen, 1.0)
    assert ego == pytest.approx([10, -20, np.arctan2(4, 3), 5, 0], abs=1e-4)


def test_vehicles_keep_their_numbers_when_the_order_of_the_rows_changes():
    first = [*row(0, 0, 0, 5), *row(30, 2, -9, 0), *row(-30, -2, 9, 0)]
    then = [*row(0, 5, 0, 5), *row(-21, -2, 9, 0), *row(21, 2, -9, 0)]
    one, two = scenes_of(np.array([first, then], np.float32), 1.0)
    assert [vehicle[4] for vehicle in one] == [0, 1, 2]
    assert [vehicle[4] for vehicle in two] == [0, 2, 1]


def test_one_that_leaves_and_one_that_enters_are_not_the_same():
    first = [*row(0, 0, 0, 0), *row(30, 2, -9, 0)]
    then = [*row(0, 0, 0, 0), *row(-60, -2, 9, 0)]
    _, two = scenes_of(np.array([first, then], np.float32), 1.0)
    assert [vehicle[4] for vehicle in two] == [0, 2]


def test_the_ego_stays_the_ego_and_a_clock_is_ignored():
    first, then = [*row(0, 0, 0, 0), 0.0], [*row(90, 90, 0, 0), 1.0]
    scenes = scenes_of(np.array([first, then], np.float32), 1.0)
    assert [len(one) for one in scenes] == [1, 1] and scenes[1][0][4] == 0
