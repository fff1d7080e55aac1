"""Roads as worlds: what all of them share, and those from a table."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import numpy as np
from gymnasium import spaces

from socialiq.errors import UserError, one_of
from socialiq.types import Policy
from socialiq.worlds.highway import observation, rules
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.effects import CAUSED, EffectOptions
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.kinds import changed_options, kind_with, parts_of
from socialiq.worlds.highway.options import (
    FEATURES,
    RoadOptions,
    TrafficOptions,
    reward_definition,
)
from socialiq.worlds.highway.people import CROSSWALK, PeopleOptions, check_ways
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.highway.scene_batch import BackEnd, Batch
from socialiq.worlds.highway.scenes import Scene, along_route, other_side, scene_of
from socialiq.worlds.highway.shifted import Faults, over
from socialiq.worlds.highway.shifts import FAULTS, OPTIONS, OR, Shift, shifts_of
from socialiq.worlds.world import World

if TYPE_CHECKING:
    from socialiq.worlds.highway.render import View


Kind = TypeVar("Kind", bound=RoadBatch)
Road = TypeVar("Road", bound="RoadWorld")

_CLOCK = {"simulation_frequency": 15, "observed_vehicles": 5}  # highway-env's on these roads


class RoadWorld(World):
    """Compiled road with the thesis' reward pair."""

    options: RoadOptions
    # of a world whose r_social is what the ego causes, in the place of Eq 4.2
    effects: EffectOptions | None = None
    shifts: tuple[Shift, ...] = ()  # of which every episode draws one; none is the plain world
    front_end: FrontEnd | None = None  # between what is shown and every policy
    draws_by_seed: ClassVar[bool] = True

    @property
    def agents(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Number of controlled vehicles of an episode."""
        return self.options.agents

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        if self.options.along_route:
            return observation.N_FEATURES
        return self.options.observed_rows * len(FEATURES)

    @property
    def schema(self) -> str:
        """Name and version of the schema of observations, as saved policies carry it."""
        return observation.ROUTE if self.options.along_route else super().schema

    @property
    def narrow(self) -> tuple[int, ...]:
        """Lengths of observations without some classes, which policies may take too."""
        if self.options.along_route:
            return ()
        return tuple(rows * len(FEATURES) for rows in self.options.narrow_rows)

    @property
    def description(self) -> str:
        """Name of the world, its options, and what wraps it."""
        shifts = OR.join(map(str, self.shifts))
        wrapped = self.effects, self._rewarded, shifts, self.front_end
        return " ".join(map(str, (self.name, self.options, *filter(None, wrapped))))

    @property
    def _rewarded(self) -> str:
        """Further description of the rewards."""
        return ""

    @property
    def reward(self) -> dict[str, Any]:
        """Definition of the reward pair: weights of the signals, and the options that matter."""
        defined = reward_definition(self.options)
        return defined | {"social": self.effects.definition} if self.effects else defined

    @property
    @abc.abstractmethod
    def ego(self) -> EgoModel:
        """Scales of the ego's observation, and its speed control."""

    @property
    def shiftable(self) -> tuple[str, ...]:
        """Options that a shift may change."""
        kinds = type(self.options), TrafficOptions
        return tuple(field.name for kind in kinds for field in dataclasses.fields(kind))

    def shifted(self: Road, text: str = "", front_end: str = "") -> Road:
        """Return the same road with the shifts of a text, and a front end.

        Each agent of an episode draws one of several shifts, as `late or noise=1`.

        Args:
            text: Shifts as for `shifts.shifts_of`; "" leaves those of the road, "none" takes all
                faults off.
            front_end: Front end as for `FrontEnd.of`; "" leaves that of the road.

        Raises:
            UserError: If a text is invalid, the road lacks what a shift changes, or the shifts
                change its options in several ways.
        """
        if not (text or front_end):
            return self
        shifts = shifts_of(text) if text else self.shifts
        world = self._with_options(shifts) if text else self
        faulty = shifts if any(shift.has_faults for shift in shifts) else ()
        # A policy knows the decisions of the road without the shift.
        ego = dataclasses.replace(world.ego, decisions=self.ego.decisions)
        front = self.front_end and dataclasses.replace(self.front_end, ego=ego)
        front = FrontEnd.of(front_end, shifts, ego) if front_end else front
        return dataclasses.replace(cast(Any, world), shifts=faulty, front_end=front)

    def _with_options(self: Road, shifts: Sequence[Shift]) -> Road:
        """Return the road with the options that shifts change."""
        changes = [shift.options_of(self.options.target_speeds) for shift in shifts]
        if any(change != changes[0] for change in changes):
            raise UserError(
                f"shifts between which '{OR.strip()}' stands must have one road and one traffic: "
                "leave out the others, or name each shift by itself"
            )
        lacking = [name for name in changes[0] if name not in self.shiftable]
        if lacking:
            fields = [field.name for field in FAULTS]
            fields += [name for name, option in OPTIONS.items() if option in self.shiftable]
            raise UserError(
                f"{self.name} has no option {lacking[0]}, which the shift {shifts[0]} changes: "
                f"choose among {', '.join(fields)}"
            )
        if not changes[0]:
            return self
        options = changed_options(self.options, changes[0])
        return dataclasses.replace(cast(Any, self), options=options)

    def _episodes(self, kind: type[Kind], **arguments: Any) -> Kind:
        """Return a batch of a class, with faults and front end if the road has them."""
        if not self.shifts and self.front_end is None:
            return kind(**arguments)
        faults = Faults(self.shifts or (Shift(),), self.front_end, self.ego)
        return over(kind)(**arguments, faults=faults)

    @property
    @abc.abstractmethod
    def view(self) -> View:
        """The road as pictures show it."""

    @abc.abstractmethod
    def batch(self, size: int, threads: int = 1, traced: bool = False) -> RoadBatch:
        """Return episodes side by side.

        Args:
            size: Number of episodes.
            threads: Number of threads that share the episodes.
            traced: Whether `buffers.trace` keeps every sub-step.
        """


@dataclass(frozen=True)
class SceneWorld(RoadWorld):
    """Road from a table."""

    options: RoadOptions
    effects: EffectOptions | None = None
    by_class: bool = False  # whether rewards have the parts of r_social by class, with crosswalks
    shifts: tuple[Shift, ...] = ()
    front_end: FrontEnd | None = None
    scene: Scene = field(kw_only=True, hash=False, repr=False)

    def __post_init__(self) -> None:
        if self.options.left_hand != self.scene.left_hand:
            object.__setattr__(self, "scene", other_side(self.scene))
        if self.options.along_route:
            object.__setattr__(self, "scene", along_route(self.scene))
        if self.options.width == 1 and self.scene.bends and not self._is_straight:
            raise UserError(
                f"the ego of {self.scene.name} can't follow a way with bends by acceleration "
                "alone: choose control=steering"
            )
        if isinstance(self.options, PeopleOptions):
            check_ways(self.scene.name, self.scene.road.crossings, self.options)

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Name of the scene, with `CROSSWALK` if people walk, `CAUSED` if effects are rewarded."""
        return (
            self.scene.name + (CROSSWALK if self.walks else "") + (CAUSED if self.effects else "")
        )

    @property
    def _is_straight(self) -> bool:
        """Whether the options lead the ego straight on, over a road with bends."""
        return False

    @property
    def walks(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether people cross, on foot or on bicycles."""
        return isinstance(self.options, PeopleOptions)

    @property
    def action_space(self) -> spaces.Discrete | spaces.Box:
        """Space of one action: `n_actions` numbers, or values in [-1, 1]."""
        if not self.options.continuous:
            return spaces.Discrete(len(self.scene.actions))
        return spaces.Box(-1.0, 1.0, (self.options.width,), np.float32)

    @property
    def _rewarded(self) -> str:
        return "by class" if self.by_class else ""

    @property
    def reward(self) -> dict[str, Any]:
        """Definition of the reward pair, with the weights of the classes where people walk."""
        walks = self.options.definition if isinstance(self.options, PeopleOptions) else {}
        return super().reward | walks

    def showing(self, schema: str) -> SceneWorld:
        """Return the same world with observations of a schema, `rows` or `route`.

        Args:
            schema: Name of the schema.

        Raises:
            UserError: If the world shows routes and rows are asked for, whose scales it has not.
        """
        if schema == self.schema.rpartition("-")[0]:
            return self
        if schema == "rows":
            raise UserError(f"leave observation=route out of the world {self.name}")
        options = changed_options(self.options, {"observation": schema})
        world = dataclasses.replace(self, options=options)
        if self.front_end is None:
            return world
        ego = dataclasses.replace(world.ego, decisions=self.front_end.ego.decisions)
        return dataclasses.replace(world, front_end=dataclasses.replace(self.front_end, ego=ego))

    def with_parts(self: Road) -> Road:
        """Return the same world with r_social by class in its rewards, for all class angles.

        Raises:
            UserError: If the world has no crosswalks.
        """
        if not self.walks:
            raise UserError(f"{self.name} has one class of road users: choose one with crosswalks")
        return dataclasses.replace(cast(Any, self), by_class=True)

    @property
    def drivers(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Names of its rule-based drivers."""
        return rules.names_of(self.scene)

    def driver(self, name: str, seed: int = 0) -> Policy:
        """Return a rule-based driver.

        Args:
            name: One of `drivers`.
            seed: Seed of the random driver.

        Raises:
            UserError: If the scene has no driver of this name.
        """
        return rules.policy(name, self.scene, self.options, seed)

    @property
    def view(self) -> View:
        """The road as pictures show it."""
        from socialiq.worlds.highway.views import Lanes  # imports Numba

        return Lanes(self.scene, self.walks, self._rides)

    @property
    def _rides(self) -> bool:
        """Whether people ride on bicycle lanes."""
        return isinstance(self.options, PeopleOptions) and self.options.rides

    @property
    def ego(self) -> EgoModel:
        """Scales of the ego's observation, and its speed control."""
        road = self.scene.road
        entry = road.speed_limit if len(road.arrivals) else float(road.entries[0]["speed"])
        in_world = getattr(self.options, "frame", "own") == "world"  # the exit is one arm for all
        exit = "" if in_world else getattr(self.options, "destination", "")
        return EgoModel.of(self.options, road.sight, self.scene.actions, entry, exit)

    def batch(
        self, size: int, threads: int = 1, traced: bool = False, back_end: BackEnd = "core"
    ) -> Batch:
        """Return episodes side by side; see `Batch`.

        Args:
            size: Number of episodes.
            threads: Number of threads that share the episodes, on the core.
            traced: Whether `buffers.trace` keeps every sub-step.
            back_end: "core", or "highway_env" for the real environment, which is far slower.

        Raises:
            UserError: If a number is not positive, more agents are controlled than the scene has
                vehicles, or highway-env is requested and is not installed or lacks the scene.
        """
        how: dict[str, Any] = {"threads": threads, "back_end": back_end, "traced": traced}
        rewards = {"effects": self.effects, "by_class": self.by_class}
        road = {"scene": self.scene, "options": self.options}
        return self._episodes(Batch, **road, size=size, **how, **rewards)


SENSED = {"shift": "text", "front_end": "front_end"}
"""Options of every road beside the fields of its own: arguments of `RoadWorld.shifted`."""


OF_FILES = (*SENSED, "observation")
"""Options of a road that a file holds."""


def sensed_of(options: dict[str, Any]) -> dict[str, str]:
    """Take the options `SENSED` out of others; return the arguments of `RoadWorld.shifted`.

    Raises:
        UserError: If a value is not a text.
    """
    sensed = {name: options.pop(option, "") for option, name in SENSED.items()}
    for option, value in zip(SENSED, sensed.values(), strict=True):
        if not isinstance(value, str):
            raise UserError(f"{option} must be text, as latency=1, got {value!r}")
    return sensed


def world_of(scene: Scene | str, **options: Any) -> SceneWorld:
    """Return a scene as a world.

    Options of `kinds.PARTS` add several agents, continuous actions or people; `shift` and
    `front_end` are texts of `RoadWorld.shifted`.

    Raises:
        UserError: If the scene, an option or a value is unknown.
    """
    sensed = sensed_of(options)
    chosen = scene_of(scene) if isinstance(scene, str) else scene
    kind = kind_with(RoadOptions, parts_of(options))
    names = tuple(field.name for field in dataclasses.fields(kind))
    for option in options:
        one_of(f"option of {chosen.name}", option, names)
    world = SceneWorld(kind(**{**_CLOCK, **chosen.defaults, **options}), scene=chosen)
    return world.shifted(**sensed)
