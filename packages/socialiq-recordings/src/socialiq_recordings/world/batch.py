"""Episodes of a recorded junction side by side."""

from __future__ import annotations

import collections
import math
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.effects import Ledger, record_of
from socialiq.worlds.highway.options import (
    DECIDE,
    DECIDE_AND_RESET,
    RESET,
    SKIP,
    Buffers,
    settings_of,
)
from socialiq.worlds.world import Decisions
from socialiq_recordings.recording import GROUPS, PEOPLE
from socialiq_recordings.world.config import AS_DRIVER, SUB_STEPS

if TYPE_CHECKING:
    from socialiq_recordings.world.recorded_world import RecordedWorld

PERSON = 1_000_000
"""Number of the first person in `JunctionBatch.places`."""

VEHICLE = np.dtype(
    [
        ("along", np.float64),  # coordinate on its way, m
        ("speed", np.float64),  # m/s, NaN before it enters
        ("identity", np.int32),  # number in its recording
        ("status", np.int8),  # `traffic.WAITING`, PRESENT or GONE
        ("counted", np.bool_),  # in Eq 4.2
        ("crashed", np.bool_),  # never in an episode of the ego
    ],
    align=True,
)
"""Record of a vehicle where the effects of the ego are measured."""


class Traffic(NamedTuple):
    """Episodes side by side; vehicles are numbered within the recording of their episode."""

    seed: np.ndarray  # of the episode, uint64
    recording: np.ndarray  # number of the recording
    ego: np.ndarray  # number of the ego
    step: np.ndarray  # sub-steps since the recording's first frame
    begun: np.ndarray  # sub-step at which the episode began
    n_present: np.ndarray  # vehicles on the road
    present: np.ndarray  # their numbers, first those that came first, (row, vehicle)
    status: np.ndarray  # WAITING, PRESENT or GONE, (row, vehicle)
    along: np.ndarray  # coordinates of their middles on their ways, m
    speed: np.ndarray  # m/s
    before: np.ndarray  # speeds at the last decision, or since they entered, m/s
    rate: np.ndarray  # accelerations of the sub-step, m/s²
    barrier: np.ndarray  # coordinate of the next leader or closed line, m
    touched: np.ndarray  # 1 if it has driven into another that is no ego, or was driven into
    driver: np.ndarray  # parameters, (row, vehicle, 6)
    hit: np.ndarray  # class of the person that touches the ego, a `RoadUser`; 0: none
    others_hit: np.ndarray  # vehicles that touch a person for the first time in the decision
    met: np.ndarray  # 1 if it has touched a person and is no ego, (row, vehicle)

    @staticmethod
    def of(world: RecordedWorld, size: int) -> Traffic:
        """Return empty episodes.

        Args:
            world: World of the episodes.
            size: Number of episodes.
        """
        vehicles = size, world.capacity
        by_row = ("recording", "ego", "step", "begun", "n_present", "hit", "others_hit")
        by_vehicle = ("along", "speed", "before", "rate", "barrier")
        return Traffic(
            seed=np.zeros(size, np.uint64),
            **{name: np.zeros(size, np.int64) for name in by_row},
            present=np.zeros(vehicles, np.int64),
            status=np.zeros(vehicles, np.int8),
            **{name: np.zeros(vehicles) for name in by_vehicle},
            touched=np.zeros(vehicles, np.int64),
            met=np.zeros(vehicles, np.int64),
            driver=np.zeros((*vehicles, len(world.road.drivers))),
        )


_Ledger = collections.namedtuple("_Ledger", (*Ledger._fields, "times"))
"""`Ledger`, and the first and last sub-steps at which ego and vehicle were in their conflict area,
-1 for none, (row, vehicle, 4)."""


