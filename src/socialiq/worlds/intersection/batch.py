"""Many episodes of the intersection side by side, as NumPy arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32, Int8, Int64

from socialiq.errors import UserError, one_of
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.actions import checked
from socialiq.worlds.intersection.actions import commands as meant
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.settings import SIGNALS, settings_of
from socialiq.worlds.intersection.state import (
    DECIDE,
    DECIDE_AND_RESET,
    RESET,
    SKIP,
    Buffers,
)

BackEnd = Literal["core", "highway_env"]
BACK_ENDS = ("core", "highway_env")


class Decisions(NamedTuple):
    """Results of one decision in every episode.

    Attributes:
        observation: Of the state reached, before any reset, (batch, features).
        rewards: The reward pair, each (batch,).
        ending: Values of `types.Ending`, (batch,).
        signals: Every named signal, unweighted, each (batch,).
        speed: The ego's speed, m/s, (batch,).
        contact: Values of `Contact`: which vehicle struck, if the ego collided, (batch,).
        neighbours_collided: Number of other vehicles that collided with each other, (batch,).
        classical: The ego's own reward and its neighbours' mean (thesis A.1), each (batch,).
    """

    observation: Float32[np.ndarray, "batch feature"]
    rewards: RewardPair
    ending: Int8[np.ndarray, " batch"]
    signals: Mapping[str, Float[np.ndarray, " batch"]]
    speed: Float[np.ndarray, " batch"]
    contact: Int8[np.ndarray, " batch"]
    neighbours_collided: Int64[np.ndarray, " batch"]
    classical: RewardPair


class State(NamedTuple):
    """Complete state of some episodes, as plain arrays.

    Attributes:
        episodes: EPISODE records, (rows,).
        vehicles: VEHICLE records, (rows, capacity).
        observation: (rows, vehicles seen, 7).
        waiting: Whether the episodes have ended and need a reset, (rows,).
    """

    episodes: np.ndarray
    vehicles: np.ndarray
    observation: np.ndarray
    waiting: np.ndarray

    def rows(self, chosen: Sequence[int] | np.ndarray) -> State:
        """Return the state of the chosen episodes; indices may repeat."""
        return State(*(column[np.asarray(chosen)] for column in self))


@runtime_checkable
class Engine(Protocol):
    """Back end that advances the episodes: the compiled core, or the real highway-env."""

    def run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        """Carry out one command for each episode; see `step.run`.

        Actions are numbers, or rows of continuous values.
        """
        ...


class Core:
    """Compiled core as an engine."""

    def __init__(self, options: Options, buffers: Buffers, threads: int) -> None:
        from socialiq.worlds.intersection.core import step  # import Numba only when it is needed

        self._step = step
        self._buffers, self._threads = buffers, threads
        self._settings = settings_of(options)

    def run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        """Carry out one command for each episode."""
        if actions.ndim == 2:
            actions = self._held(actions, commands != SKIP)
        self._step.on_threads(
            self._threads, self._buffers, commands, seeds, seeded, actions, self._settings
        )

    def _held(self, actions: Any, rows: np.ndarray) -> Int64[np.ndarray, " batch"]:
        """Write continuous actions into the egos' records; return numbers for the entry point."""
        ego = np.flatnonzero(rows), self._buffers.episodes["ego"][rows]
        for name, values in meant(actions[rows])._asdict().items():
            self._buffers.vehicles[name][ego] = values
        return np.zeros(len(actions), np.int64)


