"""Episodes of a recorded junction side by side."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.worlds.highway.along_route import AlongRoute
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.observation import AGENT, Line
from socialiq.worlds.highway.options import EPISODE as ROAD_EPISODE
from socialiq.worlds.highway.options import Buffers, settings_of
from socialiq_recordings.recording import GROUPS, PEOPLE
from socialiq_recordings.world.config import AS_DRIVER, SUB_STEPS

if TYPE_CHECKING:
    from socialiq_recordings.world.recorded_world import RecordedWorld

PERSON = 1_000_000
"""Number of the first person in `JunctionBatch.places`."""

VEHICLE = np.dtype(
    [
        ("x", np.float64),  # middle, m to the east and to the north
        ("y", np.float64),
        ("heading", np.float64),  # rad
        ("along_x", np.float64),  # cosine and sine of the heading
        ("along_y", np.float64),
        ("along", np.float64),  # coordinate of the middle on its way, m
        ("speed", np.float64),  # m/s, NaN before it enters
        ("before", np.float64),  # speed at the last decision, or when it entered, m/s
        ("acceleration", np.float64),  # of the sub-step, m/s²
        # acceleration that an action holds, m/s²; NaN: it drives as a driver of the population
        ("level", np.float64),
        ("barrier", np.float64),  # coordinate of the next leader or closed line, m
        ("length", np.float64),  # m
        ("width", np.float64),
        ("driver", np.float64, (6,)),  # parameters, as in `drivers.Drivers`
        # first and last sub-step at which the ego, and then the vehicle, was in their conflict
        # area, -1 for none; noted where effects are measured
        ("times", np.int64, (4,)),
        ("way", np.int64),  # number of its way: of the vehicle over all recordings
        ("identity", np.int32),  # number in its recording
        ("present", np.int32),  # of the vehicle at this place in the list of those on the road
        ("status", np.int8),  # `traffic.WAITING`, PRESENT or GONE
        ("counted", np.bool_),  # in Eq 4.2, where effects are measured
        ("touched", np.bool_),  # whether it is no ego and drove into another or was driven into
        ("met", np.bool_),  # whether it is no ego and touched a person
    ],
    align=True,
)
"""Record of a vehicle; those of an episode are numbered within the recording."""

_NOTED = ("x", "y", "along_x", "along_y", "along", "speed", "identity", "status", "counted")

PLACE = np.dtype(
    [*((name, VEHICLE[name]) for name in _NOTED), ("crashed", np.bool_)],  # never crashed
    align=True,
)
"""Record of a vehicle before or after a sub-step, a quarter of VEHICLE; effects read it."""

EPISODE = np.dtype(
    [
        *((name, ROAD_EPISODE[name]) for name in ROAD_EPISODE.names or ()),
        ("recording", np.int64),  # number of the recording
        ("begun", np.int64),  # sub-step at which the episode began
        ("hit", np.int64),  # class of the person that touches the ego, a `RoadUser`; 0: none
        ("others_hit", np.int64),  # vehicles that touch a person for the first time in the decision
    ],
    align=True,
)
"""Episode record of any road, of which `state_low` is the seed, `sub_steps` counts from the
recording's first frame, and `controlled` and `touched` are numbers in the recording."""


