"""Real highway-env as a reference for the compiled roads; needs the extra `highway`."""

import importlib
from typing import Any

import numpy as np

from socialiq.foreign import optional
from socialiq.types import Ending
from socialiq.worlds.highway import options as roads
from socialiq.worlds.highway.options import FEATURES, VEHICLE, RoadOptions
from socialiq.worlds.highway.scenes import Scene
from socialiq.worlds.world import Decisions

IDMVehicle: Any = optional("highway_env.vehicle.behavior", "highway", "the reference").IDMVehicle


class Driver(IDMVehicle):
    """highway-env's driver with its own defaults, which its intersection changes for all."""

    DISTANCE_WANTED = roads.DRIVER.jam_distance
    COMFORT_ACC_MAX = roads.DRIVER.max_acceleration
    COMFORT_ACC_MIN = -roads.DRIVER.comfort_deceleration


class RealScene:
    """The real scene; `environment` is highway-env's own."""

    uncompared: frozenset[str] = frozenset(
        {
            "time_headway", "jam_distance", "max_acceleration", "comfort_deceleration",
            "desired_speed", "origin", "route", "destination", "changes", "obstacle",
        }
    )  # fmt: skip
    """Fields of a record that it doesn't know."""

    def __init__(self, scene: Scene, options: RoadOptions) -> None:
        module, name = scene.real.split(":")
        scales = scene.road.sight[0]
        names = ("x", "y", "vx", "vy")
        ranges = {name: [-float(scales[name]), float(scales[name])] for name in names}
        action: dict[str, Any] = {"type": "DiscreteMetaAction"}
        action["target_speeds"] = list(options.target_speeds)
        if options.continuous:
            action = {"type": "ContinuousAction", "lateral": options.width == 2}
        config = {
            "observation": {
                "type": "Kinematics",
                "vehicles_count": options.observed_vehicles,
                "features": list(FEATURES),
                "features_range": ranges,
                "absolute": not scales["relative"],
            },
            "action": action,
            "simulation_frequency": options.simulation_frequency,
            "policy_frequency": options.policy_frequency,
            "duration": 200.0,  # s; only a crash or the task's end ends an episode
            "other_vehicles_type": f"{Driver.__module__}.{Driver.__name__}",
            **scene.config,
        }
        kind: Any = getattr(importlib.import_module(module), name)
        if options.continuous:  # which its rewards don't know
            unpaid = {"_reward": lambda *_: 0.0, "_rewards": lambda *_: {}}
            kind = type(name, (kind,), unpaid)
        self.environment: Any = kind(config=config)

    def reset(self, seed: int) -> np.ndarray:
        """Start an episode, and return the observation."""
        observation, _ = self.environment.reset(seed=seed)
        vehicles = self.environment.road.vehicles
        self._roads = [len(getattr(vehicle, "route", None) or ()) for vehicle in vehicles]
        return observation.reshape(-1)

    def step(self, action: Any, decisions: Decisions) -> tuple[np.ndarray, bool, float]:
        """Take the decision of which the core's results are given.

        Args:
            action: Number of the action, or values in [-1, 1].
            decisions: The core's results of the same decision.

        Returns:
            The observation; whether the episode goes on or ends alike (highway-env has no end by
            arrival); and 0, the greatest difference of the rewards, which highway-env does not
            have.
        """
        observation, _, terminated, _, _ = self.environment.step(action)
        goes_on = int(decisions.ending[0]) == Ending.NONE
        return observation.reshape(-1), not (terminated and goes_on), 0.0

    def records(self) -> np.ndarray:
        """Return the vehicles, then the obstacles, VEHICLE."""
        road = self.environment.road
        lanes = list(road.network.lanes_dict())
        records = np.zeros(len(road.vehicles) + len(road.objects), VEHICLE)
        for slot, vehicle in enumerate([*road.vehicles, *road.objects]):
            row = records[slot]
            row["identity"] = slot
            row["agent"] = 0 if slot == 0 else -1
            write_motion(row, vehicle)
            row["lane"] = lanes.index(vehicle.lane_index)
            if slot >= len(road.vehicles):
                continue
            write_commands(row, vehicle)
            row["target_speed"] = getattr(vehicle, "target_speed", 0.0)
            target = getattr(vehicle, "target_lane_index", vehicle.lane_index)
            row["target_lane"] = lanes.index(target)
            row["exponent"] = getattr(vehicle, "DELTA", roads.EXPONENT)
            row["timer"] = getattr(vehicle, "timer", np.nan)
            row["leg"] = self._roads[slot] - len(getattr(vehicle, "route", None) or ())
        return records


def write_motion(row: Any, vehicle: Any) -> None:
    """Write the pose, the speed and the crash of a vehicle of highway-env into a record.

    Args:
        row: Record that is written to.
        vehicle: highway-env's vehicle or obstacle.
    """
    row["x"], row["y"] = vehicle.position
    row["heading"] = vehicle.heading
    row["speed"] = vehicle.speed
    row["along_x"], row["along_y"] = vehicle.direction
    row["crashed"] = vehicle.crashed


def write_commands(row: Any, vehicle: Any) -> None:
    """Write the commands and the pending push of a vehicle of highway-env into a record.

    Args:
        row: Record that is written to; without a pending push these fields stay as they are.
        vehicle: highway-env's vehicle.
    """
    row["steering"] = vehicle.action["steering"]
    row["acceleration"] = vehicle.action["acceleration"]
    if vehicle.impact is not None:
        row["pushed"] = True
        row["push_x"], row["push_y"] = vehicle.impact
