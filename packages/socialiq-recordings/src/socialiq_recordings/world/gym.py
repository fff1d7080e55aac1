"""Episodes of a recorded junction: side by side, and one as a Gymnasium environment."""

from __future__ import annotations

import collections
import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from socialiq.errors import UserError
from socialiq.physics import corners
from socialiq.types import Ending, RewardPair
from socialiq.worlds.gym import RoadEnv
from socialiq.worlds.highway.effects import Ledger, record_of
from socialiq.worlds.highway.options import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Buffers
from socialiq.worlds.highway.world import RoadBatch
from socialiq.worlds.intersection.options import settings_of
from socialiq.worlds.world import Decisions
from socialiq_recordings.recording import GROUPS, PEOPLE
from socialiq_recordings.world.recorded_world import AS_DRIVER, SUB_STEPS, VEHICLE, RecordedWorld

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        """Return empty episodes."""
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
        options, effects = world.options, world.effects
        most = world.capacity if effects else 0
        buffers = Buffers.of(options, VEHICLE, most, size, traced=effects is not None)
        super().__init__(options, buffers, settings_of(options), threads)
        self.world, self.traffic = world, Traffic.of(world, size)
        self.n_actions, self.faster = world.n_actions, world.n_actions - 1
        # m/s²; the last is that of AS_DRIVER
        self.levels = np.array([*world.config.levels, np.nan])
        if effects is not None:
            self.effects, self._effects = effects, record_of(effects, options)
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
        road, recording = self.world.road, int(self.traffic.recording[row])
        vehicles = range(*road.recording_first[recording : recording + 2].tolist())
        return [road.line[road.line_first[v] : road.line_first[v + 1], :2] for v in vehicles]

    def places(self, row: int = 0) -> Iterator[tuple[int, tuple[float, ...]]]:
        """Yield each road user of a row: its number, x, y, heading, speed, length and width.

        The ego's number is -1, those of people begin at `PERSON`; m, rad and m/s.
        """
        road, traffic, lines = self.world.road, self.traffic, self.ways(row)
        recording = int(traffic.recording[row])
        base, ego = int(road.recording_first[recording]), int(traffic.ego[row])
        for vehicle in traffic.present[row, : int(traffic.n_present[row])].tolist():
            place = _place(lines[vehicle], float(traffic.along[row, vehicle]))
            size = float(road.length[base + vehicle]), float(road.width[base + vehicle])
            speed = float(traffic.speed[row, vehicle])
            yield -1 if vehicle == ego else vehicle, (*place, speed, *size)
        for person in range(*road.person_first[recording : recording + 2].tolist()):
            at = road.person_state_first[person] + traffic.step[row] - road.person_step[person]
            if road.person_state_first[person] <= at < road.person_state_first[person + 1]:
                values = road.person_state[at].tolist() + road.person_size[person].tolist()
                yield PERSON + person, tuple(values)

    def like(self, size: int) -> JunctionBatch:
        """Return a batch of so many episodes of the same world."""
        return JunctionBatch(self.world, size, self._threads)

    def _checked(self, actions: Any) -> np.ndarray:
        as_driver = np.asarray(actions) == AS_DRIVER
        return np.where(as_driver, AS_DRIVER, super()._checked(np.where(as_driver, 0, actions)))

    def _core(self) -> tuple[Any, Any, np.ndarray]:
        from socialiq_recordings.world import core, effects  # import Numba only when it is needed

        junction = self.world.road, self.traffic, self.levels, self.world.config.slack
        return SimpleNamespace(run=core.run, effects=effects.run), junction, np.zeros(0)

    def measure(self, command: int, rows: np.ndarray) -> None:
        """Carry out a command of `highway.effects` in some rows, if effects are measured."""
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
        seen, pair = results.reached.reshape(self.size, -1), RewardPair(*results.rewards.T.copy())
        signals = self._signals() | self._hits()
        touched = results.contact.copy(), results.neighbours_collided.copy()
        ending, speed = results.ending.copy(), results.speed.copy()
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


