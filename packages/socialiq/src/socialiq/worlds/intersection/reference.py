"""Real highway-env as a reference for the intersection's core.

Checked with highway-env 1.12.1; needs the extra `highway`. highway-env's classes are subclassed,
never changed: an episode of the population `highway_env` is, draw for draw, the episode of a plain
`IntersectionEnv` with the same configuration and seed.

Its results differ in the last bits between CPUs with and without AVX-512. With it NumPy uses other
routines for arcsin, arctan, tan and power, and OpenBLAS another order for sums. They differ by an
ulp, and stopping vehicles magnify that. The variables of `highway.PORTABLE`, set before Python
starts, select the portable routines.
"""

# pyright: reportMissingImports=false
# Type checks also run where the extra is not installed.
import math
from typing import Any, ClassVar

import numpy as np

from socialiq.errors import UserError
from socialiq.types import TERMINAL, Ending
from socialiq.worlds.highway import options as roads
from socialiq.worlds.highway.core import drivers, step
from socialiq.worlds.highway.core import vehicle as kernels
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.populations import Population
from socialiq.worlds.highway.reference import write_commands, write_motion
from socialiq.worlds.intersection import options as scenario
from socialiq.worlds.intersection.core.geometry import ROAD, ROUTES

try:
    from highway_env.envs.common.action import ContinuousAction, MultiAgentAction
    from highway_env.envs.intersection_env import IntersectionEnv
    from highway_env.road.regulation import RegulatedRoad
    from highway_env.vehicle.behavior import IDMVehicle
    from highway_env.vehicle.kinematics import Vehicle
except ImportError as error:
    raise UserError(
        "the reference needs highway-env, which is not installed: pip install 'socialiq[highway]'"
    ) from error


class Driver(IDMVehicle):
    """highway-env's driver with drawn values of the parameters that the population varies.

    A driver with a desired speed enters with it as target. Road rules set the target speed to 0 for
    a yield and to the road's limit after it. The target speed is therefore bounded by the desired
    speed, so that the preference is kept. Subclasses name the population.
    """

    population: ClassVar[Population] = scenario.POPULATIONS["highway_env"]
    desired_speed = math.inf  # until the draw, which follows the construction
    _target_speed = 0.0

    @property
    def target_speed(self) -> float:
        """Speed that the driver aims for on a free road, m/s."""
        return self._target_speed

    @target_speed.setter
    def target_speed(self, value: float | int) -> None:
        self._target_speed = min(float(value), self.desired_speed)

    def randomize_behavior(self) -> None:
        """Draw the exponent, then the fields of the population in their order."""
        super().randomize_behavior()
        values = []
        for normal in self.population:
            value = normal.mean
            if normal.deviation:
                value = normal.mean + normal.deviation * self.road.np_random.normal()
                value = min(max(value, normal.low), normal.high)
            values.append(value)
        desired, self.TIME_WANTED, self.DISTANCE_WANTED, self.COMFORT_ACC_MAX, braking = values
        self.COMFORT_ACC_MIN = -braking
        self.desired_speed = desired
        if math.isfinite(desired):
            self.target_speed = desired  # pyright: ignore[reportIncompatibleVariableOverride]


DRIVERS: dict[str, type] = {"highway_env": IDMVehicle} | {
    name: type(f"Driver_{name}", (Driver,), {"population": population, "__module__": __name__})
    for name, population in scenario.POPULATIONS.items()
    if name != "highway_env"
}
"""Class of the other vehicles in each population."""
# highway-env resolves its drivers by dotted path.
globals().update({driver.__name__: driver for driver in DRIVERS.values()})


contact_of = for_python(kernels.contact_of)
arrived = for_python(drivers.arrived)
coordinate = for_python(drivers.coordinate)


