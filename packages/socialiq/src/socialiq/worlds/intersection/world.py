"""The intersection: episodes side by side, the world, and the limits of its rewards."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from socialiq.errors import UserError, one_of
from socialiq.types import Policy
from socialiq.worlds.highway.effects import CAUSED, EffectOptions
from socialiq.worlds.highway.options import MAX_SPEED, SIGNALS, SKIP
from socialiq.worlds.highway.world import RoadBatch, RoadWorld, State
from socialiq.worlds.intersection import crosswalk, policies
from socialiq.worlds.intersection import options as scenario
from socialiq.worlds.intersection.crosswalk import CROSSWALK, CrosswalkOptions
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.perception import FrontEnd
from socialiq.worlds.intersection.shifts import OR, Shift, shifts_of
from socialiq.worlds.world import Decisions

if TYPE_CHECKING:
    from socialiq.worlds.highway.render import View

STEERING_RANGE = (-math.pi / 4, math.pi / 4)  # rad, of actions -1 and 1

BackEnd = Literal["core", "highway_env"]


def commands(actions: Float[np.ndarray, "batch value"]) -> list[Float[np.ndarray, " batch"]]:
    """Return the acceleration, m/s², and the front wheels' angle, rad, of continuous actions.

    They are computed in highway-env's order of operations and in the actions' own precision;
    float32 rounds differently from float64. Without a second column the wheels stand straight.
    """
    ranges = zip(actions.T, (scenario.ACCELERATION_RANGE, STEERING_RANGE), strict=False)
    held = [low + (values - -1) * (high - low) / (1 - -1) for values, (low, high) in ranges]
    return held if len(held) == 2 else [*held, np.zeros(len(actions))]


class Batch(RoadBatch):
    """Episodes of one scenario side by side; see `RoadBatch`.

    The back end "highway_env" is the real environment, hundreds of times slower. With `traced`,
    `buffers.trace` has the vehicles of every sub-step, for films.

    Raises:
        UserError: If a number is not positive, or highway-env is requested and not installed.
    """

    n_actions, faster = len(scenario.ACTIONS), scenario.FASTER

    def __init__(
        self,
        options: Options,
        size: int,
        threads: int = 1,
        back_end: BackEnd = "core",
        traced: bool = False,
        effects: EffectOptions | None = None,
        by_class: bool = False,
    ) -> None:
        one_of("back end", back_end, ("core", "highway_env"))
        buffers = scenario.buffers_of(options, size, traced or effects is not None)
        super().__init__(options, buffers, scenario.settings_of(options), threads, effects)
        self.options: Options = options
        self.walks = options if isinstance(options, CrosswalkOptions) else None
        self._by_class = by_class
        self.real: Any = None
        if back_end == "highway_env":
            if effects is not None:
                raise UserError("highway-env can't drive without its ego: use the core")
            from socialiq.worlds.intersection.reference import Reference

            self.real = Reference(options, self.buffers)

    def _core(self) -> tuple[Any, Any, np.ndarray]:
        from socialiq.worlds.intersection.core import geometry, step  # import Numba when needed

        return step, 0, geometry.LANES

    def _run(self, command: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        if self.real is not None:
            self.real.run(command, seeds, seeded, actions)
            return
        if self.walks:
            crosswalk.begin_decision(self.walks, self.buffers, command != SKIP)
        if actions.ndim == 2:  # held in the egos' records
            rows = np.flatnonzero(command != SKIP)
            ego = rows, self.buffers.episodes["controlled"][rows, 0]
            acceleration, steering = commands(actions[rows])
            self.buffers.vehicles["acceleration"][ego] = acceleration
            self.buffers.vehicles["steering"][ego] = steering
            actions = np.zeros(len(actions), np.int64)
        super()._run(command, seeds, seeded, actions)

    @property
    def _resets_in_core(self) -> bool:
        return super()._resets_in_core and not self.walks

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of the signals that define the rewards, without effects."""
        return (*SIGNALS, *self.walks.signals) if self.walks else SIGNALS

    def _decisions(self) -> Decisions:
        decisions = super()._decisions()
        if not self.walks:
            return decisions
        signals = crosswalk.signals_of(self.walks, self.buffers)
        rewards = crosswalk.by_class(self.walks, decisions.rewards, signals, self._by_class)
        return decisions._replace(rewards=rewards, signals={**decisions.signals, **signals})

    def like(self, size: int) -> Batch:
        """Return a batch of so many episodes of the same scenario, on the core."""
        return type(self)(
            self.options, size, self._threads, effects=self.effects, by_class=self._by_class
        )

    def _checked(self, actions: Any) -> np.ndarray:
        """Return numbers, or where actions are continuous floats in [-1, 1]; refuse others."""
        if not self.options.continuous:
            return super()._checked(actions)
        chosen, shape = np.asarray(actions), (self.size, self.options.width)
        if chosen.shape != shape or chosen.dtype not in (np.float32, np.float64):
            raise UserError(
                f"actions must be float32 or float64 of the shape {shape}, got {chosen.dtype} of "
                f"the shape {chosen.shape}"
            )
        wrong = chosen[~(np.abs(chosen) <= 1.0)]
        if len(wrong):
            raise UserError(f"actions must lie between -1 and 1, got {wrong[0]}: clip them")
        return chosen

    @property
    def _columns(self) -> State:
        if self.real is not None:  # which holds its state in Python objects
            raise UserError("the state of highway-env can't be saved or restored: use the core")
        return super()._columns