class RecordedJunctionEnv(RoadEnv):
    """Recorded junction with the Gymnasium interface.

    The ego takes the place of a recorded vehicle at a recorded moment, both drawn by the seed, and
    drives its way. The others are drivers of the calibrated population; they start as recorded,
    enter where and when the recorded ones did, and react. The scalar reward is R(α) (Eq 4.3).

    `info` has `reward_pair` (r_env, r_social), `signals` (every named signal, unweighted), `ending`
    (arrival, collision, timeout, or other: over a closed line), the ego's `speed` in m/s, `contact`
    (which vehicle struck), `neighbours_collided` (number of others that drove into each other), and
    in that of `reset` the `recording` and `vehicle` of its place. Where people were recorded, the
    signals have `pedestrian_hit` and `bicycle_hit` (whether one touches the ego), and `others_hit`.

    Args:
        file: World of `socialiq data world`.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: "rgb_array" or None.
        clock: Whether observations end with the time, in decisions since the reset.
        sha256: Of the world's content, if it must be a certain one.

    Raises:
        UserError: If the file is no world or another one, or the angle is invalid.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self,
        file: str | Path = "",
        angle: float = 0.0,
        render_mode: str | None = None,
        clock: bool = False,
        sha256: str = "",
    ) -> None:
        world = load_world(file)
        if sha256 and sha256 != world.sha256:
            raise UserError(f"{file} is not the world with the SHA-256 {sha256[:12]}...")
        super().__init__(world, angle, render_mode, clock)
        self.world: RecordedWorld
        self.batch: JunctionBatch

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        observation, _ = super().reset(seed=seed, options=options)
        traffic, world = self.batch.traffic, self.world
        recording = int(traffic.recording[0])
        vehicle = int(world.road.recording_first[recording] + traffic.ego[0])
        described = world.provenance.get("recordings", [])
        name = described[recording]["recording"] if recording < len(described) else ""
        return observation, {"recording": name, "vehicle": int(world.road.identity[vehicle])}

    def render(self) -> np.ndarray | None:
        """Return a picture of the current state, uint8 (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        from socialiq.worlds.pictures import pixels

        return pixels(scene(self.batch))


def load_world(file: str | Path) -> RecordedWorld:
    """Read a world, once for a file that doesn't change.

    Raises:
        UserError: If no file is named, or it is no world.
    """
    if not str(file):
        raise UserError("name the world: file=W, a file of `socialiq data world`")
    path = Path(file).absolute()
    return _load(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=4)
def _load(path: Path, _changed: int) -> RecordedWorld:
    return RecordedWorld.load(path)


PERSON = 1_000_000
"""Number of the first person in `JunctionBatch.places`."""
_REACH = 50.0  # m around the ego
_BAR = 1.6  # m to either side of a closed line


def scene(batch: JunctionBatch, row: int = 0) -> Figure:
    """Draw a moment of an episode: all ways, the ego's way, vehicles, closed lines."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Polygon

    from socialiq.plotting.style import COLORS, figure, finish
    from socialiq.worlds.pictures import EGO, OTHER

    road, traffic = batch.world.road, batch.traffic
    recording = int(traffic.recording[row])
    base = int(road.recording_first[recording])
    drawing = figure(5.0, 5.0)
    axes = drawing.subplots()
    lines = batch.ways(row)
    axes.add_collection(LineCollection(lines, colors="#d5d5d5", linewidths=1.0))
    ego = int(traffic.ego[row])
    axes.plot(*lines[ego].T, color=EGO, linewidth=1.2)
    now = float(traffic.step[row]) / 10
    for slot in range(int(traffic.n_present[row])):
        vehicle = int(traffic.present[row, slot])
        for at, begin, until in road.closed[
            road.closed_first[base + vehicle] : road.closed_first[base + vehicle + 1]
        ]:
            if begin <= now < until:
                x, y, heading = _place(lines[vehicle], float(at))
                dx, dy = -_BAR * math.sin(heading), _BAR * math.cos(heading)
                ends = [x - dx, x + dx], [y - dy, y + dy]
                axes.plot(*ends, color="black", linewidth=2.0, zorder=4)
    for number, (x, y, heading, _, *size) in batch.places(row):
        ink = EGO if number < 0 else OTHER if number < PERSON else COLORS["altruistic"]
        axes.add_patch(Polygon(corners((x, y), heading, *size), color=ink, zorder=3))
    x, y, _ = _place(lines[ego], float(traffic.along[row, ego]))
    axes.set_aspect("equal")
    axes.set(xlim=(x - _REACH, x + _REACH), ylim=(y - _REACH, y + _REACH))
    finish(axes, f"{now:.1f} s", xlabel="m to the east", ylabel="m to the north")
    return drawing


def _place(line: np.ndarray, along: float) -> tuple[float, float, float]:
    piece = min(max(int(along), 0), len(line) - 2)
    step = line[piece + 1] - line[piece]
    x, y = (line[piece] + (along - piece) * step).tolist()
    return x, y, math.atan2(step[1], step[0])