class State(tuple[np.ndarray, ...]):
    """Arrays that are the complete state of some episodes: `Traffic`, and the batch's own."""

    def arrays(self) -> State:
        """Return all columns."""
        return self

    @staticmethod
    def of(arrays: Sequence[np.ndarray]) -> State:
        """Return the state of these columns."""
        return State(arrays)

    def with_more(self, columns: tuple[np.ndarray, ...]) -> State:
        """Return the state with further columns of a wrapper."""
        return State((*self, *columns))

    def rows(self, chosen: Any) -> State:
        """Return the state of the chosen episodes; indices may repeat."""
        return State(column[np.asarray(chosen)] for column in self)


class JunctionBatch(RoadBatch):
    """Episodes of one world side by side, in the state `traffic`; see `RoadBatch`.

    An action is the number of a level, or `AS_DRIVER`.

    Raises:
        UserError: If `size` or `threads` is not positive, or effects end within an episode.
    """

    def __init__(self, world: RecordedWorld, size: int, threads: int = 1) -> None:
        options = world.options
        effects = world.effects
        most = world.capacity if effects else 0
        buffers = Buffers.of(options, VEHICLE, most, size, traced=effects is not None)
        super().__init__(options, buffers, settings_of(options), threads)
        self.world = world
        self.traffic = Traffic.of(world, size)
        self.faster = world.n_actions - 1
        self.n_actions = world.n_actions
        # m/s²; the last is that of AS_DRIVER
        self.levels = np.array([*world.config.levels, np.nan])
        if effects is not None:
            self.effects = effects
            self._effects = record_of(effects, options)
            self._effects["first_arrival"] = 0  # recorded vehicles have their numbers
            ledger = Ledger.of(self._effects, most, size)
            self.ledger = cast(Any, _Ledger(*ledger, np.zeros((size, most, 4), np.int64)))
            for vehicles in (buffers.after, buffers.before):
                vehicles["identity"] = np.arange(most)

    @property
    def time(self) -> Float32[np.ndarray, " row"]:
        """Number of decisions since the last reset of every episode."""
        steps = self.traffic.step - self.traffic.begun
        return (steps // self.options.frames).astype(np.float32)

    def ways(self, row: int = 0) -> list[Float64[np.ndarray, "point 2"]]:
        """Return the way of each vehicle of an episode's recording, m to the east and north."""
        road = self.world.road
        recording = int(self.traffic.recording[row])
        vehicles = range(*road.recording_first[recording : recording + 2].tolist())
        return [road.line[road.line_first[v] : road.line_first[v + 1], :2] for v in vehicles]

    def places(self, row: int = 0) -> Iterator[tuple[int, tuple[float, ...]]]:
        """Yield each road user of a row: its number, x, y, heading, speed, length and width.

        The ego's number is -1, those of people begin at `PERSON`; m, rad and m/s.
        """
        road = self.world.road
        traffic = self.traffic
        lines = self.ways(row)
        recording = int(traffic.recording[row])
        base = int(road.recording_first[recording])
        ego = int(traffic.ego[row])
        for vehicle in traffic.present[row, : int(traffic.n_present[row])].tolist():
            pose = pose_along(lines[vehicle], float(traffic.along[row, vehicle]))
            size = float(road.length[base + vehicle]), float(road.width[base + vehicle])
            speed = float(traffic.speed[row, vehicle])
            yield -1 if vehicle == ego else vehicle, (*pose, speed, *size)
        for person in range(*road.person_first[recording : recording + 2].tolist()):
            at = road.person_state_first[person] + traffic.step[row] - road.person_step[person]
            if road.person_state_first[person] <= at < road.person_state_first[person + 1]:
                values = road.person_state[at].tolist() + road.person_size[person].tolist()
                yield PERSON + person, tuple(values)

    @property
    def _arguments(self) -> dict[str, Any]:
        return {"world": self.world, "threads": self._threads}

    def _checked(self, actions: Any) -> np.ndarray:
        as_driver = np.asarray(actions) == AS_DRIVER
        return np.where(as_driver, AS_DRIVER, super()._checked(np.where(as_driver, 0, actions)))

    def _core(self) -> tuple[Any, Any, np.ndarray]:
        from socialiq_recordings.world import core, effects  # import Numba only when it is needed

        junction = self.world.road, self.traffic, self.levels, self.world.config.slack
        return SimpleNamespace(run=core.run, effects=effects.run), junction, np.zeros(0)

    def measure(self, command: int, rows: np.ndarray) -> None:
        """Carry out a command of `highway.effects` in some rows, if effects are measured.

        The traffic of all rows is the same afterwards.

        Args:
            command: Number of the command.
            rows: Whether each row is measured.
        """
        if self.ledger is not None:
            kept = [column.copy() for column in self.traffic]
            super().measure(command, rows)  # drives the traffic on
            for column, saved in zip(self.traffic, kept, strict=True):
                column[:] = saved

    @property
    def egos(self) -> Int64[np.ndarray, " row"]:
        """Identity of each ego."""
        return self.traffic.ego.copy()

    @property
    def credited(self) -> Bool[np.ndarray, "row vehicle"]:
        """Whether each vehicle of the last decision counts in Eq 4.2."""
        return self.buffers.after["counted"]

    def least_gaps(self) -> Float64[np.ndarray, " row"]:
        """Return the least time between the ego's and another's presence in their area, s."""
        ledger: Any = self.ledger
        entered, left, they_entered, they_left = np.moveaxis(ledger.times, -1, 0)
        apart = np.maximum(np.maximum(they_entered - left, entered - they_left) - 1, 0)
        met = np.minimum(entered, they_entered) >= 0
        return np.where(met, apart, np.inf).min(axis=1) / SUB_STEPS

    def _run(self, command: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        again = command == DECIDE_AND_RESET
        command = np.where(again, DECIDE, command).astype(np.int8)
        super()._run(command, seeds, seeded, actions)
        self.buffers.reached[:] = self.buffers.observation
        again &= self.buffers.ending != int(Ending.NONE)
        if again.any():
            command = np.where(again, RESET, SKIP).astype(np.int8)
            super()._run(command, seeds, seeded, actions)

    def _decisions(self) -> Decisions:
        results = self.buffers
        seen = results.reached.reshape(self.size, -1)
        pair = RewardPair(*results.rewards.T.copy())
        signals = self._signals() | self._hits()
        touched = results.contact.copy(), results.neighbours_collided.copy()
        ending = results.ending.copy()
        speed = results.speed.copy()
        return Decisions(seen.copy(), pair, ending, signals, speed, *touched)

    def _hits(self) -> dict[str, np.ndarray]:
        """Return the signals of touched people, if the world has any."""
        if not len(self.world.road.person_class):
            return {}
        hits = {f"{GROUPS[kind]}_hit": self.traffic.hit == int(kind) for kind in PEOPLE}
        hits["others_hit"] = self.traffic.others_hit
        return {name: column.astype(np.float64) for name, column in hits.items()}

    @property
    def _columns(self) -> Any:
        own = self.buffers.observation, self._waiting, self.begun
        return State((*self.traffic, *own, *(self.ledger or ())))

    def restore(self, state: Any) -> None:
        """Restore a saved state with as many rows; episodes go on from it undisturbed."""
        super().restore(state)
        self.begun[:] = state[len(self.traffic) + 2]


def pose_along(line: np.ndarray, along: float) -> tuple[float, float, float]:
    """Return the position and direction at a coordinate on a way.

    Args:
        line: Points of the way, one every metre, m.
        along: Coordinate on it, m.

    Returns:
        x and y, m, and the direction, rad.
    """
    piece = min(max(int(along), 0), len(line) - 2)
    step = line[piece + 1] - line[piece]
    x, y = (line[piece] + (along - piece) * step).tolist()
    return x, y, math.atan2(step[1], step[0])