@dataclass(frozen=True)
class Intersection(RoadWorld):
    """highway-env's unsignalised crossing with the thesis' reward pair (5.1.3)."""

    options: Options = field(  # pyright: ignore[reportIncompatibleVariableOverride]  it is frozen
        default_factory=Options
    )
    effects: EffectOptions | None = None
    by_class: bool = False  # whether rewards have the parts of r_social by class, with crosswalks
    # of which every episode draws one; none is the plain world
    shifts: tuple[Shift, ...] = ()
    front_end: FrontEnd | None = None  # between what is shown and every policy

    drivers: ClassVar[tuple[str, ...]] = policies.NAMES
    references: ClassVar[tuple[str, ...]] = ("go", "wait", "idm")

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Name of the world, with `CROSSWALK` if people walk, `CAUSED` if effects are rewarded."""
        walks = CROSSWALK if isinstance(self.options, CrosswalkOptions) else ""
        return "intersection" + walks + (CAUSED if self.effects else "")

    @property
    def action_space(self) -> spaces.Discrete | spaces.Box:
        """Space of one action: `n_actions` numbers, or values in [-1, 1]."""
        if not self.options.continuous:
            return spaces.Discrete(len(scenario.ACTIONS))
        return spaces.Box(-1.0, 1.0, (self.options.width,), np.float32)

    @property
    def view(self) -> View:
        """The crossing as pictures show it."""
        from socialiq.worlds.intersection.views import Crossing  # imports Numba

        walks = isinstance(self.options, CrosswalkOptions) and self.options
        return Crossing(bool(walks), bool(walks and walks.riders))

    @property
    def description(self) -> str:
        """Name of the world and its options."""
        shifts = f" {OR.join(map(str, self.shifts))}" if self.shifts else ""
        front_end = f" {self.front_end}" if self.front_end else ""
        by_class = " by class" if self.by_class else ""
        return super().description + by_class + shifts + front_end

    @property
    def reward(self) -> dict[str, Any]:
        """Definition of the reward pair, with the weights of the classes where people walk."""
        walks = self.options.definition if isinstance(self.options, CrosswalkOptions) else {}
        return super().reward | walks

    def with_parts(self) -> Intersection:
        """Return the same world with r_social by class in its rewards, for all class angles.

        Raises:
            UserError: If no person walks there.
        """
        if not isinstance(self.options, CrosswalkOptions):
            raise UserError(f"{self.name} has one class of road users: choose one with crosswalks")
        return dataclasses.replace(self, by_class=True)

    def shifted(self, text: str = "", front_end: str = "") -> Intersection:
        """Return the same world with the shifts of a text, and a front end.

        Each episode draws one of several shifts, as `late or noise=1`.

        Raises:
            UserError: If a text is invalid, the shifts change the options of the world in several
                ways, or the actions that a front end predicts are continuous.
        """
        shifts = shifts_of(text)
        changes = [shift.options for shift in shifts]
        if any(change != changes[0] for change in changes):
            raise UserError(
                f"shifts between which '{OR.strip()}' stands must have one road and one traffic: "
                "leave out the others, or name each shift by itself"
            )
        options = dataclasses.replace(self.options, **changes[0])
        faulty = shifts if any(shift.has_faults for shift in shifts) else ()
        front = FrontEnd.of(front_end, shifts, options) if front_end else self.front_end
        if front and front.latency and options.continuous:
            raise UserError("a front end predicts discrete actions: leave out its latency")
        return dataclasses.replace(self, options=options, shifts=faulty, front_end=front)

    def batch(  # pyright: ignore[reportIncompatibleMethodOverride]  one argument more
        self, size: int, threads: int = 1, back_end: BackEnd = "core", traced: bool = False
    ) -> Batch:
        """Return episodes side by side; see `Batch`."""
        how = self.options, size, threads, back_end, traced, self.effects, self.by_class
        if not self.shifts and self.front_end is None:
            return Batch(*how)
        from socialiq.worlds.intersection.shifted import ShiftedBatch  # made of `Batch`

        return ShiftedBatch(*how, choices=self.shifts or (Shift(),), front_end=self.front_end)

    def driver(self, name: str, seed: int = 0) -> Policy:
        """Return a rule-based driver of `policies.NAMES`."""
        return policies.policy(name, seed, self.options)

    def largest_difference(self, weights: tuple[float, float]) -> float | None:
        """Return the most by which two episodes can differ; None where nothing limits progress.

        An ego that steers may pass near the centre of a turn, where a metre driven is any part of
        it.
        """
        if self.options.continuous and self.options.destination != "straight":
            return None
        if self.effects or isinstance(self.options, CrosswalkOptions):
            return None
        sides = env_range(self.options), social_range(self.options)
        return sum(abs(w) * (high - low) for w, (low, high) in zip(weights, sides, strict=True))

    def other_traffic(self) -> dict[str, dict[str, Any]]:
        """Return the other populations of drivers, and connected lanes switched the other way."""
        populations = {"highway_env", "thesis"} - {self.options.population}
        connected = not self.options.connected_lanes
        sight = "who see across connected lanes" if connected else "who see their own lane only"
        return {
            **{
                f"drivers of population {name}": {"population": name}
                for name in sorted(populations)
            },
            f"drivers {sight}": {"connected_lanes": connected},
        }


_INSIDE_TURN = 1.3
"""Largest advance along a route per metre driven: on the tightest turn, of radius 9 m, within the
half-width of a lane, 2 m, of its centre (9 / 7)."""


def decisions(options: Options) -> int:
    """Return the number of decisions until the time is over, counted as the core counts it."""
    time, count = 0.0, 0
    while time < options.duration:
        time += 1 / options.policy_frequency
        count += 1
    return count


def largest_progress(options: Options) -> float:
    """Return the largest value of the signal `progress`, either way.

    The ego enters at the speed limit and its speed control doesn't overshoot a target speed, so it
    drives at most the largest of these speeds times the time between decisions. On the inside of a
    turn that is more of the route. With continuous actions it drives at most `MAX_SPEED` and what
    a sub-step adds.
    """
    fastest = max(scenario.SPEED_LIMIT, *map(abs, options.target_speeds))
    if options.continuous:
        fastest = MAX_SPEED + scenario.ACCELERATION_RANGE[1] / options.simulation_frequency
    return _INSIDE_TURN * fastest / options.policy_frequency / options.progress_unit


def env_range(options: Options) -> tuple[float, float]:
    """Return limits of an episode's sum of r_env (Eq 4.1), for any driver in any traffic.

    Collision and arrival replace the last decision's reward, a timeout adds to it.
    """
    moved, held = abs(options.progress_weight) * largest_progress(options), options.speed_weight
    low = -moved + min(held, 0.0) + options.step_weight
    high = moved + max(held, 0.0) + options.step_weight
    earlier, late = decisions(options) - 1, options.timeout_weight
    terminal = options.collision_weight, options.arrival_weight
    least = min(earlier * low, 0.0) + min(*terminal, low, low + late)
    return least, max(earlier * high, 0.0) + max(*terminal, high, high + late)


def social_range(options: Options) -> tuple[float, float]:
    """Return limits of an episode's sum of r_social (Eq 4.2), for any driver in any traffic.

    In every decision each other vehicle counts at most once with each of its two signals, which
    lie in [0, 1]. At the first there are at most `initial_vehicle_count` others, and every later
    one adds at most one.
    """
    count = decisions(options)
    vehicles = count * options.initial_vehicle_count + count * (count - 1) // 2
    weights = options.yielding_weight, options.disruption_weight
    crash = options.neighbour_collision_weight
    least = vehicles * sum(min(weight, 0.0) for weight in weights) + min(crash, 0.0)
    return least, vehicles * sum(max(weight, 0.0) for weight in weights) + max(crash, 0.0)
