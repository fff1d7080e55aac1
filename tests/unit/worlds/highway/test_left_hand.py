"""Left-hand traffic: a road and its mirror image give the same episodes."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds import grammar

ROWS = 40
DECISIONS = 20
WALKING = 1.0  # m/s, below which the steering of highway-env makes rounding errors grow

PAIRS = [
    ("intersection,canonical=true,exit=left", "intersection,canonical=true,exit=right"),
    ("intersection,canonical=true,exit=random", "intersection,canonical=true,exit=random"),
    ("merge", "merge"),
    ("roundabout", "roundabout"),
    ("two_way", "two_way"),
    *[(f"road,seed={seed},exit=left", f"road,seed={seed},exit=right") for seed in range(12)],
    *[(f"road,seed={seed},exit=straight",) * 2 for seed in (2, 5)],
]
"""A road, and what is mirrored: in the image the first arm clockwise is the first anticlockwise."""


def calm(batch):
    """Whether all vehicles of each row drove faster than walking, uncrashed, in a decision."""
    trace = batch.buffers.trace
    there = np.arange(trace.shape[2]) < batch.buffers.present[:, :1]
    slow = np.abs(trace["speed"]) < WALKING
    return ~(there[:, None] & (slow | trace["crashed"])).any(axis=(1, 2))


def started_calm(batch):
    """Whether all vehicles of each row drive faster than walking, uncrashed."""
    vehicles = batch.buffers.vehicles
    there = np.arange(vehicles.shape[1]) < batch.buffers.episodes["vehicles"][:, None]
    slow = np.abs(vehicles["speed"]) < WALKING
    return ~(there & (slow | vehicles["crashed"])).any(axis=1)


def assert_mirrored(world, image, batch, mirrored, rows):
    """Compare positions, headings and observations of some rows."""
    side_x = image.scene.road.sight["side_x"][0]
    side_y = image.scene.road.sight["side_y"][0]
    after = batch.buffers.after[rows]
    reflected = mirrored.buffers.after[rows]
    np.testing.assert_allclose(reflected["x"], side_x * after["x"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(reflected["y"], side_y * after["y"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(reflected["along_x"], side_x * after["along_x"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(reflected["speed"], after["speed"], rtol=0, atol=1e-9)
    observed = batch.buffers.reached[rows] * (1, side_x, side_y, side_x, side_y, side_x, side_y)
    np.testing.assert_allclose(mirrored.buffers.reached[rows], observed, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("right", "left"), PAIRS, ids=str)
def test_a_road_and_its_mirror_image_give_the_same_episodes(right, left):
    world = grammar.build(right)
    image = grammar.build(f"{left},left_hand=true")
    batch = world.batch(ROWS, traced=True)
    mirrored = image.batch(ROWS, traced=True)
    batch.reset(0)
    mirrored.reset(0)
    actions = world.scene.actions
    swapped = np.arange(len(actions))
    if "lane_left" in actions:
        sides = [actions.index("lane_left"), actions.index("lane_right")]
        swapped[sides] = sides[::-1]
    rng = np.random.default_rng(1)
    equal = started_calm(batch)
    compared = 0
    for _ in range(DECISIONS):
        running = batch.running
        drawn = rng.integers(len(actions), size=ROWS)
        chosen = np.where(rng.random(ROWS) < 0.8, batch.faster, drawn)
        decisions = batch.step(chosen, auto_reset=False, rows=running)
        others = mirrored.step(swapped[chosen], auto_reset=False, rows=running)
        np.testing.assert_array_equal(others.ending, decisions.ending)
        equal &= calm(batch)
        rows = equal & running
        compared += rows.sum()
        assert_mirrored(world, image, batch, mirrored, rows)
        for name in ("env", "social"):
            first = getattr(decisions.rewards, name)[rows]
            second = getattr(others.rewards, name)[rows]
            np.testing.assert_allclose(second, first, rtol=0, atol=1e-9)
    assert compared > 100


@pytest.mark.parametrize(
    ("name", "x", "y"),
    [("intersection", -2.0, None), ("roundabout", -2.0, None), ("merge", None, -4.0)],
)
def test_the_ego_enters_on_the_left_of_the_road(name, x, y):
    batch = grammar.build(f"{name},left_hand=true").batch(1)
    batch.reset(0)
    ego = batch.buffers.vehicles[0, batch.buffers.episodes["controlled"][0, 0]]
    for value, expected in ((ego["x"], x), (ego["y"], y)):
        assert expected is None or value == pytest.approx(expected)


@pytest.mark.parametrize(("exit", "x"), [("left", -1), ("right", 1)])
def test_the_ego_turns_to_the_side_of_its_exit(exit, x):
    world = grammar.build(f"intersection,left_hand=true,exit={exit},spawn_probability=0")
    batch = world.batch(20)
    batch.reset(0)
    arrived = np.zeros(20, bool)
    for _ in range(20):
        running = batch.running
        if not running.any():
            break
        decisions = batch.step(np.full(20, batch.faster), auto_reset=False, rows=running)
        ended = running & (decisions.ending == int(Ending.ARRIVAL))
        ego = batch.buffers.after[np.arange(20), batch.buffers.present[:, 1]]
        assert (np.sign(ego["x"][ended]) == x).all()
        arrived |= ended
    assert arrived.any()


def endings_of(text, driver):
    """Endings of ten rows driven by a rule for 30 decisions, (decision, row)."""
    world = grammar.build(text)
    batch = world.batch(10)
    batch.reset(0)
    policy = world.driver(driver)
    return np.array([batch.step(policy.predict(batch.observation)[0]).ending for _ in range(30)])


@pytest.mark.parametrize("driver", ["go", "gap_3s", "idm", "wait"])
@pytest.mark.parametrize(
    ("right", "left"),
    [PAIRS[0], PAIRS[3], PAIRS[5], PAIRS[7]],
    ids=str,
)
def test_rules_drive_in_left_hand_traffic_as_in_right_hand_traffic(right, left, driver):
    endings = endings_of(right, driver)
    assert (endings != int(Ending.NONE)).any()
    np.testing.assert_array_equal(endings_of(f"{left},left_hand=true", driver), endings)


def test_the_options_of_left_hand_traffic_are_in_the_description_of_it_alone():
    assert "left_hand" not in grammar.build("intersection").description
    assert "left_hand" in grammar.build("intersection,left_hand=true").description
    assert grammar.build("merge,left_hand=true") == grammar.build("merge,left_hand=true")
    assert grammar.build("merge,left_hand=true") != grammar.build("merge")


def test_highway_env_does_not_drive_on_the_left():
    with pytest.raises(UserError, match="no back end highway_env"):
        grammar.build("intersection,left_hand=true").batch(1, back_end="highway_env")