def environment_config(options: scenario.Options) -> dict[str, Any]:
    """Return the configuration of highway-env's `IntersectionEnv` for a scenario.

    Nested dictionaries are complete, because highway-env replaces them and adds no defaults.
    `flatten` is left out: highway-env accepts the key and ignores it.
    """
    metres = [-scenario.POSITION_RANGE, scenario.POSITION_RANGE]
    speed = [-scenario.SPEED_RANGE, scenario.SPEED_RANGE]
    driver = DRIVERS[options.population]
    action = {"type": "ContinuousAction", "longitudinal": True, "lateral": options.width == 2}
    if not options.continuous:
        speeds = list(options.target_speeds)
        action |= {"type": "DiscreteMetaAction", "lateral": False, "target_speeds": speeds}
    arms = {"left": "o1", "straight": "o2", "right": "o3", "random": None}
    observation: dict[str, Any] = {
        "type": "Kinematics",
        "vehicles_count": options.observed_vehicles,
        "features": list(roads.FEATURES),
        "features_range": {"x": metres, "y": metres, "vx": speed, "vy": speed},
        "absolute": True,
        "order": "sorted",
        "normalize": True,
        "clip": True,
        "see_behind": False,
        "observe_intentions": False,
    }
    if isinstance(options, roads.AgentOptions):
        if (options.ends, options.frame) != ("joint", "world") or options.agents > 4:
            raise UserError(
                "highway-env has up to 4 agents that end together in one frame: choose the "
                "options ends='joint', frame='world'"
            )
        observation = {"type": "MultiAgentObservation", "observation_config": observation}
        action = {"type": "MultiAgentAction", "action_config": action}
    return {
        "observation": observation,
        "action": action,
        "simulation_frequency": options.simulation_frequency,
        "policy_frequency": options.policy_frequency,
        "duration": options.duration,
        "initial_vehicle_count": options.initial_vehicle_count,
        "spawn_probability": options.spawn_probability,
        "destination": arms[options.destination],
        "controlled_vehicles": options.agents,
        "offroad_terminal": isinstance(options, roads.ControlOptions) and options.offroad_terminal,
        "neighbour_vehicles_connected_lanes": options.connected_lanes,
        "other_vehicles_type": f"{driver.__module__}.{driver.__name__}",
    }


_NOTHING = int(roads.Contact.NONE), -1


class _SteeredVehicle(Vehicle):
    """highway-env's vehicle with continuous actions, which records where it was sent."""

    def plan_route_to(self, destination: str) -> None:
        """Record the destination; like the base class, it can't plan."""
        self.planned = destination
        raise AttributeError("no route is planned")


class _SteeredAction(ContinuousAction):
    """highway-env's continuous actions of a vehicle that records where it was sent."""

    @property
    def vehicle_class(self) -> type:
        """Class of the ego."""
        return _SteeredVehicle


class _SteeredFleet(MultiAgentAction):
    """highway-env's actions of several such vehicles."""

    @property
    def vehicle_class(self) -> type:
        """Class of the agents."""
        return _SteeredVehicle


class _WatchedRoad(RegulatedRoad):
    """highway-env's road that records entries and the agents' contacts."""

    def __init__(self, road: RegulatedRoad) -> None:
        super().__init__(
            road.network,
            np_random=road.np_random,
            neighbour_vehicles_connected_lanes=road.neighbour_vehicles_connected_lanes,
        )
        self.agents: list[Any] = []
        self.contacts: list[tuple[int, int]] = []  # Contact and identity of what was touched
        # Identity, origin and destination, which are lost once a part of the route is driven.
        self._entries: dict[Any, tuple[int, int, int]] = {}
        lanes = ((start, end) for start, ends in road.network.graph.items() for end in ends)
        self._lane_numbers = {lane: number for number, lane in enumerate(lanes)}

    def enter(self, vehicle: Any) -> int:
        """Number a vehicle that has just entered, and record its origin and destination."""
        destination = getattr(vehicle, "planned", None) or vehicle.route[-1][1]
        origin = vehicle.lane_index[0]
        identity = len(self._entries)
        self._entries[vehicle] = identity, int(origin[1:]), int(destination[1:])
        return identity

    def step(self, dt: float) -> None:
        """Advance by a sub-step; the agents' contacts are determined before they crash."""
        untouched = [not agent.crashed and agent.impact is None for agent in self.agents]
        super().step(dt)
        for number, agent in enumerate(self.agents):
            if untouched[number]:
                slot = self.vehicles.index(agent)
                contact, touched = contact_of(self.records(), slot, dt, *self.contacts[number])
                self.contacts[number] = int(contact), int(touched)

    def records(self) -> np.ndarray:
        """Return the current vehicles in list order, VEHICLE (vehicles,)."""
        records = np.zeros(len(self.vehicles), roads.VEHICLE)
        for row, vehicle in zip(records, self.vehicles, strict=True):
            write_motion(row, vehicle)
            write_commands(row, vehicle)
            row["target_speed"] = getattr(vehicle, "target_speed", scenario.SPEED_LIMIT)
            row["identity"], row["origin"], row["destination"] = self._entries[vehicle]
            row["lane"] = self._lane_numbers[vehicle.lane_index[:2]]
            entry = f"o{row['origin']}", f"ir{row['origin']}"
            target = getattr(vehicle, "target_lane_index", entry)
            row["target_lane"] = self._lane_numbers[target[:2]]
            legs = (ROUTES[row["origin"], row["destination"]] >= 0).sum()
            row["route"] = ROAD.arrivals[row["origin"], row["destination"]]
            # highway-env gives an agent with continuous actions no target lane and no route
            row["leg"] = legs - len(vehicle.route) if hasattr(vehicle, "route") else 0
            row["agent"] = self.agents.index(vehicle) if vehicle in self.agents else -1
            row["yielding"] = getattr(vehicle, "is_yielding", False)
            row["desired_speed"] = getattr(vehicle, "desired_speed", math.inf)
            if isinstance(vehicle, IDMVehicle):  # the ego has no driver model, and keeps zeros
                row["time_headway"] = vehicle.TIME_WANTED
                row["jam_distance"] = vehicle.DISTANCE_WANTED
                row["max_acceleration"] = vehicle.COMFORT_ACC_MAX
                row["comfort_deceleration"] = -vehicle.COMFORT_ACC_MIN
                row["exponent"] = vehicle.DELTA
        return records


