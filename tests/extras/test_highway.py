"""The reference is highway-env, draw for draw, and its records say what highway-env holds."""

import math
import runpy
import sys

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.highway.core import drivers
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection.core.geometry import LANES, ROAD
from socialiq.worlds.intersection.options import POPULATIONS, ContinuousOptions, Options
from socialiq.worlds.intersection.world import Intersection

pytest.importorskip("highway_env", reason="extra `highway` is not installed")

from highway_env.envs.intersection_env import IntersectionEnv

from socialiq.worlds.intersection import reference
from socialiq.worlds.intersection.reference import (
    Driver,
    HighwayIntersection,
    controlled,
    environment_config,
)

SEEDS = range(6)

arrived = for_python(drivers.arrived)


@pytest.fixture(scope="module", params=POPULATIONS)
def world(request):
    return HighwayIntersection(Options(population=request.param))


@pytest.fixture(scope="module")
def varied():
    return HighwayIntersection(Options(population="thesis"))


def ego_of(vehicles):
    return int(controlled(vehicles)[0])


def crashed(world):
    return bool(world.after["crashed"][ego_of(world.after)])


def touched_by(world):
    return world.environment.road.contacts[0]


def ended(world):
    """Whether it is terminated, and truncated, by all that an engine reads of it."""
    terminated = crashed(world) or arrived(world.after[ego_of(world.after)], ROAD)
    return terminated, world.environment.time >= world.environment.config["duration"]


def random_decisions(world, seed):
    random = np.random.default_rng(seed)
    world.reset(seed)
    while not any(ended(world)):
        action = int(random.integers(3))
        yield action, world.step(action)


def assert_same_episode(world, plain, seed):
    observation, _ = plain.reset(seed=seed)
    np.testing.assert_array_equal(world.reset(seed), observation.ravel())
    for action, found in random_decisions(world, seed):
        observation, _, terminated, truncated, info = plain.step(action)
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, observation.ravel())
        assert ended(world) == (terminated, truncated)
        assert (crashed(world), world.environment.time) == (info["crashed"], plain.time)
        assert arrived(world.after[ego_of(world.after)], ROAD) == plain.has_arrived(plain.vehicle)


@pytest.mark.parametrize("connected_lanes", [False, True])
def test_episodes_are_those_of_a_plain_environment(connected_lanes):
    options = Options(connected_lanes=connected_lanes)
    plain = IntersectionEnv(config=environment_config(options))
    for seed in SEEDS[:2]:
        assert_same_episode(HighwayIntersection(options), plain, seed)


def test_options_reach_the_environment():
    options = Options(
        simulation_frequency=20,
        policy_frequency=2,
        duration=3.0,
        initial_vehicle_count=3,
        spawn_probability=1.0,
        destination="random",
        target_speeds=(0.0, 5.0, 10.0, 15.0),
        observed_vehicles=4,
    )
    world = HighwayIntersection(options)
    arms = set()
    for seed in SEEDS:
        assert world.reset(seed).shape == (4 * 7,)
        arms.add(int(world.vehicles["destination"][ego_of(world.vehicles)]))
    assert arms == {1, 2, 3}
    while not any(ended(world)):
        world.step(0)
    assert ended(world)[1] and world.environment.time == 3.0
    assert world.environment.steps == 60


def test_observation_is_read_as_highway_env_reads_its_own():
    default = IntersectionEnv.default_config()
    plain = IntersectionEnv(config={"observation": default["observation"] | {"vehicles_count": 10}})
    world = HighwayIntersection(Options())
    assert world.environment.config["action"] == default["action"]
    found, expected = vars(world.environment.observation_type), vars(plain.observation_type)
    for name in ("features", "features_range", "absolute", "order", "normalize", "clip"):
        assert found[name] == expected[name]
    for name in ("vehicles_count", "see_behind", "observe_intentions", "include_obstacles"):
        assert found[name] == expected[name]


def test_driver_without_variation_is_highway_envs_own():
    driver = {"other_vehicles_type": f"{reference.__name__}.{Driver.__name__}"}
    plain = IntersectionEnv(config=environment_config(Options()) | driver)
    assert_same_episode(HighwayIntersection(Options()), plain, 0)
    assert any(isinstance(one, Driver) for one in plain.road.vehicles)


def test_lanes_are_numbered_as_in_the_geometry(world):
    lanes = world.environment.road.network.lanes_list()
    for ours, theirs in zip(LANES, lanes, strict=True):
        assert ours["length"] == theirs.length
        assert ours["priority"] == theirs.priority
        if ours["straight"]:
            np.testing.assert_allclose((ours["x"], ours["y"]), theirs.start, atol=1e-12)
        else:
            np.testing.assert_allclose((ours["x"], ours["y"]), theirs.center, atol=1e-12)


