"""Ego off the road: hand-made snapshots, and the ending where the option asks for it.

The ego comes from the south on x = 2, on a lane of 4 m; the southern exit lies beside it on x = -2.
"""

import dataclasses

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from socialiq.types import Ending
from socialiq.worlds import OLD_IDS
from socialiq.worlds.gym import RoadVectorEnv
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH
from socialiq.worlds.highway.core.step import off_road as write_off_road
from socialiq.worlds.highway.world import world_of
from socialiq.worlds.intersection.core.geometry import LANES
from socialiq.worlds.intersection.options import ContinuousOptions
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make
from socialiq.worlds.spelled_out import defaults

STAYS = ContinuousOptions(actions="continuous_steering")
ENDS = dataclasses.replace(STAYS, offroad_terminal=True)
EXIT_EAST = 4  # lane by which a right turn from the south leaves


@pytest.fixture
def after(car, annotated):
    """Decision of an ego that is at a place afterwards."""

    def make(x, y, options, lane=0, degrees=-90.0, **more):
        place = {"lane": lane, "target_lane": 0, "origin": 0, "destination": 2}
        fields = {name: more.pop(name) for name in ("crashed",) if name in more}
        before = car(2.0, 40.0, -90.0, 10.0, **place)
        return annotated([before], [car(x, y, degrees, 10.0, **place, **fields)], options, **more)

    return make


@pytest.mark.parametrize(("x", "left"), [(2.0, False), (4.0, False), (4.01, True), (9.0, True)])
def test_the_road_ends_at_the_edge_of_the_closest_lane(after, x, left):
    ending = after(x, 31.0, ENDS).ending[0]
    assert ending == (Ending.OTHER if left else Ending.NONE)
    assert after(x, 31.0, STAYS).ending[0] == Ending.NONE


def test_the_road_goes_on_for_a_vehicle_s_length_behind_its_beginning(after):
    begin = 11.0 + float(LANES["length"][0])
    assert after(2.0, begin + VEHICLE_LENGTH, ENDS).ending[0] == Ending.NONE
    assert after(2.0, begin + VEHICLE_LENGTH + 0.01, ENDS).ending[0] == Ending.OTHER


def test_it_costs_r_env_a_collision_and_r_social_nothing(after):
    ends, stays = after(9.0, 31.0, ENDS), after(9.0, 31.0, STAYS)
    assert (ends.rewards[0].tolist(), ends.signals[0, 3]) == ([-2.0, 0.0], 1.0)
    assert stays.rewards[0].tolist() == [-0.15, 0.0]
    dear = dataclasses.replace(ENDS, collision_weight=-7.0)
    assert after(9.0, 31.0, dear).rewards[0, 0] == -7.0
    on = after(2.0, 31.0, ENDS)
    assert on.rewards[0, 0] == pytest.approx(2.0 * 9.0 / 28.0 + 0.5 - 0.15)


def test_a_collision_precedes_it_and_it_precedes_arrival_and_timeout(after):
    beside_exit = {"x": 50.0, "y": 5.0, "lane": EXIT_EAST, "degrees": 0.0}
    assert after(**beside_exit, options=STAYS).ending[0] == Ending.ARRIVAL
    assert after(**beside_exit, options=ENDS).ending[0] == Ending.OTHER
    assert after(**beside_exit | {"y": 2.0}, options=ENDS).ending[0] == Ending.ARRIVAL
    assert after(9.0, 31.0, ENDS, crashed=True).ending[0] == Ending.COLLISION
    assert after(9.0, 31.0, ENDS, time=20.0).ending[0] == Ending.OTHER
    assert after(9.0, 31.0, STAYS, time=20.0).ending[0] == Ending.TIMEOUT


def driven(options, action, seed=0, size=30):
    """Endings, episodes that were off the road, and lengths."""
    batch = Intersection(options).batch(size)
    batch.reset(seed)
    running = np.ones(size, bool)
    ending, left, length = np.zeros(size, int), np.zeros(size, bool), np.zeros(size, int)
    while running.any():
        made = batch.step(np.tile(action, (size, 1)), auto_reset=False, rows=running)
        left |= made.off_road & running
        ending[running], length[running] = made.ending[running], length[running] + 1
        running &= made.ending == Ending.NONE
    return ending, left, length


