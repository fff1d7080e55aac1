"""World of recorded junctions: its arrays, and its file."""

from __future__ import annotations

import collections
import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
from gymnasium import spaces

from socialiq import storage
from socialiq.errors import UserError, one_of
from socialiq.worlds import WORLD_FILE
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.kinds import changed_options
from socialiq.worlds.highway.options import MAX_SPEED, Schema
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.highway.scenes import ROUTE_ACTIONS
from socialiq.worlds.highway.shifts import OR, Shift
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.world import ConstantPolicy
from socialiq_recordings.recording import PEOPLE
from socialiq_recordings.world.batch import JunctionBatch
from socialiq_recordings.world.config import AS_DRIVER, SUB_STEPS, WorldConfig

LAYOUT: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "recording_first": (np.int64, ()),  # first vehicle of each recording; the number of vehicles
    "pair_first": (np.int64, ()),  # first pair of each recording, and the number of pairs
    "identity": (np.int64, ()),  # number of a vehicle in the file that was recorded
    "length": (np.float64, ()),  # m
    "width": (np.float64, ()),  # m
    "arrival": (np.float64, ()),  # coordinate at which the vehicle as ego has arrived, m
    "origin": (np.float64, ()),  # coordinate on its way that its observations count from, m
    "zone": (np.float64, (2,)),  # influence zone, from and to, m
    "egos": (np.int64, ()),  # vehicles whose place the ego can take
    "line_first": (np.int64, ()),  # first point of each way, and the number of points
    "line": (np.float64, (4,)),  # x, y in m, direction in rad, largest speed in m/s, every metre
    "state_first": (np.int64, ()),  # first recorded state of each way, and the number of states
    "state_step": (np.int64, ()),  # sub-step of that state from the recording's first frame
    "state": (np.float64, (2,)),  # coordinate in m and speed in m/s, a state each sub-step
    "area_of": (np.int64, ()),  # conflict area of a pair, -1 if there is none
    "area": (np.float64, (4,)),  # entry and exit of the first vehicle, then of the other, m
    "area_yields": (np.int64, ()),  # 1: the first yields, -1: the other, 0: who comes first goes
    "area_merges": (np.int64, ()),  # 1 if the ways merge, 0 if they cross
    "stretch_first": (np.int64, ()),  # first stretch of a pair: the other's way in the first one's
    "stretch": (np.float64, (4,)),  # begin and end on the other's way, then on the first one's, m
    "closed_first": (np.int64, ()),  # first closure of each way
    "closed": (np.float64, (3,)),  # coordinate of a closed line in m, from and to in s
    "person_first": (np.int64, ()),  # first person of each recording, and the number of people
    "person_class": (np.int64, ()),  # a `RoadUser`
    "person_size": (np.float64, (2,)),  # length and width, m
    "person_step": (np.int64, ()),  # sub-step of the first state from the recording's first frame
    "person_state_first": (np.int64, ()),  # first state of each person, and the number of states
    # x, y in m, direction in rad, speed in m/s, a state each sub-step
    "person_state": (np.float64, (4,)),
    "drivers": (np.float64, (4,)),  # mean, deviation and bounds by parameter of `drivers.Drivers`
}
"""Arrays of a world: type, and shape of one row. Vehicles are numbered over all recordings; pair
(i, j) of a recording of n vehicles is at n i + j."""

_PEOPLE = tuple(name for name in LAYOUT if name.startswith("person_"))
"""Arrays that a file of a world without people doesn't have."""

Road = collections.namedtuple("Road", list(LAYOUT))
"""Arrays that the compiled core reads."""

KIND = WORLD_FILE
SCHEMA_VERSION = 1


