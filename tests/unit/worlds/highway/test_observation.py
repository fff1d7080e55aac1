"""The observation along the route: against formulas of the state, and its symmetries."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import socialiq
from socialiq.nn import view
from socialiq.types import Ending
from socialiq.worlds.highway import observation as schema
from socialiq.worlds.highway.observation import EGO, LAYOUT, USER, USERS, names_of
from socialiq.worlds.highway.ways import line_of

ROADS = (
    "intersection",
    "intersection,people=0.3,cyclists=0.2",
    "intersection,exit=right,agents=3",
    "merge",
    "roundabout,people=0.2",
    "two_way,agents=2",
    "road,seed=17",
)
EGO_NAMES = names_of(EGO)
USER_NAMES = names_of(USER)
SIDEWAYS = {"beside", "turned", *(name for name in EGO_NAMES if name.startswith("side_"))}
SIDEWAYS |= {"right", "right_10", "velocity_right", "sin", "beside_route", "sin_route"}
"""Columns that change their sign in a mirror image."""


@cache
def road(text: str) -> Any:
    return socialiq.world(f"{text},observation=route")


def driven(text: str, decisions: int, size: int = 40) -> Any:
    """A batch after random decisions, one observation row for each agent that drives."""
    batch = road(text).batch(size)
    batch.reset(seeds=3)
    rng = np.random.default_rng(5)
    for _ in range(decisions):
        batch.step(rng.integers(batch.n_actions, size=batch.shape))
    return batch


def by_name(observation: np.ndarray) -> tuple[dict, dict]:
    """Columns of the ego, (agent,), and of road users, (agent, user), by name."""
    flat = observation.reshape(-1, schema.N_FEATURES)
    users = flat[:, LAYOUT[0] :].reshape(-1, USERS, LAYOUT[1])
    return dict(zip(EGO_NAMES, flat[:, : LAYOUT[0]].T, strict=True)), dict(
        zip(USER_NAMES, np.moveaxis(users, -1, 0), strict=True)
    )


def test_names_are_unique_and_networks_know_the_layout():
    assert len({*EGO_NAMES}) == LAYOUT[0] and len({*USER_NAMES}) == LAYOUT[1]
    assert LAYOUT == view.ROUTE
    assert LAYOUT[0] + USERS * LAYOUT[1] == schema.N_FEATURES
    assert road("merge").n_features == road("intersection").n_features == schema.N_FEATURES


@pytest.mark.parametrize("text", ROADS)
def test_road_users_are_where_the_simulator_has_them(text):
    """Positions, velocities and headings in the ego's frame, from the records in float64.

    Rows show the state that a decision led to, before vehicles enter.

    Over 10,000 pairs of an agent and a road user are compared on each road. Rows are float32 in
    units of up to 1,000 m, which rounds positions by up to 6e-5 m, 2e-5 in units of 10 m.
    """
    pairs = 0
    for decisions in range(1, 13):
        batch = driven(text, decisions, 100)
        _, users = by_name(batch.observation)
        buffers = batch.buffers
        for row, (count, *slots) in enumerate(buffers.present.tolist()):
            if batch.time[row] == 0:
                continue  # a new episode
            vehicles = buffers.after[row][:count]
            obstacles = buffers.after[row][count:][: len(batch.road.obstacles)]
            people = buffers.people[row][np.isin(buffers.people[row]["state"], (1, 2))]
            for agent, slot in enumerate(slots):
                if slot < 0:
                    continue
                ego = vehicles[slot]
                others = [np.delete(vehicles, slot), obstacles, people]
                columns = [
                    np.concatenate([group[name] for group in others])
                    for name in ("x", "y", "along_x", "along_y", "speed")
                ]
                x, y, cos, sin, speed = columns
                near = np.hypot(x - ego["x"], y - ego["y"])
                order = np.argsort(near, kind="stable")
                scale = batch.road.sight[0]
                shown = (np.abs(x) < scale["x"]) & (np.abs(y) < scale["y"]) & (near < 100)
                order = order[shown[order]][:USERS]
                if len(others[0]) > 12 or len(people) > 6:
                    continue  # more than the rows hold
                at = row * batch.options.agents + agent
                count = len(order)
                assert (users["presence"][at, :count] == 1).all()
                ahead = (x - ego["x"]) * ego["along_x"] + (y - ego["y"]) * ego["along_y"]
                right = (y - ego["y"]) * ego["along_x"] - (x - ego["x"]) * ego["along_y"]
                vx = speed * cos - ego["speed"] * ego["along_x"]
                vy = speed * sin - ego["speed"] * ego["along_y"]
                expected = {
                    "ahead": np.clip(ahead / 50, -2, 2),
                    "right_10": np.clip(right / 10, -2, 2),
                    "speed": speed / 10,
                    "velocity_ahead": (vx * ego["along_x"] + vy * ego["along_y"]) / 10,
                    "velocity_right": (vy * ego["along_x"] - vx * ego["along_y"]) / 10,
                    "cos": cos * ego["along_x"] + sin * ego["along_y"],
                    "sin": sin * ego["along_x"] - cos * ego["along_y"],
                }
                for name, values in expected.items():
                    found = users[name][at, :count]
                    np.testing.assert_allclose(found, values[order], atol=2e-5, err_msg=name)
                pairs += count
    assert pairs > 800


def closeness(ego, along, target, user, line, half_width, fastest, second):
    """The closeness of a road user that goes straight on, by its definition."""
    speed = target - (target - ego["speed"]) * np.exp(-second / 0.6)
    driven_by_then = target * second - (speed - ego["speed"]) * 0.6
    at = min(max(along + driven_by_then, 0.0), len(line) - 1.0)
    point = line[int(at)]
    place = point[:2] + (along + driven_by_then - int(at)) * point[2:]
    x = user["x"] + second * user["speed"] * user["along_x"] - place[0]
    y = user["y"] + second * user["speed"] * user["along_y"] - place[1]
    ahead = x * point[2] + y * point[3]
    beside = y * point[2] - x * point[3]
    return max(1 - abs(ahead) / (12 + 0.3 * fastest), 0.0) * max(
        1 - abs(beside) / (2.5 + 2 * half_width), 0.0
    )


def test_closeness_to_people_is_that_of_its_definition():
    """People go straight on; the ego goes along its route with a rate of 1 / .6 a second."""
    compared = 0
    for decisions in range(10):
        batch = driven("intersection,people=0.3", decisions, 60)
        ego_columns, users = by_name(batch.observation)
        for row in range(batch.size):
            episode = batch.buffers.episodes[row]
            ego = batch.buffers.vehicles[row, episode["controlled"][0]]
            line = batch._along._lines[batch._agents(np.array([row]))["way"][0]].points
            nearest = np.hypot(line[:, 0] - ego["x"], line[:, 1] - ego["y"]).argmin()
            offset = np.array([ego["x"], ego["y"]]) - line[nearest, :2]
            coordinate = nearest + offset @ line[nearest, 2:]
            target = ego["speed"] + 5 * ego_columns["faster"][row]
            for person in batch.buffers.people[row]:
                if person["state"] not in (1, 2):
                    continue
                offset = person["x"] - ego["x"], person["y"] - ego["y"]
                ahead = offset[0] * ego["along_x"] + offset[1] * ego["along_y"]
                if np.hypot(*offset) > 40:
                    continue
                same = np.abs(users["ahead"][row] - ahead / 50) < 1e-4
                same &= users["on_foot"][row] == 1
                if same.sum() != 1 or users["follows"][row][same][0]:
                    continue
                expected = closeness(ego, coordinate, target, person, line, 0.3, 9.0, 2.0)
                found = users["close_faster_2"][row][same][0]
                np.testing.assert_allclose(found, expected, atol=1e-3)
                compared += 1
    assert compared > 100


ARRIVING = ("intersection", "intersection,exit=right", "roundabout,duration=30", "merge")


@pytest.mark.parametrize("text", ARRIVING)
def test_the_way_to_arrival_ends_where_the_episode_does(text):
    """`to_arrival` falls by what the ego drives, and an ego has arrived where it is 0."""
    batch = road(text).batch(60)
    batch.reset(seeds=11)
    policy = road(text).driver("idm")
    before = by_name(batch.observation)[0]["to_arrival_60"]
    arrived = 0
    running = np.ones(60, bool)
    for _ in range(40):
        actions = policy.predict(batch.seen_by(policy))[0]
        made = batch.step(actions, auto_reset=False, rows=running)
        left = by_name(made.observation)[0]["to_arrival_60"]
        near = running & (np.abs(left) < 1) & (np.abs(before) < 1)
        driven_metres = 60 * (before - left)[near]
        assert (np.abs(driven_metres - made.speed[near]) < 8).all()
        ends = running & (made.ending == int(Ending.ARRIVAL))
        assert (left[ends] <= 0.01).all()
        assert (left[running & (made.ending == 0)] > -0.01).all()
        arrived += ends.sum()
        running &= made.ending == 0
        before = left
        if not running.any():
            break
    assert arrived > 5


MIRRORED = [
    ("intersection,canonical=true,exit=left", "intersection,canonical=true,exit=right"),
    ("roundabout", "roundabout"),
    ("merge", "merge"),
    ("road,seed=3,exit=left", "road,seed=3,exit=right"),
]


@pytest.mark.parametrize(("text", "image"), MIRRORED)
def test_left_hand_traffic_is_the_mirror_image(text, image):
    """The same draws on the mirrored road give the same numbers, but those to the side.

    Where several lanes begin at one point, a vehicle there is on the first one in the list, and
    that is another one in the image.
    """
    right, left = road(text).batch(60), road(f"{image},left_hand=true").batch(60)
    right.reset(seeds=3)
    left.reset(seeds=3)
    rng = np.random.default_rng(5)
    swapped = np.array([0, 1, 2, 4, 3])
    for _ in range(3):
        actions = rng.integers(5, size=60)
        right.step(actions)
        left.step(swapped[actions])
    signs = np.ones(schema.N_FEATURES)
    names = EGO_NAMES + USER_NAMES * USERS
    signs[[name in SIDEWAYS for name in names]] = -1
    order = np.arange(schema.N_FEATURES)
    sides = [EGO_NAMES.index(name) for name in ("lane_left", "lane_right")]
    order[sides] = sides[::-1]
    expected = right.observation[:, order] * signs
    at_several = [name in ("right_of_way", "in_conflict", "on_exit") for name in names]
    at_several = np.array(at_several) | [name.startswith(("close_", "ahead_")) for name in names]
    apart = np.abs(expected - left.observation)
    assert (apart[:, ~at_several] < 1e-3).all()
    assert (apart < 1e-3).all(axis=1).mean() > 0.8


def test_agents_of_all_arms_see_the_road_from_their_own():
    """At the start each agent stands on its approach, its rows turned or not."""
    for frame in ("own", "world"):
        batch = road(f"intersection,agents=4,frame={frame}").batch(20)
        batch.reset(seeds=0)
        ego, users = by_name(batch.observation)
        np.testing.assert_allclose(ego["turned"], 0.0, atol=1e-6)
        np.testing.assert_allclose(ego["beside"], 0.0, atol=1e-4)
        assert (ego["to_conflict_60"] > 0).all()
        assert (users["presence"].sum(axis=1) >= 2).all()


def test_other_road_users_that_a_fault_hides_are_not_observed():
    batch = road("intersection,unseen=1").batch(30)
    batch.reset(seeds=0)
    ego, users = by_name(batch.observation)
    assert not users["presence"].any() and not ego["users"].any()
    assert by_name(driven("intersection", 0, 30).observation)[1]["presence"].any()


def test_noise_changes_others_and_not_the_ego():
    plain = by_name(driven("intersection", 0).observation)
    noisy = by_name(driven("intersection,noise=2", 0).observation)
    for name in set(EGO_NAMES) - {"users"}:
        np.testing.assert_array_equal(plain[0][name], noisy[0][name])
    assert np.abs(plain[1]["ahead"] - noisy[1]["ahead"]).max() > 0.01


@pytest.mark.parametrize("text", ["intersection", "merge", "roundabout", "two_way"])
def test_an_action_that_is_masked_does_what_idle_does(text):
    batch = driven(text, 3)
    mask = batch.action_mask
    assert mask[:, batch.idle].all() and not mask.all() and mask.sum() > batch.size
    idle = batch.branch(range(batch.size))
    after = idle.step(np.full(batch.size, batch.idle), auto_reset=False)
    for action in range(batch.n_actions):
        copies = batch.branch(range(batch.size))
        made = copies.step(np.full(batch.size, action), auto_reset=False)
        masked = ~mask[:, action]
        np.testing.assert_array_equal(made.observation[masked], after.observation[masked])
        np.testing.assert_array_equal(made.rewards.env[masked], after.rewards.env[masked])
        differs = (made.observation != after.observation).any(axis=1)
        assert differs[mask[:, action]].all() or action == batch.idle


def test_copies_and_restored_states_observe_the_same():
    batch = driven("roundabout", 2)
    copies = batch.branch([3, 3, 7])
    np.testing.assert_array_equal(copies.observation, batch.observation[[3, 3, 7]])
    state = batch.save()
    before = batch.observation
    batch.step(np.full(batch.size, 2))
    batch.restore(state)
    np.testing.assert_array_equal(batch.observation, before)


def test_the_gymnasium_environment_has_its_bounds_and_its_mask():
    from socialiq.worlds.gym import RoadEnv

    env: Any = RoadEnv("merge", observation="route")
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert env.action_space.n == len(env.action_masks()) == 5
    assert env.action_masks()[1]
    for action in (0, 1, 2, 3, 4):
        observation = env.step(action)[0]
        assert env.observation_space.contains(observation)


def test_a_route_goes_through_its_points_at_equal_distances():
    line = line_of(np.array([(0.0, 0.0), (0.0, 0.0), (3.0, 0.0), (3.0, 4.0)]), 1.0, 2.0, 6.0)
    np.testing.assert_allclose(line.points[:, :2][[0, 3, 7]], [(0, 0), (3, 0), (3, 4)])
    np.testing.assert_allclose(np.hypot(*line.points[:, 2:].T), 1.0)
    assert (line.task["conflict"], line.task["behind"], line.task["arrival"]) == (1.0, 2.0, 6.0)


def test_strips_lie_where_people_cross():
    """At the intersection a left turn crosses the crosswalks of its own arm and of its exit."""
    ego, _ = by_name(driven("intersection,people=0.3", 0).observation)
    assert (ego["next_strip"] == 1).all() and (ego["second_strip"] == 1).all()
    plain, _ = by_name(driven("intersection", 0).observation)
    assert not plain["next_strip"].any()
    metres = 40 * ego["to_next_strip_40"]
    conflict = 60 * ego["to_conflict_60"]
    assert (metres < conflict).all() and (metres > conflict - 10).all()


@pytest.mark.parametrize("columns", [EGO, USER], ids=["ego", "user"])
def test_the_page_has_every_column_in_order(columns):
    """docs/observation.md lists name, unit, meaning, scales and largest value of each column."""
    rows = [
        f"| `{column.name}` | {column.unit} | {column.meaning} "
        f"| {', '.join(f'{scale:g}' for scale, *_ in column.scales)} | {column.scales[0][2]:g} |"
        for column in columns
    ]
    page = (Path(__file__).parents[4] / "docs" / "observation.md").read_text()
    assert "\n".join(rows) in page
