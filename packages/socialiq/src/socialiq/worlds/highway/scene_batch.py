"""Episodes of any road from its table, side by side: its features follow from the options."""

from __future__ import annotations

import functools
import importlib
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.errors import UserError, one_of
from socialiq.types import RewardPair
from socialiq.worlds.highway import people
from socialiq.worlds.highway.along_route import AlongRoute
from socialiq.worlds.highway.batch import RoadBatch, State
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.observation import AGENT
from socialiq.worlds.highway.options import (
    ACCELERATION_RANGE,
    SIGNALS,
    SKIP,
    STEERING_RANGE,
    VEHICLE,
    Buffers,
    RoadOptions,
    settings_of,
)
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.highway.scenes import SIDES, Scene
from socialiq.worlds.world import Decisions

BackEnd = Literal["core", "highway_env"]


@functools.lru_cache(maxsize=64)
def along_route_of(scene: Scene, options: RoadOptions) -> AlongRoute:
    """Return the schema along the route of a scene's agents."""
    model = EgoModel.of(options, scene.road.sight, scene.actions, scene.road.speed_limit)
    return AlongRoute(model, options.max_speed, scene.road)


def agents_of(schema: AlongRoute, agents: np.ndarray, scene: Scene, walks: bool) -> np.ndarray:
    """Return what agents know of themselves by their records, AGENT records.

    Args:
        schema: Schema along the route, whose routes are made where they are new.
        agents: Records of the agents' vehicles, (agent,).
        scene: The scene.
        walks: Whether people cross.
    """
    from socialiq.worlds.highway.ways import route_of  # imports Numba

    known = np.zeros(len(agents), AGENT)
    table = scene.road.routes.shape[1], len(scene.road.lanes)
    keys = (agents["route"].astype(np.int64) + 1) * table[0] + agents["destination"] + 1
    keys = keys * table[1] + agents["target_lane"]
    known["way"] = schema.numbers(keys, lambda at: route_of(agents[at], scene.road, walks))
    known["target_speed"] = agents["target_speed"]
    known["cos"] = 1.0
    return known


def commands(actions: Float[np.ndarray, "row value"]) -> list[Float[np.ndarray, " row"]]:
    """Return the acceleration, m/s², and the front wheels' angle, rad, of continuous actions.

    They are computed in highway-env's order of operations and in the actions' own precision;
    float32 rounds differently from float64. Without a second column the wheels stand straight.
    """
    ranges = zip(actions.T, (ACCELERATION_RANGE, STEERING_RANGE), strict=False)
    held = [low + (values - -1) * (high - low) / (1 - -1) for values, (low, high) in ranges]
    return held if len(held) == 2 else [*held, np.zeros(len(actions))]