def test_records_hold_what_the_vehicles_hold(world):
    for _ in random_decisions(world, 1):
        for row, vehicle in zip(world.vehicles, world.environment.road.vehicles, strict=True):
            assert (row["x"], row["y"]) == tuple(vehicle.position)
            assert (row["heading"], row["speed"]) == (vehicle.heading, vehicle.speed)
            assert row["steering"] == vehicle.action["steering"]
            assert row["acceleration"] == vehicle.action["acceleration"]
            assert row["target_speed"] == vehicle.target_speed
            assert row["pushed"] == (vehicle.impact is not None)
            assert row["crashed"] == vehicle.crashed


def test_before_after_and_now_are_three_moments_of_one_episode(world):
    cleared, came = 0, 0
    for seed in SEEDS:
        world.reset(seed)
        now = world.vehicles
        assert np.array_equal(world.before, now) and np.array_equal(world.after, now)
        for _ in random_decisions(world, seed):
            assert np.array_equal(world.before, now)
            now = world.vehicles
            np.testing.assert_array_equal(world.after["identity"], world.before["identity"])
            kept = np.isin(world.after["identity"], now["identity"])
            assert np.array_equal(world.after[kept], now[: kept.sum()])
            assert len(now) - kept.sum() in (0, 1)
            cleared += (~kept).sum()
            came += len(now) - kept.sum()
            assert_valid(now, ego_of(world.vehicles))
            assert_valid(world.after, ego_of(world.after))
            assert crashed(world) == world.environment.vehicle.crashed
    assert cleared > 0 and came > 0


def assert_valid(vehicles, ego):
    assert (np.diff(vehicles["identity"]) > 0).all()
    assert (vehicles["origin"] != vehicles["destination"]).all()
    for name, most in {
        "lane": 19,
        "target_lane": 19,
        "origin": 3,
        "destination": 3,
        "leg": 3,
    }.items():
        assert (vehicles[name] >= 0).all() and (vehicles[name] <= most).all()
    assert (vehicles["target_speed"][vehicles["yielding"]] == 0).all()
    assert not vehicles["push_x"][~vehicles["pushed"]].any()
    drivers = np.delete(vehicles, ego)
    assert ((drivers["exponent"] >= 3.5) & (drivers["exponent"] <= 4.5)).all()
    chosen = vehicles[ego]
    assert (chosen["origin"], chosen["destination"]) == (0, 1)
    assert chosen["exponent"] == chosen["time_headway"] == 0
    assert chosen["desired_speed"] == math.inf


def test_highway_env_population_is_its_fixed_parameters():
    world = HighwayIntersection(Options())
    population = POPULATIONS["highway_env"]
    for seed in SEEDS:
        world.reset(seed)
        drivers = np.delete(world.vehicles, ego_of(world.vehicles))
        for name, normal in population._asdict().items():
            assert (drivers[name] == normal.mean).all()


def test_varied_drivers_differ_and_stay_in_bounds(varied):
    episodes = []
    for seed in range(12):
        varied.reset(seed)
        episodes.append(np.delete(varied.vehicles, ego_of(varied.vehicles)))
    drivers = np.concatenate(episodes)
    for name, normal in POPULATIONS["thesis"]._asdict().items():
        assert ((drivers[name] >= normal.low) & (drivers[name] <= normal.high)).all()
        assert len(np.unique(drivers[name])) > len(drivers) // 2


def test_varied_drivers_draw_in_the_documented_order(varied):
    varied.reset(0)
    driver = next(one for one in varied.environment.road.vehicles if isinstance(one, Driver))
    varied.environment.road.np_random = np.random.default_rng(7)
    driver.randomize_behavior()
    random = np.random.default_rng(7)
    assert random.uniform(3.5, 4.5) == driver.DELTA
    drawn = [normal.mean + normal.deviation * random.normal() for normal in driver.population]
    expected = [
        min(max(value, normal.low), normal.high)
        for value, normal in zip(drawn, driver.population, strict=True)
    ]
    found = [
        driver.desired_speed,
        driver.TIME_WANTED,
        driver.DISTANCE_WANTED,
        driver.COMFORT_ACC_MAX,
        -driver.COMFORT_ACC_MIN,
    ]
    assert found == expected


