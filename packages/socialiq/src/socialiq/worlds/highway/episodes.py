"""Episodes of a road side by side, as NumPy arrays: what the batches of all roads share."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float32

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.options import SIGNALS, RoadOptions
from socialiq.worlds.highway.state import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Buffers
from socialiq.worlds.world import Decisions, observed_with_time, rows_of


class State(NamedTuple):
    """Complete state of some episodes, as plain arrays."""

    episodes: np.ndarray  # EPISODE records, (rows,)
    vehicles: np.ndarray  # records of vehicles, (rows, capacity)
    observation: np.ndarray  # (rows, vehicles seen, 7)
    waiting: np.ndarray  # whether the episodes have ended and need a reset, (rows,)

    def rows(self, chosen: Sequence[int] | np.ndarray) -> State:
        """Return the state of the chosen episodes; indices may repeat."""
        return State(*(column[np.asarray(chosen)] for column in self))


class RoadBatch(abc.ABC):
    """Episodes of one road side by side (`worlds.world.Batch`).

    Every episode has its own random stream, so results don't depend on the batch's size or the
    number of threads. By default `step` resets an episode that ends. The new episode continues the
    stream, as in highway-env after a `reset()` without seed.

    Args:
        options: Options of the road.
        buffers: Arrays that the road's core reads and writes, with a row for each episode.
        settings: Record of the options, as the core reads it.
        threads: Number of threads. A single thread is best for small batches.
    """

    n_actions: ClassVar[int]  # of the road, discrete

    def __init__(
        self, options: RoadOptions, buffers: Buffers, settings: np.ndarray, threads: int
    ) -> None:
        if threads < 1:
            raise UserError(f"threads must be at least 1, got {threads}")
        self.options, self.buffers = options, buffers
        self._settings, self._threads = settings, threads
        self.size = size = len(buffers.episodes)
        self._waiting = np.ones(size, bool)  # for a reset
        self.begun = np.zeros(size, bool)  # rows whose random stream has begun

    @abc.abstractmethod
    def _core(self) -> tuple[Any, Any]:
        """Return the entry point of the road's core, and its tables for that."""

    @abc.abstractmethod
    def like(self, size: int) -> RoadBatch:
        """Return a batch of so many episodes of the same road."""

    @property
    @abc.abstractmethod
    def lanes(self) -> np.ndarray:
        """Records of the road's lanes."""

    def branch(self, rows: Sequence[int] | np.ndarray) -> RoadBatch:
        """Return a batch of copies of some episodes, which may repeat; this one is not changed.

        Copies have the same hidden state and random numbers: the same drivers and later traffic.
        """
        copies = self.like(len(rows))
        copies.restore(self.save().rows(rows))
        return copies

    def _run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        """Carry out one command for each episode, as `core.step.run`."""
        from socialiq.worlds.highway.core.compile import run_in_parts  # imports Numba

        run, road = self._core()
        arguments = commands, seeds, seeded, actions, self._settings, road
        run_in_parts(run, self._threads, self.size, self.buffers, *arguments)

    def _checked(self, actions: Any) -> np.ndarray:
        """Return a whole number for each episode, int64; refuse other actions."""
        chosen = np.asarray(actions)
        if chosen.shape != (self.size,) or chosen.dtype.kind not in "iu":
            raise UserError(f"actions must be {self.size} whole numbers, got {actions!r}")
        if chosen.min() < 0 or chosen.max() >= self.n_actions:
            numbers = sorted({*chosen.tolist()})
            raise UserError(f"actions must be 0 to {self.n_actions - 1}, got {numbers}")
        return chosen.astype(np.int64)

    @property
    def observation(self) -> Float32[np.ndarray, "batch feature"]:
        """Current observation of every episode, (batch, features)."""
        return self.buffers.observation.reshape(self.size, -1).copy()

    @property
    def time(self) -> Float32[np.ndarray, " batch"]:
        """Number of decisions since the last reset of every episode, the clock's feature."""
        seconds = self.buffers.episodes["time"] * self.options.policy_frequency
        return np.rint(seconds).astype(np.float32)

    def seen_by(self, policy: Any) -> Float32[np.ndarray, "batch feature"]:
        """Return what a policy observes: with the time at the end if it has one feature more."""
        return observed_with_time(self.observation, self.time, policy)

    def reset(
        self, seeds: int | Sequence[int] | np.ndarray | None = None, rows: Any = None
    ) -> Float32[np.ndarray, "batch feature"]:
        """Start new episodes in some rows, an index or a mask, and return all observations.

        The seeds are one for each row, or one number: row i gets seed + i. None continues the rows'
        streams.

        Raises:
            UserError: If a seed is negative, or a stream to continue was never seeded.
        """
        chosen = rows_of(rows, self.size)
        if seeds is None and not self.begun[chosen].all():
            raise UserError("the first reset needs a seed")
        entropy = np.zeros(self.size, np.uint64)
        if seeds is not None:
            entropy[chosen] = seeds_of(seeds, int(chosen.sum()))
        commands = np.where(chosen, RESET, SKIP).astype(np.int8)
        self._run(commands, entropy, chosen & (seeds is not None), np.zeros(self.size, np.int64))
        self._waiting[chosen], self.begun[chosen] = False, True
        return self.observation

    def step(self, actions: Any, auto_reset: bool = True, rows: Any = None) -> Decisions:
        """Take one decision in every episode, or in some rows, an index or a mask.

        Results of the others are those of their last decision. With `auto_reset` a new episode
        starts where one ended, and `observation` belongs to it. Otherwise episodes that ended must
        be reset before the next step.

        Raises:
            UserError: If an action is not one of the road, or an episode has not begun or has
                ended.
        """
        from socialiq.worlds.highway.core import step  # import Numba only when it is needed

        chosen, deciding = self._checked(actions), rows_of(rows, self.size)
        if (self._waiting & deciding).any():
            raise UserError("an episode has not begun, or has ended: reset it first")
        command = DECIDE_AND_RESET if auto_reset else DECIDE
        commands = np.where(deciding, command, SKIP).astype(np.int8)
        self._run(commands, np.zeros(self.size, np.uint64), np.zeros(self.size, bool), chosen)
        buffers, left = self.buffers, np.zeros(self.size, bool)
        if not auto_reset:
            self._waiting |= deciding & (buffers.ending != int(Ending.NONE))
        step.off_road(self.lanes, buffers.after, buffers.present, left, 0, self.size)
        return Decisions(
            observation=buffers.reached.reshape(self.size, -1).copy(),
            rewards=RewardPair(*buffers.rewards.T.copy()),
            ending=buffers.ending.copy(),
            signals=dict(zip(SIGNALS, buffers.signals.T.copy(), strict=True)),
            speed=buffers.speed.copy(),
            contact=buffers.contact.copy(),
            neighbours_collided=buffers.neighbours_collided.copy(),
            classical=RewardPair(*buffers.classical.T.copy()),
            off_road=left,
        )

    @property
    def _columns(self) -> State:
        buffers = self.buffers
        return State(buffers.episodes, buffers.vehicles, buffers.observation, self._waiting)

    def save(self) -> State:
        """Return a copy of the state of every episode."""
        return State(*(column.copy() for column in self._columns))

    def restore(self, state: State) -> None:
        """Restore a state saved with the same options; episodes go on from it with identical bits.

        Raises:
            UserError: If it has not as many rows as the batch, or other shapes.
        """
        columns = self._columns
        for column, saved in zip(columns, state, strict=True):
            if column.shape != saved.shape or column.dtype != saved.dtype:
                raise UserError(
                    f"the saved state has the shape {saved.shape}, this batch {column.shape}: "
                    "restore it under the options and the size it was saved with"
                )
        for column, saved in zip(columns, state, strict=True):
            column[:] = saved
        self.begun[:] = self.buffers.episodes["increment_low"] != 0  # odd in every stream


def seeds_of(seeds: int | Sequence[int] | np.ndarray, count: int) -> np.ndarray:
    """Return a seed for each of `count` rows, uint64, given each or the first of consecutive ones.

    Raises:
        UserError: If one isn't a whole number of at least 0 below 2**64, or there are not so many.
    """
    array = np.asarray(seeds)
    if array.dtype.kind == "O" or array.dtype.kind == "f":
        array = np.array(seeds, object)  # numpy mixes large whole numbers into floats
    numbers = array.ravel().tolist()
    if not all(type(seed) is int and 0 <= seed < 2**64 for seed in numbers):
        raise UserError(f"seeds must be whole numbers of at least 0, below 2**64, got {seeds!r}")
    if array.ndim == 0:
        return np.uint64(numbers[0]) + np.arange(count, dtype=np.uint64)
    if array.shape != (count,):
        raise UserError(f"{count} seeds are needed, one for each row, got {array.size}")
    return np.array(numbers, np.uint64)