class Batch(RoadBatch):
    """Episodes of one scene side by side; see `RoadBatch`.

    The options decide what is in it: several agents, continuous actions, people. The back end
    "highway_env" is the real environment, hundreds of times slower. With `traced`, `buffers.trace`
    has the vehicles of every sub-step, for films.

    Raises:
        UserError: If a number is not positive, more agents are controlled than the road has
            entries, or highway-env is requested and is not installed or lacks the scene.
    """

    def __init__(
        self,
        scene: Scene,
        options: RoadOptions,
        size: int,
        threads: int = 1,
        traced: bool = False,
        back_end: BackEnd = "core",
        effects: EffectOptions | None = None,
        by_class: bool = False,
    ) -> None:
        one_of("back end", back_end, ("core", "highway_env"))
        road = scene.road
        if not len(road.arrivals) and options.agents > len(road.entries):
            raise UserError(
                f"{scene.name} has {len(road.entries)} vehicles: choose at most as many agents, "
                f"not {options.agents}"
            )
        most = options.capacity + len(road.entries) + len(road.obstacles)
        buffers = Buffers.of(options, VEHICLE, most, size, traced or effects is not None)
        settings = settings_of(options, road.speed_limit)
        super().__init__(options, buffers, settings, threads, effects)
        self.scene = scene
        self.n_actions = len(scene.actions)
        self.faster = scene.actions.index("faster")
        self.idle = scene.actions.index("idle")
        self._slower = scene.actions.index("slower")
        self.walks = options if isinstance(options, PeopleOptions) else None
        self._along = along_route_of(scene, options) if options.along_route else None
        self._by_class = by_class
        self.real: Any = None
        if back_end == "highway_env":
            if effects is not None:
                raise UserError("highway-env can't drive without its ego: use the core")
            if not scene.back_end:
                raise UserError(f"{scene.name} has no back end highway_env: use the core")
            module, name = scene.back_end.split(":")
            self.real = getattr(importlib.import_module(module), name)(options, self.buffers)

    def _core(self) -> tuple[Any, Any, np.ndarray]:
        from socialiq.worlds.highway.core import step  # import Numba only when it is needed

        return step, self.scene.road, self.scene.road.lanes

    def _run(self, command: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        if self.real is not None:
            self.real.run(command, seeds, seeded, actions)
            return
        if self.walks:
            people.begin_decision(self.buffers, command != SKIP)
        if actions.ndim == 2:
            self._hold(actions, command != SKIP)
            actions = np.zeros(len(actions), np.int64)
        super()._run(command, seeds, seeded, actions)

    def _agents(self, results: Int64[np.ndarray, " chosen"]) -> np.ndarray:
        assert self._along is not None
        buffers = self.buffers
        rows, numbers = np.divmod(results, self.options.agents)
        controlled = buffers.episodes["controlled"][rows, numbers]
        left = buffers.after[rows, buffers.present[rows, 1 + numbers]]  # as it was when it left
        vehicles = np.where(controlled >= 0, buffers.vehicles[rows, controlled], left)
        agents = agents_of(self._along, vehicles, self.scene, self.walks is not None)
        seconds = self.clocks[results] / self.options.policy_frequency
        agents["seconds_left"] = self.options.duration - seconds
        if self._settings["own_frame"][0]:
            agents["cos"], agents["sin"] = self.road.frames[vehicles["origin"]].T
        available = self.action_mask.reshape(-1, self.n_actions)[results]
        agents["left"], agents["right"] = (
            available[:, self.scene.actions.index(action)] for action in SIDES
        )
        return agents

    @property
    def equivalent_actions(self) -> Int64[np.ndarray, "*batch action"]:
        """For each action the first one that selects the same target speed and lane."""
        if self.options.continuous:
            return super().equivalent_actions
        from socialiq.worlds.highway.core import step  # import Numba only when it is needed

        slots = self.buffers.episodes["controlled"][:, : self.options.agents]
        speeds = np.zeros((*slots.shape, self.n_actions))
        lanes = np.zeros(speeds.shape, np.int64)
        arguments = self._settings, self.scene.road, speeds, lanes
        step.choices(self.buffers.vehicles, slots, *arguments, 0, self.size)
        same = (speeds[..., None] == speeds[..., None, :]) & (
            lanes[..., None] == lanes[..., None, :]
        )
        return same.argmax(axis=-1).reshape(*self.shape, -1)

    def _hold(self, actions: Float[np.ndarray, "row value"], deciding: np.ndarray) -> None:
        """Write continuous actions into the records of the agents that drive."""
        controlled = self.buffers.episodes["controlled"][:, : self.options.agents]
        rows, agents = np.nonzero(deciding[:, None] & (controlled >= 0))
        acceleration, steering = commands(actions[rows * self.options.agents + agents])
        vehicles = rows, controlled[rows, agents]
        self.buffers.vehicles["acceleration"][vehicles] = acceleration
        self.buffers.vehicles["steering"][vehicles] = steering

    @property
    def _resets_in_core(self) -> bool:
        return super()._resets_in_core and not self.walks

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of the signals that define the rewards, without effects."""
        return (*SIGNALS, *self.walks.signals) if self.walks else SIGNALS

    def near(self, seconds: float) -> Bool[np.ndarray, " row"]:
        """Return whether each first agent reaches a person within some seconds.

        The person comes into its lane or is in it (`core.people.near`).

        Args:
            seconds: Time, s.
        """
        from socialiq.worlds.highway.core.compile import run_in_parts
        from socialiq.worlds.highway.core.people import near

        buffers = self.buffers
        people_near = np.zeros(self.size, bool)
        records = buffers.episodes, buffers.vehicles, buffers.people
        options = self.road, self._settings, float(seconds)
        run_in_parts(near, 1, self.size, *records, *options, people_near)
        return people_near

    def braked(self, actions: np.ndarray) -> np.ndarray:
        """Return the actions that brake most; the steering of continuous ones is kept.

        Args:
            actions: Actions of some or all rows.
        """
        if not self.options.continuous:
            return np.full_like(actions, self._slower)
        braking = np.array(actions)
        braking[..., 0] = -1.0
        return braking

    def _decisions(self) -> Decisions:
        from socialiq.worlds.highway.core import step  # import Numba only when it is needed

        buffers = self.buffers
        left = np.zeros((self.size, self.options.agents), bool)
        step.off_road(self.lanes, buffers.after, buffers.present, left, 0, self.size)
        classical = RewardPair(*self._by_agent(buffers.classical))
        decisions = super()._decisions()
        decisions = decisions._replace(classical=classical, off_road=left.reshape(self.shape))
        if not self.walks:
            return decisions
        of_agents = [
            people.signals_of(self.walks, buffers, agent) for agent in range(self.options.agents)
        ]
        signals = {
            name: np.stack([of_agent[name] for of_agent in of_agents], axis=-1).reshape(self.shape)
            for name in self.walks.signals
        }
        rewards: RewardPair = people.by_class(
            self.walks, decisions.rewards, signals, self._by_class
        )
        return decisions._replace(rewards=rewards, signals={**decisions.signals, **signals})

    @property
    def _arguments(self) -> dict[str, Any]:
        road = {"scene": self.scene, "options": self.options}
        how = {"threads": self._threads, "effects": self.effects, "by_class": self._by_class}
        return {**road, **how}

    def _checked(self, actions: Any) -> np.ndarray:
        """Return numbers, or where actions are continuous floats in [-1, 1]; refuse others."""
        if not self.options.continuous:
            return super()._checked(actions)
        chosen = np.asarray(actions)
        shape = *self.shape, self.options.width
        if chosen.shape != shape or chosen.dtype not in (np.float32, np.float64):
            raise UserError(
                f"actions must be float32 or float64 of the shape {shape}, got {chosen.dtype} of "
                f"the shape {chosen.shape}"
            )
        wrong = chosen[~(np.abs(chosen) <= 1.0)]
        if len(wrong):
            raise UserError(f"actions must lie between -1 and 1, got {wrong[0]}: clip them")
        return chosen.reshape(-1, self.options.width)

    @property
    def _columns(self) -> State:
        if self.real is not None:  # which holds its state in Python objects
            raise UserError("the state of highway-env can't be saved or restored: use the core")
        return super()._columns
