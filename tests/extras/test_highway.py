"""The reference is highway-env itself, draw for draw, and its records say what highway-env holds."""

import runpy
import sys
from functools import cache

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.worlds.intersection.geometry import LANES
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.population import POPULATIONS
from socialiq.worlds.intersection.state import Contact

pytest.importorskip("highway_env", reason="extra `highway` is not installed")

from highway_env.envs.intersection_env import IntersectionEnv

from socialiq.worlds.intersection import highway
from socialiq.worlds.intersection.highway import HighwayIntersection, environment_config

SEEDS = range(4)


@cache
def reference(population="highway_env", connected_lanes=False):
    return HighwayIntersection(Options(population=population, connected_lanes=connected_lanes))


def decisions(world, seed):
    """Yield after each random decision of an episode."""
    random = np.random.default_rng(seed)
    world.reset(seed)
    while not (world.terminated or world.truncated):
        world.step(int(random.integers(3)))
        yield


def assert_equal_to_plain(world, plain, seed):
    random = np.random.default_rng(seed)
    np.testing.assert_array_equal(world.reset(seed), plain.reset(seed=seed)[0].ravel())
    while not (world.terminated or world.truncated):
        action = int(random.integers(3))
        observation = world.step(action)
        expected, _, terminated, truncated, info = plain.step(action)
        assert observation.dtype == np.float32
        np.testing.assert_array_equal(observation, expected.ravel())
        assert (world.terminated, world.truncated) == (terminated, truncated)
        assert (world.crashed, world.time) == (info["crashed"], plain.time)
        assert world.arrived == plain.has_arrived(plain.vehicle)


@pytest.mark.parametrize("connected_lanes", [False, True])
@pytest.mark.parametrize("population", POPULATIONS)
def test_watching_changes_no_episode(population, connected_lanes):
    world = reference(population, connected_lanes)
    plain = IntersectionEnv(config=environment_config(Options(**_chosen(world))))
    for seed in SEEDS[:2]:
        assert_equal_to_plain(world, plain, seed)


def _chosen(world):
    config = world.environment.config
    names = [name for name, kind in highway.DRIVERS.items() if _path(kind) == _type(config)]
    lanes = config["neighbour_vehicles_connected_lanes"]
    return {"population": names[0], "connected_lanes": lanes}


def _path(kind):
    return f"{kind.__module__}.{kind.__name__}"


def _type(config):
    return config["other_vehicles_type"]