@dataclass(frozen=True, eq=False)
class RecordedWorld(RoadWorld):
    """World of recorded junctions.

    Its rule-based drivers are a driver of the calibrated population, which knows all ways and the
    closed lines that policies see in part; always faster; and always slower.
    """

    road: Road  # its arrays
    config: WorldConfig  # options of its decisions and rewards
    max_speed: float  # v_max of Eq 4.1 and 4.2, and the ego's largest speed, m/s
    provenance: dict[str, Any]  # recordings, calibration and counts, as JSON
    sha256: str = ""  # of the file's content; "" if it was not read from a file
    name: str = "recorded-junction"  # name in hashes, the same for every file
    effects: EffectOptions | None = None
    shifts: tuple[Shift, ...] = ()
    front_end: FrontEnd | None = None
    observation: Schema = "rows"  # schema of observations

    drivers: ClassVar[tuple[str, ...]] = ("driver", "go", "wait")
    references: ClassVar[tuple[str, ...]] = drivers

    @property
    def description(self) -> str:
        """Format and SHA-256 of the file's content as JSON with sorted keys."""
        described = {"content": self.sha256, "format": SCHEMA_VERSION, "name": self.name}
        described |= {"effects": dataclasses.asdict(self.effects)} if self.effects else {}
        described |= {"shift": OR.join(map(str, self.shifts))} if self.shifts else {}
        described |= {"front_end": str(self.front_end)} if self.front_end else {}
        described |= {"observation": self.schema} if self.observation != "rows" else {}
        return json.dumps(described, sort_keys=True, separators=(",", ":"))

    @property
    def options(self) -> Options:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Options of the reward pair."""
        options = dataclasses.replace(
            self.config.rewards,
            simulation_frequency=SUB_STEPS,
            policy_frequency=self.config.policy_rate,
            duration=self.config.duration,
            observed_vehicles=self.config.observed_vehicles,
            target_speeds=(0.0, self.max_speed / 2, self.max_speed),
        )
        if self.observation == "rows":
            return options
        return changed_options(options, {"observation": self.observation})

    def showing(self, schema: str) -> RecordedWorld:
        """Return the same world with observations of a schema."""
        return dataclasses.replace(self, observation=cast(Any, schema))

    @property
    def levels(self) -> tuple[float, ...]:
        """Acceleration of each action, m/s²: those of the file, or of `ROUTE_ACTIONS`.

        Along the route `slower` brakes most and `faster` accelerates most; changes of lanes, which
        this ego can't do, do what `idle` does.
        """
        levels = self.config.levels
        if self.observation == "rows":
            return levels
        route = {"slower": levels[0], "faster": levels[-1]}
        return tuple(route.get(name, 0.0) for name in ROUTE_ACTIONS)

    @property
    def ego(self) -> EgoModel:
        """Scales of the ego's observation; its actions are accelerations."""
        options = self.options
        return EgoModel(
            idle=self.levels.index(0.0),
            changes=self.levels,
            accelerates=True,
            ballistic=True,
            speeds=(0.0, MAX_SPEED),
            sub_step=1.0 / SUB_STEPS,
            rate=options.policy_frequency,
            decisions=options.decisions,
            exit="",
        )

    @property
    def shiftable(self) -> tuple[str, ...]:
        """No option: road and traffic are as recorded."""
        return ()

    @property
    def whole_episode(self) -> int:
        """Decisions of an episode; recorded vehicles leave the view before theirs is over."""
        return self.config.decisions

    @property
    def view(self) -> Any:
        """None: `gym.scene` draws moments."""
        return None

    @property
    def action_space(self) -> spaces.Discrete:
        """Space of one action: the number of one of `levels`."""
        return spaces.Discrete(len(self.levels))

    @property
    def capacity(self) -> int:
        """Largest number of vehicles of a recording."""
        return int(np.diff(self.road.recording_first).max())

    def driver(self, name: str, seed: int = 0) -> ConstantPolicy:  # noqa: ARG002  none is random
        """Return a driver of `drivers`; see `World.driver`.

        Args:
            name: Name of the driver.
            seed: Not used, since no driver is random.

        Raises:
            UserError: If the name is unknown.
        """
        one_of("driver of a recorded junction", name, self.drivers)
        numbers = {"driver": AS_DRIVER, "go": self.levels.index(max(self.levels)), "wait": 0}
        return ConstantPolicy(numbers[name])

    def batch(self, size: int, threads: int = 1, traced: bool = False) -> JunctionBatch:  # noqa: ARG002
        """Return episodes side by side.

        Args:
            size: Number of episodes.
            threads: Number of threads that drive them.
            traced: Not used: sub-steps are not traced for callers.
        """
        return self._episodes(JunctionBatch, world=self, size=size, threads=threads)

    def save(self, path: Path, replace: bool = False) -> str:
        """Write the world to one file, whole or not at all; return the SHA-256 of the content.

        Raises:
            UserError: If the file can't be written.
        """
        header: dict[str, Any] = {"config": dataclasses.asdict(self.config)}
        if self.effects:
            header["config"]["effects"] = dataclasses.asdict(self.effects)
        header |= {"max_speed": self.max_speed, "provenance": self.provenance}
        arrays = self.road._asdict()
        if not len(self.road.person_class):
            arrays = {name: array for name, array in arrays.items() if name not in _PEOPLE}
        return storage.save_arrays(path, KIND, SCHEMA_VERSION, arrays, header, replace)

    @staticmethod
    def load(path: Path) -> RecordedWorld:
        """Read a world written by `save`, checking that its parts agree.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        arrays, header = storage.load_arrays(path, KIND, SCHEMA_VERSION)
        if not arrays.keys() & _PEOPLE and arrays.get("recording_first", np.zeros(0)).ndim == 1:
            empty = {name: np.zeros((0, *LAYOUT[name][1]), LAYOUT[name][0]) for name in _PEOPLE}
            empty["person_first"] = np.zeros_like(arrays.get("recording_first", np.zeros(0)))
            arrays |= empty | {"person_state_first": np.zeros(1, np.int64)}
        for fault in _faults(arrays, header):
            raise UserError(f"{path} {fault}: make the world again with `socialiq data world`")
        options = dict(header["config"])
        try:
            effects = EffectOptions(**options.pop("effects")) if "effects" in options else None
            speeds = tuple(options["rewards"]["target_speeds"])
            rewards = Options(**options["rewards"] | {"target_speeds": speeds})
            levels = tuple(options["levels"])
            config = WorldConfig(**options | {"levels": levels, "rewards": rewards})
        except (UserError, TypeError, KeyError, ValueError) as error:
            raise UserError(
                f"{path} has options that make no world: make it again with `socialiq data world`"
            ) from error
        road = Road(**{name: np.ascontiguousarray(arrays[name]) for name in LAYOUT})
        names = ("max_speed", "provenance", "sha256")
        return RecordedWorld(road, config, *(header[name] for name in names), effects=effects)


def _faults(arrays: dict[str, np.ndarray], header: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with a world, whose indices the core doesn't check, in this order."""
    speed = header.get("max_speed")
    if not (isinstance(speed, float) and 0 < speed < 1e3):
        yield "has no largest speed"
    if not isinstance(header.get("provenance"), dict) or not isinstance(header.get("config"), dict):
        yield "has no provenance or options"
    for name, (dtype, shape) in LAYOUT.items():
        array = arrays.get(name)
        if array is None or array.dtype != dtype or array.shape[1:] != shape or array.ndim < 1:
            yield f"lacks the column {name}, or has it in another form"
        elif name == "closed":
            if np.isnan(array).any():
                yield f"has numbers in {name} that are none"
        elif not np.isfinite(array).all():
            yield f"has numbers in {name} that are not finite"
    if set(arrays) != set(LAYOUT):
        yield "has columns that are no world's"
    road = Road(**arrays)
    vehicles = len(road.identity)
    counts = np.diff(road.recording_first)
    areas = len(road.area)
    people = len(road.person_class)
    for name, rows, total in (
        ("recording_first", None, vehicles),
        ("pair_first", len(counts) + 1, len(road.area_of)),
        ("line_first", vehicles + 1, len(road.line)),
        ("state_first", vehicles + 1, len(road.state)),
        ("stretch_first", len(road.area_of) + 1, len(road.stretch)),
        ("closed_first", vehicles + 1, len(road.closed)),
        ("person_first", len(counts) + 1, people),
        ("person_state_first", people + 1, len(road.person_state)),
    ):
        first = getattr(road, name)
        sized = len(first) >= 2 if rows is None else len(first) == rows
        if not sized or first[0] != 0 or first[-1] != total or (np.diff(first) < 0).any():
            yield f"has places in {name} that don't fit the other columns"
    if (counts < 1).any() or (np.diff(road.pair_first) != counts**2).any():
        yield "has a recording without vehicles or pairs"
    if (np.diff(road.line_first) < 2).any() or (np.diff(road.state_first) < 1).any():
        yield "has a vehicle without a line or a state"
    for name in ("length", "width", "arrival", "origin", "zone", "state_step"):
        if len(getattr(road, name)) != vehicles:
            yield f"has another number of rows in {name} than vehicles"
    if len(road.egos) < 1 or (road.egos < 0).any() or (road.egos >= vehicles).any():
        yield "has an ego that is no vehicle"
    if (road.area_of < -1).any() or (road.area_of >= areas).any():
        yield "has a conflict area that isn't there"
    if len(road.area_yields) != areas or len(road.area_merges) != areas:
        yield "has conflict areas without a right of way"
    if any((column <= 0).any() for column in (road.length, road.width, road.person_size)):
        yield "has a vehicle without a size"
    steps = np.append(road.state_step, road.person_step)
    if (steps > 10**9).any() or (steps < 0).any():
        yield "has a state before the recording"
    yield from _faults_of_people(road)
    if road.drivers.shape != (6, 4) or (road.drivers[:, (0, 2, 3)] <= 0).any():
        yield "has drivers without parameters"
    if (np.abs(road.line) > 1e8).any() or (road.line[:, 3] <= 0).any():
        yield "has a line that is none"


def _faults_of_people(road: Road) -> Iterator[str]:
    """Yield what is wrong with people whose places in columns fit."""
    kinds = road.person_class
    if any(len(column) != len(kinds) for column in (road.person_size, road.person_step)):
        yield "has people without a size or a beginning"
    if not np.isin(kinds, PEOPLE).all() or (np.diff(road.person_state_first) < 1).any():
        yield "has people of another class, or without a state"
    if (np.abs(road.person_state) > 1e8).any():
        yield "has people who are nowhere"