def test_an_ego_that_steers_off_goes_on_or_ends():
    ending, left, length = driven(STAYS, [0.0, 0.05])
    assert left.mean() > 0.9 and not (ending == Ending.OTHER).any()
    ended, left_too, shorter = driven(ENDS, [0.0, 0.05])
    np.testing.assert_array_equal((ended == Ending.OTHER), left_too)
    assert left_too.mean() > 0.9 and shorter.max() < length.max()


def test_with_acceleration_alone_it_leaves_the_road_backwards_only():
    options = ContinuousOptions(offroad_terminal=True)
    ending, left, _ = driven(options, [-1.0])
    np.testing.assert_array_equal(ending == Ending.OTHER, left)
    assert left.mean() > 0.3
    assert not driven(options, [1.0])[1].any()


def test_the_option_changes_nothing_before_the_ending():
    rng, ends, stays = (
        np.random.default_rng(3),
        Intersection(ENDS).batch(40),
        Intersection(STAYS).batch(40),
    )
    np.testing.assert_array_equal(ends.reset(9), stays.reset(9))
    running = np.ones(40, bool)
    for _ in range(6):
        action = rng.uniform(-0.3, 0.3, (40, 2))
        mine, theirs = (one.step(action, auto_reset=False, rows=running) for one in (ends, stays))
        running &= theirs.ending == Ending.NONE
        np.testing.assert_array_equal(mine.off_road[running], theirs.off_road[running])
        running &= ~mine.off_road
        for one, other in zip(mine.rewards, theirs.rewards, strict=True):
            np.testing.assert_array_equal(one[running], other[running])
        np.testing.assert_array_equal(mine.observation[running], theirs.observation[running])
    assert 0 < running.sum() < 40


def test_gymnasium_terminates_and_says_so():
    env = gymnasium.make(OLD_IDS["intersection-continuous-steering-offroad"])
    env.reset(seed=0)
    steps = [env.step(np.array([0.0, 0.5], np.float32))]
    while not (steps[-1][2] or steps[-1][3]):
        steps.append(env.step(np.array([0.0, 0.5], np.float32)))
    _, reward, terminated, truncated, info = steps[-1]
    assert (terminated, truncated, reward) == (True, False, -2.0)
    assert info["ending"] == "other" and info["off_road"]
    assert not any(step[4]["off_road"] for step in steps[:-1])


def test_the_vector_environment_terminates_and_resets():
    options = dataclasses.asdict(ENDS)
    envs = RoadVectorEnv(num_envs=8, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    envs.reset(seed=0)
    terminated = np.zeros(8, bool)
    for _ in range(4):
        _, _, over, truncated, info = envs.step(np.tile(np.float32([0.0, 0.5]), (8, 1)))
        np.testing.assert_array_equal(over, np.isin(info["ending"], (1, 2, 4)))
        np.testing.assert_array_equal(over, info["_final_obs"] if "final_obs" in info else over)
        terminated |= over & info["off_road"]
        assert not truncated.any()
    assert terminated.all()


def test_the_name_of_the_world_gives_the_options():
    steering = {"actions": "continuous_steering"}
    for name, options in {
        "intersection-continuous": {"actions": "continuous"},
        "intersection-continuous-steering": steering,
        "intersection-continuous-steering-offroad": steering | {"offroad_terminal": True},
    }.items():
        world = make(name)
        assert {key: getattr(world.options, key) for key in options} == options
        assert not set(options) & set(defaults(name))
    assert defaults("intersection-continuous-steering")["offroad_terminal"] is False
    assert make("intersection-continuous-steering", offroad_terminal=True).options == ENDS


def test_egos_with_discrete_actions_stay_on_the_road():
    for batch, action in (
        (Intersection().batch(20), 2),
        (world_of("merge").batch(20), 3),
        (world_of("roundabout").batch(20), 3),
    ):
        batch.reset(0)
        for _ in range(6):
            assert not batch.step(np.full(20, action)).off_road.any()


def test_every_row_is_written(car):
    vehicles = np.array([[car(2.0, 40.0, -90.0, 0.0), car(9.0, 40.0, -90.0, 0.0)]] * 3)
    found = np.zeros((3, 2), bool)
    present = np.array([[2, 0, 1], [2, 1, 0], [2, 0, -1]])  # of the last row one agent has left
    write_off_road(LANES, vehicles, present, found, 0, 3)
    assert found.tolist() == [[False, True], [True, False], [False, False]]
