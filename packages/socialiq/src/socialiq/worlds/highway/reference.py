"""Comparison of a scene with the real highway-env: same seeds, same actions, every field.

Checked with highway-env 1.12.1; needs the extra `highway`. As for the intersection, equal bits need
the portable arithmetic of `highway.PORTABLE`.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.highway import Compared
from socialiq.worlds.highway.core import drivers
from socialiq.worlds.highway.options import RoadOptions
from socialiq.worlds.highway.scenes import ACTIONS, CAR, FASTER, IDLE, LANE_LEFT, SLOWER, Scene
from socialiq.worlds.highway.state import FEATURES
from socialiq.worlds.highway.world import Batch, world_of

try:
    # Type checks also run where the extra is not installed.
    from highway_env.vehicle.behavior import IDMVehicle  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise UserError(
        "the reference needs highway-env, which is not installed: pip install 'socialiq[highway]'"
    ) from error

DISCRETE = tuple(name for name in CAR.names or () if not np.issubdtype(CAR[name], np.floating))
CONTINUOUS = tuple(name for name in CAR.names or () if name not in DISCRETE)
LONGEST = 200.0  # s; only a crash or the task's end ends an episode there


class Driver(IDMVehicle):
    """highway-env's driver with its own defaults, which its intersection changes for all."""

    DISTANCE_WANTED = drivers.JAM_DISTANCE
    COMFORT_ACC_MAX = drivers.ACCELERATION
    COMFORT_ACC_MIN = -drivers.DECELERATION


def configuration(scene: Scene, options: RoadOptions) -> dict[str, Any]:
    """Return highway-env's configuration of a scene."""
    sight = scene.road.sight[0]
    ranges = {name: [-float(sight[name]), float(sight[name])] for name in ("x", "y", "vx", "vy")}
    return {
        "observation": {
            "type": "Kinematics",
            "vehicles_count": options.observed_vehicles,
            "features": list(FEATURES),
            "features_range": ranges,
            "absolute": not sight["relative"],
        },
        "action": {"type": "DiscreteMetaAction", "target_speeds": list(options.target_speeds)},
        "simulation_frequency": options.simulation_frequency,
        "policy_frequency": options.policy_frequency,
        "duration": LONGEST,
        "other_vehicles_type": f"{Driver.__module__}.{Driver.__name__}",
        **scene.config,
    }


class RealScene:
    """The real scene, one episode at a time, converted to the core's records.

    Args:
        scene: The scene.
        options: Its options.

    Attributes:
        environment: highway-env's environment itself.
    """

    def __init__(self, scene: Scene, options: RoadOptions) -> None:
        module, name = scene.real.split(":")
        environment = getattr(importlib.import_module(module), name)
        self.environment: Any = environment(config=configuration(scene, options))
        self._scene = scene

    def reset(self, seed: int) -> np.ndarray:
        """Start an episode, and return the observation."""
        observation, _ = self.environment.reset(seed=seed)
        self._roads = [len(vehicle.route or ()) for vehicle in self.environment.road.vehicles]
        return observation.reshape(-1)

    def step(self, action: int) -> tuple[np.ndarray, bool]:
        """Take one decision; return the observation, and whether the episode ended there."""
        observation, _, terminated, _, _ = self.environment.step(action)
        return observation.reshape(-1), bool(terminated)

    def cars(self) -> np.ndarray:
        """Return the vehicles, then the obstacles, as CAR records."""
        road = self.environment.road
        lanes = list(road.network.lanes_dict())
        records = np.zeros(len(road.vehicles) + len(road.objects), CAR)
        for slot, vehicle in enumerate([*road.vehicles, *road.objects]):
            row = records[slot]
            row["identity"] = slot
            row["x"], row["y"] = vehicle.position
            row["heading"], row["speed"] = vehicle.heading, vehicle.speed
            row["along_x"], row["along_y"] = vehicle.direction
            row["lane"] = lanes.index(vehicle.lane_index)
            row["crashed"] = vehicle.crashed
            if slot < len(road.vehicles):
                self._write(row, vehicle, lanes, self._roads[slot])
        return records

    def _write(self, row: Any, vehicle: Any, lanes: list[Any], roads: int) -> None:
        row["steering"] = vehicle.action["steering"]
        row["acceleration"] = vehicle.action["acceleration"]
        row["target_speed"] = vehicle.target_speed
        row["target_lane"] = lanes.index(vehicle.target_lane_index)
        row["exponent"] = getattr(vehicle, "DELTA", drivers.EXPONENT)
        row["timer"] = getattr(vehicle, "timer", np.nan)
        if vehicle.impact is not None:
            row["pushed"] = True
            row["push_x"], row["push_y"] = vehicle.impact
        row["leg"] = roads - len(vehicle.route or ())


_UNKNOWN = ("time_headway", "jam_distance", "max_acceleration", "comfort_deceleration")
_UNCOMPARED = {*_UNKNOWN, "route", "destination", "obstacle"}


def compare(scene: str, episodes: int, seed: int) -> Iterator[Compared]:
    """Run seeded episodes of a scene on the core and on highway-env, and compare every decision.

    Actions are drawn; in every fourth episode the ego keeps its lane and goes faster, in another
    it only changes its speed.

    Args:
        scene: Name of the scene.
        episodes: Number of episodes.
        seed: Seed of the first episode; episode i has seed + i.

    Raises:
        UserError: If `episodes` is below 1, or the scene is unknown.
    """
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    core = world_of(scene).batch(1)
    real = RealScene(core.scene, core.options)
    for number in range(episodes):
        rng = np.random.default_rng(seed + number)
        allowed = ((FASTER,), (IDLE, FASTER, SLOWER), range(LANE_LEFT, len(ACTIONS)))
        yield _episode(core, real, rng, np.array(allowed[min(number % 4, 2)]), seed + number)


def _episode(
    core: Batch, real: RealScene, rng: np.random.Generator, allowed: np.ndarray, seed: int
) -> Compared:
    deviation_seen = np.abs(core.reset([seed]) - real.reset(seed)).max()
    discrete, deviation = _differences(core.buffers.vehicles[0], real.cars())
    worst, steps, left, going = np.array([deviation, deviation_seen]), 0, False, not discrete
    while going:
        action = int(rng.choice(allowed))
        decisions = core.step(np.array([action]), auto_reset=False)
        observation, ended = real.step(action)
        steps, left = steps + 1, left or bool(decisions.off_road[0])
        discrete, deviation = _differences(core.buffers.vehicles[0], real.cars())
        worst = np.maximum(worst, [deviation, np.abs(decisions.observation[0] - observation).max()])
        going = int(decisions.ending[0]) == Ending.NONE
        if discrete or (ended and going):
            discrete, going = 1, False
    return Compared(seed, steps, discrete, float(worst[0]), float(worst[1]), 0.0, left)


def _differences(ours: np.ndarray, theirs: np.ndarray) -> tuple[int, float]:
    """Return whether a discrete field differs, and the greatest difference of the others."""
    if len(ours) != len(theirs):
        return 1, np.inf
    vehicles = ~ours["obstacle"]
    compared = [name for name in DISCRETE if name not in _UNCOMPARED]
    for name in compared:
        rows = slice(None) if name in ("identity", "crashed") else vehicles
        if not np.array_equal(ours[name][rows], theirs[name][rows]):
            return 1, 0.0
    worst = 0.0
    for name in CONTINUOUS:
        if name not in _UNCOMPARED:
            apart = np.abs(ours[name][vehicles] - theirs[name][vehicles])
            worst = max(worst, float(np.nanmax(apart)))
    return 0, worst