def test_desired_speed_survives_every_yield(varied):
    released = 0
    for seed in SEEDS:
        yielded = set()
        for _ in random_decisions(varied, seed):
            drivers = np.delete(varied.vehicles, ego_of(varied.vehicles))
            target = np.where(drivers["yielding"], 0, drivers["desired_speed"])
            np.testing.assert_array_equal(drivers["target_speed"], target)
            yielded |= set(drivers["identity"][drivers["yielding"]].tolist())
            released += len(yielded & set(drivers["identity"][~drivers["yielding"]].tolist()))
    assert released > 0


@pytest.fixture
def calls(monkeypatch):
    made = []

    def contact_of(vehicles, ego, dt, contact, touched):
        made.append((vehicles, ego, dt, (contact, touched)))
        return (Contact.EGO_STRUCK, 3) if len(made) > 1 else (Contact.NONE, -1)

    monkeypatch.setattr(reference, "contact_of", contact_of)
    return made


def test_contacts_are_watched_in_the_sub_steps_of_decisions(calls):
    world = HighwayIntersection(Options())
    world.reset(0)
    assert calls == [] and world.environment.road.contacts[0][0] == Contact.NONE
    world.step(1)
    assert len(calls) == 10
    assert [told for *_, told in calls] == [(0, -1)] * 2 + [(Contact.EGO_STRUCK, 3)] * 8
    assert touched_by(world) == (Contact.EGO_STRUCK, 3)
    for vehicles, ego, dt, _ in calls:
        assert dt == 0.1 and vehicles["origin"][ego] == 0 and vehicles["exponent"][ego] == 0
    assert np.array_equal(calls[-1][0], world.after)
    world.reset(0)
    assert touched_by(world) == (Contact.NONE, -1)


def test_contacts_are_not_watched_once_the_ego_is_struck(calls):
    world = HighwayIntersection(Options())
    for push, struck in ((np.zeros(2), False), (None, True)):
        world.reset(0)
        world.environment.vehicle.impact = push
        world.environment.vehicle.crashed = struck
        world.step(1)
        assert crashed(world) and calls == []


def test_contact_of_a_crash_is_known(varied):
    crashes = 0
    for seed in SEEDS:
        for _ in random_decisions(varied, seed):
            assert varied.environment.road.contacts[0][0] != Contact.NONE or not crashed(varied)
        crashes += crashed(varied)
    assert crashes > 0


STEERED = {
    "brakes and reverses": [-1.0, 0.0],
    "drives on": [0.4, 0.0],
    "bends to the left": [0.0, -0.06],
    "turns to the right": [-0.1, 0.2],
}


@pytest.mark.parametrize("action", STEERED.values(), ids=list(STEERED))
@pytest.mark.parametrize("ends", [False, True])
def test_the_road_ends_where_highway_env_says(action, ends):
    options = ContinuousOptions(actions="continuous_steering", offroad_terminal=ends)
    plain = IntersectionEnv(config=environment_config(options))
    assert plain.config["offroad_terminal"] is ends
    core, left = Intersection(options).batch(1), []
    for seed in SEEDS[:3]:
        core.reset([seed])
        plain.reset(seed=seed)
        over = False
        while not over:
            made = core.step(np.array([action]), auto_reset=False)
            _, _, terminated, truncated, info = plain.step(np.array(action))
            ending = Ending(int(made.ending[0]))
            left.append(not plain.vehicle.on_road)
            assert bool(made.off_road[0]) == left[-1]
            assert terminated == (ending not in (Ending.NONE, Ending.TIMEOUT))
            assert (ending == Ending.COLLISION) == info["crashed"]
            unpaid = ends and not info["crashed"] and not info["rewards"]["on_road_reward"]
            assert (ending == Ending.OTHER) == unpaid
            over = terminated or truncated
    assert any(left) == (action != STEERED["drives on"])


def test_an_ending_is_read_from_highway_env():
    options = ContinuousOptions(actions="continuous_steering", offroad_terminal=True)
    real = Intersection(options).batch(1, back_end="highway_env")
    real.reset([0])
    (row,) = real.real.rows
    row.environment.config["offroad_terminal"] = False
    made = real.step(np.array([[0.0, 1.0]]), auto_reset=False)
    assert made.off_road[0] and made.ending[0] == Ending.NONE
    real = Intersection(ContinuousOptions(actions="continuous_steering")).batch(
        1, back_end="highway_env"
    )
    real.reset([0])
    (row,) = real.real.rows
    row.environment.config["offroad_terminal"] = True
    assert real.step(np.array([[0.0, 1.0]]), auto_reset=False).ending[0] == Ending.OTHER


def test_missing_highway_env_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "highway_env.envs.intersection_env", None)
    with pytest.raises(UserError, match=r"pip install 'socialiq\[highway\]'"):
        runpy.run_path(reference.__file__)