class _WatchedEnv(IntersectionEnv):
    """highway-env's intersection on a recording road; `after` has vehicles before clearing."""

    road: Any
    after: np.ndarray
    action_type: Any

    def define_spaces(self) -> None:
        super().define_spaces()
        action = self.config["action"]
        kinds = [action["type"], action.get("action_config", {}).get("type")]
        if "ContinuousAction" in kinds:
            kind = _SteeredAction if kinds[0] == "ContinuousAction" else _SteeredFleet
            self.action_type = kind(self, **action)

    def _make_road(self) -> None:
        super()._make_road()
        self.road = _WatchedRoad(self.road)

    def _make_vehicles(self, n_vehicles: int = 10) -> None:
        super()._make_vehicles(n_vehicles)
        self.road.agents = self.controlled_vehicles
        self.road.contacts = [_NOTHING] * len(self.controlled_vehicles)
        for vehicle in self.controlled_vehicles:
            self.road.enter(vehicle)

    def _spawn_vehicle(self, *where: Any, **how: Any) -> Any:
        vehicle: Any = super()._spawn_vehicle(*where, **how)
        if vehicle is not None:
            self.road.enter(vehicle)
        return vehicle

    def _clear_vehicles(self) -> None:
        self.after = self.road.records()
        super()._clear_vehicles()


class HighwayIntersection:
    """Real highway-env, one episode at a time, converted to the core's records.

    The state of an episode is recorded at three moments of a step. After a reset all three are the
    initial state.

    `before` has the vehicles at the decision, and `after` those after the sub-steps, before
    clearing and spawning. Observation, endings and rewards belong to the moment of `after`.
    """

    def __init__(self, options: scenario.Options) -> None:
        self.environment = _WatchedEnv(config=environment_config(options))
        self._several = isinstance(options, roads.AgentOptions)
        # as highway-env says of the last step: whether episode and agents have ended
        self.over = False
        self.agents_terminated = (False,) * options.agents
        self.rewards = np.zeros(1 + options.agents)  # highway-env's: their mean, then the agents'
        self.reset()

    def reset(self, seed: int | None = None) -> np.ndarray:
        """Start an episode, or without a seed continue the stream; return the observation."""
        observation, _ = self.environment.reset(seed=seed)
        self.before = self.after = self.vehicles
        return np.concatenate(observation, axis=None)

    def step(self, action: Any) -> np.ndarray:
        """Take one decision, and return the observation."""
        self.before = self.vehicles
        chosen: Any = tuple(action) if self._several else action
        observation, reward, terminated, truncated, facts = self.environment.step(chosen)
        self.over = terminated or truncated
        self.agents_terminated = (terminated,)
        self.after = self.environment.after
        self.rewards = np.array([reward, *facts["agents_rewards"]])
        if self._several:
            self.agents_terminated = facts["agents_terminated"]
        return np.concatenate(observation, axis=None)

    @property
    def vehicles(self) -> np.ndarray:
        """Current vehicles, after clearing and spawning, VEHICLE (vehicles,)."""
        return self.environment.road.records()


def controlled(vehicles: np.ndarray) -> np.ndarray:
    """Return the agents' slots, in the order of their numbers."""
    slots = np.flatnonzero(vehicles["agent"] >= 0)
    return slots[np.argsort(vehicles["agent"][slots])]


