"""Real highway-env as a reference for the compiled roads; needs the extra `highway`."""

import importlib
from typing import Any

import numpy as np

from socialiq.foreign import optional
from socialiq.types import Ending
from socialiq.worlds.highway.core import drivers
from socialiq.worlds.highway.options import FEATURES, RoadOptions
from socialiq.worlds.highway.scenes import CAR, Scene
from socialiq.worlds.world import Decisions

IDMVehicle: Any = optional("highway_env.vehicle.behavior", "highway", "the reference").IDMVehicle


class Driver(IDMVehicle):
    """highway-env's driver with its own defaults, which its intersection changes for all."""

    DISTANCE_WANTED = drivers.JAM_DISTANCE
    COMFORT_ACC_MAX = drivers.ACCELERATION
    COMFORT_ACC_MIN = -drivers.DECELERATION


class RealScene:
    """The real scene; `environment` is highway-env's own."""

    uncompared: frozenset[str] = frozenset(
        {
            "time_headway", "jam_distance", "max_acceleration", "comfort_deceleration",
            "route", "destination", "obstacle",
        }
    )  # fmt: skip
    """Fields of a record that it doesn't know."""

    def __init__(self, scene: Scene, options: RoadOptions) -> None:
        module, name = scene.real.split(":")
        scales = scene.road.sight[0]
        names = ("x", "y", "vx", "vy")
        ranges = {name: [-float(scales[name]), float(scales[name])] for name in names}
        config = {
            "observation": {
                "type": "Kinematics",
                "vehicles_count": options.observed_vehicles,
                "features": list(FEATURES),
                "features_range": ranges,
                "absolute": not scales["relative"],
            },
            "action": {"type": "DiscreteMetaAction", "target_speeds": list(options.target_speeds)},
            "simulation_frequency": options.simulation_frequency,
            "policy_frequency": options.policy_frequency,
            "duration": 200.0,  # s; only a crash or the task's end ends an episode
            "other_vehicles_type": f"{Driver.__module__}.{Driver.__name__}",
            **scene.config,
        }
        self.environment: Any = getattr(importlib.import_module(module), name)(config=config)

    def reset(self, seed: int) -> np.ndarray:
        """Start an episode, and return the observation."""
        observation, _ = self.environment.reset(seed=seed)
        self._roads = [len(vehicle.route or ()) for vehicle in self.environment.road.vehicles]
        return observation.reshape(-1)

    def step(self, action: int, decisions: Decisions) -> tuple[np.ndarray, bool, float]:
        """Take the decision of which the core's results are given.

        Returns the observation, whether the episode goes on or ends alike (highway-env has no end
        by arrival), and the greatest difference of the rewards, of which it has none.
        """
        observation, _, terminated, _, _ = self.environment.step(int(action))
        goes_on = int(decisions.ending[0]) == Ending.NONE
        return observation.reshape(-1), not (terminated and goes_on), 0.0

    def records(self) -> np.ndarray:
        """Return the vehicles, then the obstacles, CAR."""
        road = self.environment.road
        lanes = list(road.network.lanes_dict())
        records = np.zeros(len(road.vehicles) + len(road.objects), CAR)
        for slot, vehicle in enumerate([*road.vehicles, *road.objects]):
            row = records[slot]
            row["identity"], row["agent"] = slot, 0 if slot == 0 else -1
            write_motion(row, vehicle)
            row["lane"] = lanes.index(vehicle.lane_index)
            if slot >= len(road.vehicles):
                continue
            write_commands(row, vehicle)
            row["target_speed"] = vehicle.target_speed
            row["target_lane"] = lanes.index(vehicle.target_lane_index)
            row["exponent"] = getattr(vehicle, "DELTA", drivers.EXPONENT)
            row["timer"] = getattr(vehicle, "timer", np.nan)
            row["leg"] = self._roads[slot] - len(vehicle.route or ())
        return records


def write_motion(row: Any, vehicle: Any) -> None:
    """Write the pose, the speed and the crash of a vehicle of highway-env into a record."""
    row["x"], row["y"] = vehicle.position
    row["heading"], row["speed"] = vehicle.heading, vehicle.speed
    row["along_x"], row["along_y"] = vehicle.direction
    row["crashed"] = vehicle.crashed


def write_commands(row: Any, vehicle: Any) -> None:
    """Write the commands and the pending push of a vehicle of highway-env into a record."""
    row["steering"] = vehicle.action["steering"]
    row["acceleration"] = vehicle.action["acceleration"]
    if vehicle.impact is not None:
        row["pushed"] = True
        row["push_x"], row["push_y"] = vehicle.impact