class Batch:
    """Episodes of one scenario side by side.

    Every episode has its own random stream, so results don't depend on the batch's size or the
    number of threads. By default `step` resets an episode that ends. The new episode continues the
    stream, as in highway-env after a `reset()` without seed.

    Args:
        options: Scenario and reward options.
        size: Number of episodes.
        threads: Number of threads. A single thread is best for small batches.
        back_end: "core", or "highway_env" for the real environment, hundreds of times slower.
        traced: Record the vehicles of every sub-step in `buffers.trace`, for films.

    Attributes:
        buffers: Arrays that the engine reads and writes.
        begun: Rows whose random stream has begun, bool (batch,).

    Raises:
        UserError: If a number is not positive, or highway-env is requested and not installed.
    """

    def __init__(
        self,
        options: Options,
        size: int,
        threads: int = 1,
        back_end: BackEnd = "core",
        traced: bool = False,
    ) -> None:
        for name, value in (("size", size), ("threads", threads)):
            if value < 1:
                raise UserError(f"{name} must be at least 1, got {value}")
        one_of("back end", back_end, BACK_ENDS)
        self.options, self.size = options, size
        self.buffers = Buffers.of(options, size, traced)
        self._waiting = np.ones(size, bool)  # for a reset
        self.begun = np.zeros(size, bool)
        self._everyone, self._unseeded = np.ones(size, bool), np.zeros(size, bool)
        self._no_seeds = np.zeros(size, np.uint64)
        self._engine = self._engine_of(back_end, threads)

    def _engine_of(self, back_end: BackEnd, threads: int) -> Engine:
        if back_end == "core":
            return Core(self.options, self.buffers, threads)
        from socialiq.worlds.intersection.reference.engine import Reference

        return Reference(self.options, self.buffers)

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
        seen = self.observation
        if getattr(policy, "n_features", None) != seen.shape[1] + 1:
            return seen
        return np.column_stack([seen, self.time])

    def reset(
        self, seeds: int | Sequence[int] | np.ndarray | None = None, rows: Any = None
    ) -> Float32[np.ndarray, "batch feature"]:
        """Start new episodes.

        Args:
            seeds: A seed for each row, or one number: row i gets seed + i. None continues the
                rows' streams.
            rows: Rows to reset, as an index or a mask; all by default.

        Returns:
            The observation of all rows.

        Raises:
            UserError: If a seed is negative, or a stream to continue was never seeded.
        """
        chosen = self._chosen(rows)
        seeded = chosen & (seeds is not None)
        if seeds is None and not self.begun[chosen].all():
            raise UserError("the first reset needs a seed")
        entropy = np.zeros(self.size, np.uint64)
        if seeds is not None:
            entropy[chosen] = seeds_of(seeds, int(chosen.sum()))
        commands = np.where(chosen, RESET, SKIP).astype(np.int8)
        self._engine.run(commands, entropy, seeded, np.zeros(self.size, np.int64))
        self._waiting[chosen] = False
        self.begun[chosen] = True
        return self.observation

    def step(self, actions: Any, auto_reset: bool = True, rows: Any = None) -> Decisions:
        """Take one decision in every episode, or in some.

        Args:
            actions: An action for each episode: 0 slower, 1 idle, 2 faster; or, if the options
                say so, continuous ones of float32 or float64 in [-1, 1], (batch, values).
            auto_reset: Start a new episode where one ended; `observation` then belongs to it.
                Otherwise episodes that ended must be reset before the next step.
            rows: Episodes to advance, as an index or a mask; all by default. The results of the
                others are those of their last decision.

        Raises:
            UserError: If an action is not one of these, or an episode has not begun or has ended.
        """
        chosen = checked(actions, self.size, self.options)
        deciding = self._chosen(rows)
        if (self._waiting & deciding).any():
            raise UserError("an episode has not begun, or has ended: reset it first")
        command = DECIDE_AND_RESET if auto_reset else DECIDE
        commands = np.where(deciding, command, SKIP).astype(np.int8)
        self._engine.run(commands, self._no_seeds, self._unseeded, chosen)
        if not auto_reset:
            self._waiting |= deciding & (self.buffers.ending != int(Ending.NONE))
        return self._decisions()

    def _chosen(self, rows: Any) -> Bool[np.ndarray, " batch"]:
        if rows is None:
            return self._everyone
        chosen = np.zeros(self.size, bool)
        chosen[rows] = True
        return chosen

    def _decisions(self) -> Decisions:
        made = self.buffers
        return Decisions(
            observation=made.reached.reshape(self.size, -1).copy(),
            rewards=RewardPair(*made.rewards.T.copy()),
            ending=made.ending.copy(),
            signals=dict(zip(SIGNALS, made.signals.T.copy(), strict=True)),
            speed=made.speed.copy(),
            contact=made.contact.copy(),
            neighbours_collided=made.neighbours_collided.copy(),
            classical=RewardPair(*made.classical.T.copy()),
        )

    def save(self) -> State:
        """Return a copy of the state of every episode.

        Raises:
            UserError: On the back end highway_env, whose state is held in Python objects.
        """
        self._check_core("saved")
        made = self.buffers
        kept = (made.episodes, made.vehicles, made.observation, self._waiting)
        return State(*(column.copy() for column in kept))

    def restore(self, state: State) -> None:
        """Restore a saved state. Episodes continue from it with identical bits.

        Args:
            state: State with as many rows as the batch, saved with the same options;
                `State.rows` repeats or picks rows, for branching.

        Raises:
            UserError: If the shapes differ, or on the back end highway_env.
        """
        self._check_core("restored")
        made = self.buffers
        kept = (made.episodes, made.vehicles, made.observation, self._waiting)
        for column, saved in zip(kept, state, strict=True):
            if column.shape != saved.shape or column.dtype != saved.dtype:
                raise UserError(
                    f"the saved state has the shape {saved.shape}, this batch {column.shape}: "
                    "restore it under the options and the size it was saved with"
                )
        for column, saved in zip(kept, state, strict=True):
            column[:] = saved
        self.begun[:] = made.episodes["increment_low"] != 0  # odd in every stream

    def _check_core(self, what: str) -> None:
        if not isinstance(self._engine, Core):
            raise UserError(f"the state of highway-env can't be {what}: use the core")


def seeds_of(seeds: int | Sequence[int] | np.ndarray, count: int) -> np.ndarray:
    """Return a seed for each of `count` rows, uint64.

    Args:
        seeds: A seed for each, or the first of consecutive ones.
        count: Number of rows.

    Raises:
        UserError: If one isn't a whole number of at least 0 below 2**64, or there are not so many.
    """
    wanted = np.asarray(seeds)
    if wanted.dtype.kind == "O" or wanted.dtype.kind == "f":
        wanted = np.array(seeds, object)  # numpy mixes large whole numbers into floats
    given = wanted.ravel().tolist()
    if not all(type(seed) is int and 0 <= seed < 2**64 for seed in given):
        raise UserError(f"seeds must be whole numbers of at least 0, below 2**64, got {seeds!r}")
    if wanted.ndim == 0:
        return np.uint64(given[0]) + np.arange(count, dtype=np.uint64)
    if wanted.shape != (count,):
        raise UserError(f"{count} seeds are needed, one for each row, got {wanted.size}")
    return np.array(given, np.uint64)