def records_of(world: RecordedWorld, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return EPISODE records of empty episodes, and VEHICLE records, (row, vehicle).

    Args:
        world: World of the episodes.
        size: Number of episodes.
    """
    vehicles = np.zeros((size, world.capacity), VEHICLE)
    vehicles["identity"] = np.arange(world.capacity)
    return np.zeros(size, EPISODE), vehicles


class JunctionBatch(RoadBatch):
    """Episodes of one world side by side; see `RoadBatch`.

    An action is the number of a level, or `AS_DRIVER`.

    Raises:
        UserError: If `size` or `threads` is not positive, or effects end within an episode.
    """

    def __init__(self, world: RecordedWorld, size: int, threads: int = 1) -> None:
        options = world.options
        most = world.capacity if world.effects else 0
        buffers = Buffers.of(options, PLACE, most, size, traced=world.effects is not None)
        episodes, vehicles = records_of(world, size)
        buffers = buffers._replace(episodes=episodes, vehicles=vehicles)
        super().__init__(options, buffers, settings_of(options), threads, world.effects)
        self.world = world
        self.faster = world.levels.index(max(world.levels))
        self.n_actions = world.n_actions
        # m/s²; the last is that of AS_DRIVER
        self.levels = np.array([*world.levels, np.nan])
        self.idle = world.ego.idle
        if options.along_route:
            self._along = AlongRoute(world.ego, world.max_speed)

    def _agents(self, results: Int64[np.ndarray, " chosen"]) -> np.ndarray:
        assert self._along is not None
        agents = np.zeros(len(results), AGENT)
        ways = self._egos_ways[results]
        agents["way"] = self._along.numbers(ways, lambda row: self._route(int(ways[row])))
        seconds = self.clocks[results] / self.options.policy_frequency
        agents["seconds_left"] = self.options.duration - seconds
        agents["cos"] = 1.0
        return agents

    @property
    def _egos_ways(self) -> np.ndarray:
        controlled = self.buffers.episodes["controlled"][:, 0]
        return self.buffers.vehicles["way"][np.arange(self.size), controlled]

    def _route(self, way: int) -> Line:
        """Return the route along a way, in the frame of rows: a line to the north."""
        from socialiq.worlds.highway.ways import line_of  # imports Numba

        road = self.world.road
        origin = float(road.origin[way])
        length = float(np.diff(road.line_first[way : way + 2])[0] - 1)
        ends = np.array([(0.0, origin), (0.0, origin - length)])
        return line_of(ends, origin, float(road.zone[way, 1]), float(road.arrival[way]))

    def recording(self, row: int = 0) -> int:
        """Return the number of an episode's recording."""
        return int(self.buffers.episodes["recording"][row])

    def ways(self, row: int = 0) -> list[Float64[np.ndarray, "point 2"]]:
        """Return the way of each vehicle of an episode's recording, m to the east and north."""
        road = self.world.road
        recording = self.recording(row)
        vehicles = range(*road.recording_first[recording : recording + 2].tolist())
        return [road.line[road.line_first[v] : road.line_first[v + 1], :2] for v in vehicles]

    def on_road(self, row: int = 0) -> np.ndarray:
        """Return the records of the vehicles of an episode that are on the road, in their order."""
        vehicles = self.buffers.vehicles[row]
        return vehicles[vehicles["present"][: self.buffers.episodes["vehicles"][row]]]

    def places(self, row: int = 0) -> Iterator[tuple[int, tuple[float, ...]]]:
        """Yield each road user of a row: its number, x, y, heading, speed, length and width.

        The ego's number is -1, those of people begin at `PERSON`; m, rad and m/s.
        """
        road = self.world.road
        names = ["x", "y", "heading", "speed", "length", "width"]
        for car in self.on_road(row):
            number = -1 if car["identity"] == self.egos[row] else int(car["identity"])
            yield number, car[names].item()
        recording = self.recording(row)
        step = self.buffers.episodes["sub_steps"][row]
        for person in range(*road.person_first[recording : recording + 2].tolist()):
            at = road.person_state_first[person] + step - road.person_step[person]
            if road.person_state_first[person] <= at < road.person_state_first[person + 1]:
                values = road.person_state[at].tolist() + road.person_size[person].tolist()
                yield PERSON + person, tuple(values)

    @property
    def walks(self) -> bool:
        """Whether people were recorded."""
        return bool(len(self.world.road.person_class))

    def near(self, seconds: float) -> Bool[np.ndarray, " row"]:
        """Return whether each ego reaches a person in its way within some seconds.

        Args:
            seconds: Time, s.
        """
        from socialiq.worlds.highway.core.compile import run_in_parts
        from socialiq_recordings.world import people

        people_near = np.zeros(self.size, bool)
        records = self.buffers.episodes, self.buffers.vehicles
        options = self.world.road, self._settings, float(seconds)
        run_in_parts(people.near, 1, self.size, *records, *options, people_near)
        return people_near

    def braked(self, actions: np.ndarray) -> np.ndarray:
        """Return the number of the strongest braking in the place of each action.

        Args:
            actions: Numbers of levels.
        """
        return np.full_like(actions, int(np.nanargmin(self.levels)))

    @property
    def _arguments(self) -> dict[str, Any]:
        return {"world": self.world, "threads": self._threads}

    def _checked(self, actions: Any) -> np.ndarray:
        as_driver = np.asarray(actions) == AS_DRIVER
        return np.where(as_driver, AS_DRIVER, super()._checked(np.where(as_driver, 0, actions)))

    def _core(self) -> tuple[Any, Any, np.ndarray]:
        from socialiq_recordings.world import core, effects  # import Numba only when it is needed

        junction = self.world.road, self.levels, self.world.config.slack
        return SimpleNamespace(run=core.run, effects=effects.run), junction, np.zeros(0)

    @property
    def credited(self) -> Bool[np.ndarray, "row vehicle"]:
        """Whether each vehicle of the last decision counts in Eq 4.2."""
        return self.buffers.after["counted"]

    def least_gaps(self) -> Float64[np.ndarray, " row"]:
        """Return the least time between the ego's and another's presence in their area, s."""
        times = self.buffers.vehicles["times"]
        entered, left, they_entered, they_left = np.moveaxis(times, -1, 0)
        apart = np.maximum(np.maximum(they_entered - left, entered - they_left) - 1, 0)
        met = np.minimum(entered, they_entered) >= 0
        return np.where(met, apart, np.inf).min(axis=1) / SUB_STEPS

    def _signals(self) -> dict[str, np.ndarray]:
        """Return every signal, with those of touched people if the world has any."""
        signals = super()._signals()
        if not self.walks:
            return signals
        episodes = self.buffers.episodes
        hits = {f"{GROUPS[kind]}_hit": episodes["hit"] == int(kind) for kind in PEOPLE}
        hits["others_hit"] = episodes["others_hit"]
        return signals | {name: column.astype(np.float64) for name, column in hits.items()}
