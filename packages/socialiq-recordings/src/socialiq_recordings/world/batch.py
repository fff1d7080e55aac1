"""Episodes of a recorded junction side by side: their state, resets and decisions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.options import FEATURES, SIGNALS
from socialiq.worlds.intersection.options import settings_of
from socialiq.worlds.world import Decisions, observed_with_time
from socialiq_recordings.world.recorded_world import RecordedWorld

N_PARAMETERS = 6
"""Parameters of a driver; `drivers.Drivers`."""

AS_DRIVER = -1
"""Action with which the ego drives as a driver of the population."""


class Traffic(NamedTuple):
    """Episodes side by side; vehicles are numbered within the recording of their episode.

    Attributes:
        seed: Of the episode, uint64.
        recording: Number of the recording.
        ego: Number of the ego.
        step: Sub-steps since the recording's first frame.
        begun: Sub-step at which the episode began.
        n_present: Vehicles on the road.
        present: Their numbers, first those that came first, (row, vehicle).
        status: WAITING, PRESENT or GONE, (row, vehicle).
        along: Coordinates of their middles on their ways, m.
        speed: m/s.
        before: Speeds at the last decision, or since they entered, m/s.
        rate: Accelerations of the sub-step, m/s².
        barrier: Coordinate of the next leader or closed line, m.
        driver: Parameters, (row, vehicle, 6).
    """

    seed: np.ndarray
    recording: np.ndarray
    ego: np.ndarray
    step: np.ndarray
    begun: np.ndarray
    n_present: np.ndarray
    present: np.ndarray
    status: np.ndarray
    along: np.ndarray
    speed: np.ndarray
    before: np.ndarray
    rate: np.ndarray
    barrier: np.ndarray
    driver: np.ndarray

    @staticmethod
    def of(world: RecordedWorld, size: int) -> Traffic:
        """Return empty episodes."""
        rows, vehicles = (size,), (size, world.capacity)
        numbers = {name: np.zeros(rows, np.int64) for name in _NUMBERS}
        floats = {name: np.zeros(vehicles) for name in _FLOATS}
        return Traffic(
            seed=np.zeros(rows, np.uint64),
            **numbers,
            present=np.zeros(vehicles, np.int64),
            status=np.zeros(vehicles, np.int8),
            **floats,
            driver=np.zeros((*vehicles, N_PARAMETERS)),
        )


_NUMBERS = ("recording", "ego", "step", "begun", "n_present")
_FLOATS = ("along", "speed", "before", "rate", "barrier")


class Made(NamedTuple):
    """Results of a decision of every episode.

    Attributes:
        observation: Of the state reached, (row, vehicles seen, 7), float32.
        signals: In the order of `SIGNALS`, unweighted.
        pair: r_env and r_social, (row, 2).
        ending: Values of `Ending`, int8.
        speed: The ego's, m/s.
        contact: Values of `Contact`, int8: which vehicle struck, if the ego collided.
    """

    observation: np.ndarray
    signals: np.ndarray
    pair: np.ndarray
    ending: np.ndarray
    speed: np.ndarray
    contact: np.ndarray

    @staticmethod
    def of(world: RecordedWorld, size: int) -> Made:
        """Return empty results."""
        return Made(
            np.zeros((size, world.config.observed_vehicles, len(FEATURES)), np.float32),
            np.zeros((size, len(SIGNALS))),
            np.zeros((size, 2)),
            np.zeros(size, np.int8),
            np.zeros(size),
            np.zeros(size, np.int8),
        )


class State(NamedTuple):
    """Complete state of some episodes.

    Attributes:
        traffic: Vehicles and drivers.
        observation: Present observations.
        waiting: Whether the episodes have ended and need a reset.
        begun: Whether their random streams have begun.
    """

    traffic: Traffic
    observation: np.ndarray
    waiting: np.ndarray
    begun: np.ndarray

    def rows(self, chosen: Any) -> State:
        """Return the state of the chosen episodes; indices may repeat."""
        rows = np.asarray(chosen)
        traffic = Traffic(*(column[rows] for column in self.traffic))
        return State(traffic, *(column[rows] for column in self[1:]))


class JunctionBatch:
    """Episodes of one world side by side, each with its own random stream.

    Results depend neither on the batch's size nor on the number of threads.

    Args:
        world: The world.
        size: Number of episodes.
        threads: Number of threads.

    Attributes:
        world: The world.
        size: Number of episodes.
        traffic: State of the episodes.
        begun: Rows whose random stream has begun.

    Raises:
        UserError: If a number is not positive.
    """

    def __init__(self, world: RecordedWorld, size: int, threads: int = 1) -> None:
        for name, value in (("size", size), ("threads", threads)):
            if value < 1:
                raise UserError(f"{name} must be at least 1, got {value}")
        from socialiq_recordings.world import core  # import Numba only when it is needed

        self._core = core
        self.world, self.size, self._threads = world, size, threads
        self.traffic = Traffic.of(world, size)
        self.begun = np.zeros(size, bool)
        self._made = Made.of(world, size)
        self._waiting = np.ones(size, bool)  # for a reset
        self._settings = settings_of(world.config.options(world.max_speed))
        self._levels = np.array(world.config.levels)

    @property
    def observation(self) -> Float32[np.ndarray, "row feature"]:
        """Current observation of every episode."""
        return self._made.observation.reshape(self.size, -1).copy()

    @property
    def time(self) -> Float32[np.ndarray, " row"]:
        """Number of decisions since the last reset of every episode."""
        steps = self.traffic.step - self.traffic.begun
        return (steps // self.world.config.frames).astype(np.float32)

    def seen_by(self, policy: Any) -> Float32[np.ndarray, "row feature"]:
        """Return what a policy observes: with the time at the end if it has one feature more."""
        return observed_with_time(self.observation, self.time, policy)

    def reset(self, seeds: Any = None, rows: Any = None) -> Float32[np.ndarray, "row feature"]:
        """Start new episodes.

        Args:
            seeds: A seed for each row to reset; None continues the rows' streams.
            rows: Rows to reset, as an index or a mask; all by default.

        Returns:
            The observation of all rows.

        Raises:
            UserError: If a seed is negative, or a stream to continue was never seeded.
        """
        chosen = np.zeros(self.size, bool)
        chosen[slice(None) if rows is None else rows] = True
        entropy = np.zeros(self.size, np.uint64)
        if seeds is None and not self.begun[chosen].all():
            raise UserError("the first reset needs a seed")
        if seeds is not None:
            numbers = [int(seed) for seed in np.ravel(np.asarray(seeds, object))]
            if len(numbers) != chosen.sum() or not all(0 <= number < 2**64 for number in numbers):
                raise UserError("seeds must be whole numbers of at least 0, one for each row")
            entropy[chosen] = np.array(numbers, np.uint64)
        commands = np.where(chosen, self._core.RESET, self._core.SKIP).astype(np.int8)
        self._run(commands, np.full(self.size, seeds is not None), entropy, np.zeros(self.size))
        self._waiting[chosen], self.begun[chosen] = False, True
        return self.observation

    def save(self) -> State:
        """Return a copy of the state of every episode."""
        traffic = Traffic(*(column.copy() for column in self.traffic))
        columns = (self._made.observation, self._waiting, self.begun)
        return State(traffic, *(column.copy() for column in columns))

    def restore(self, state: State) -> None:
        """Restore a saved state with as many rows; episodes go on from it undisturbed."""
        for column, saved in zip(self.traffic, state.traffic, strict=True):
            column[:] = saved
        self._made.observation[:] = state.observation
        self._waiting[:], self.begun[:] = state.waiting, state.begun

    def like(self, size: int) -> JunctionBatch:
        """Return a batch of so many episodes of the same world."""
        return JunctionBatch(self.world, size, self._threads)

    def branch(self, rows: Any) -> JunctionBatch:
        """Return a batch of copies of some episodes, which may repeat; this one is not changed."""
        copies = self.like(len(rows))
        copies.restore(self.save().rows(rows))
        return copies

    def step(self, actions: Any, auto_reset: bool = False, rows: Any = None) -> Decisions:
        """Take one decision in every episode, or in some.

        Args:
            actions: A level for each episode; `AS_DRIVER`: as a driver of the population.
            auto_reset: Start a new episode where one ended.
            rows: Episodes to advance, as an index or a mask; all by default.

        Raises:
            UserError: If an action is none, or an episode has not begun or has ended.
        """
        chosen = np.asarray(actions)
        if chosen.shape != (self.size,) or chosen.dtype.kind not in "iu":
            raise UserError(f"actions must be {self.size} whole numbers, got {actions!r}")
        if chosen.min() < AS_DRIVER or chosen.max() >= len(self._levels):
            raise UserError(
                f"actions must be 0 to {len(self._levels) - 1}, got {sorted({*chosen.tolist()})}"
            )
        deciding = np.zeros(self.size, bool)
        deciding[slice(None) if rows is None else rows] = True
        if (self._waiting & deciding).any():
            raise UserError("an episode has not begun, or has ended: reset it first")
        levels = np.where(chosen == AS_DRIVER, np.nan, self._levels[chosen])
        commands = np.where(deciding, self._core.DECIDE, self._core.SKIP).astype(np.int8)
        unseeded = np.zeros(self.size, bool)
        self._run(commands, unseeded, np.zeros(self.size, np.uint64), levels)
        self._waiting |= deciding & (self._made.ending != int(Ending.NONE))
        results = self._made
        decisions = Decisions(
            self.observation,
            RewardPair(*results.pair.T.copy()),
            results.ending.copy(),
            dict(zip(SIGNALS, results.signals.T.copy(), strict=True)),
            results.speed.copy(),
            results.contact.copy(),
        )
        if auto_reset and (ended := self._waiting & deciding).any():
            self.reset(rows=ended)
        return decisions

    def _run(self, commands: Any, seeded: Any, seeds: Any, levels: Any) -> None:
        from socialiq.worlds.highway.core.compile import run_in_parts

        run_in_parts(
            self._core.run,
            self._threads,
            self.size,
            self.world.road,
            self.traffic,
            self._made,
            commands,
            seeded,
            seeds,
            levels,
            self._settings,
            self.world.config.slack,
        )