def rewards_of(buffers: roads.Buffers, off_road: np.ndarray) -> np.ndarray:
    """Return highway-env's own rewards of the last decision of one episode, as it defines them.

    Args:
        buffers: Arrays of a batch of one episode.
        off_road: Whether each agent is off the road, bool (agent,).

    Returns:
        The mean over the agents, then each agent's reward.
    """
    rewards = []
    for slot, left in zip(buffers.present[0, 1:], off_road, strict=True):
        vehicle = buffers.after[0, slot]
        fast = np.clip(0 + (vehicle["speed"] - 7.0) * (1 - 0) / (9.0 - 7.0), 0, 1)
        reward = 1 if arrived(vehicle, ROAD) else -5 * int(vehicle["crashed"]) + fast
        rewards.append(reward * (not left))
    return np.array([sum(rewards) / len(rewards), *rewards])


class Reference:
    """One highway-env for each row of the buffers, in the place of the core."""

    def __init__(self, options: scenario.Options, buffers: roads.Buffers) -> None:
        self._buffers = buffers
        self._settings = roads.settings_of(options)
        self._several = isinstance(options, roads.AgentOptions)
        self.rows = [HighwayIntersection(options) for _ in buffers.episodes]

    def run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        """Carry out one command for each episode.

        The core computes endings and rewards of highway-env's states. An ending that is terminal in
        only one of core and highway-env is corrected, so that a comparison finds the difference.

        Args:
            commands: One of the commands of `highway.options` for each episode.
            seeds: Seed of each episode, uint64.
            seeded: Whether a reset takes the seed, bool; else it continues the stream.
            actions: Actions of all agents.
        """
        buffers = self._buffers
        decided = np.isin(commands, (roads.DECIDE, roads.DECIDE_AND_RESET))
        observation = np.zeros_like(buffers.reached)
        agents = buffers.present.shape[1] - 1
        for row in np.flatnonzero(decided):
            real = self.rows[row]
            here = slice(row * agents, (row + 1) * agents)
            observed = real.step(actions[here] if self._several else actions[row])
            observation[here] = observed.reshape(observation[here].shape)
            buffers.before[row, : len(real.before)] = real.before
            buffers.after[row, : len(real.after)] = real.after
            buffers.present[row] = len(real.after), *controlled(real.after)
            self._write(row)
        annotated = np.where(decided, roads.ANNOTATE, roads.SKIP).astype(np.int8)
        unseeded = np.zeros_like(decided)
        unused = np.zeros(len(buffers.ending), np.int64)
        rows = 0, len(commands)
        step.run(buffers, annotated, seeds, unseeded, unused, self._settings, ROAD, *rows)
        for row in np.flatnonzero(decided):
            for number, terminated in enumerate(self.rows[row].agents_terminated):
                result = row * agents + number
                if terminated != (buffers.ending[result] in TERMINAL):
                    buffers.ending[result] = int(Ending.OTHER if terminated else Ending.NONE)
        shown = np.repeat(decided, agents)
        buffers.reached[shown] = observation[shown]
        buffers.observation[shown] = observation[shown]
        over = roads.is_over(buffers.ending.reshape(-1, agents), joint=True)
        for row in np.flatnonzero(
            (commands == roads.RESET) | (commands == roads.DECIDE_AND_RESET) & over
        ):
            here = slice(row * agents, (row + 1) * agents)
            begun = self.rows[row].reset(int(seeds[row]) if seeded[row] else None)
            buffers.observation[here] = begun.reshape(buffers.observation[here].shape)
            buffers.episodes[row]["ended"] = int(Ending.NONE)
            self._write(row)
            for number, slot in enumerate(controlled(self.rows[row].vehicles)):
                start = coordinate(buffers.vehicles[row][slot], ROAD)
                buffers.episodes[row]["start"][number] = start

    def _write(self, row: Any) -> None:
        """Write the present vehicles and the facts of the episode."""
        real = self.rows[row]
        episode = self._buffers.episodes[row]
        vehicles = real.vehicles
        environment = real.environment
        self._buffers.vehicles[row, : len(vehicles)] = vehicles
        slots = controlled(vehicles)
        contacts = np.array(environment.road.contacts)
        episode["vehicles"] = len(vehicles)
        episode["time"] = environment.time
        episode["controlled"][: len(slots)] = slots
        episode["contact"][: len(slots)], episode["touched"][: len(slots)] = contacts.T
