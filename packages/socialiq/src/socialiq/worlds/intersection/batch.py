"""Many episodes of the intersection side by side, and the actions of its ego."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from gymnasium import spaces
from jaxtyping import Float, Int64

from socialiq.errors import UserError, one_of
from socialiq.worlds.highway.episodes import RoadBatch, State, check_sizes, checked_numbers
from socialiq.worlds.highway.state import SKIP, Buffers
from socialiq.worlds.intersection.options import ContinuousOptions, Options, settings_of
from socialiq.worlds.intersection.state import ACTIONS, buffers_of

ACCELERATION_RANGE = (-5.0, 5.0)  # m/s², of actions -1 and 1
STEERING_RANGE = (-math.pi / 4, math.pi / 4)  # rad


class Commands(NamedTuple):
    """Held commands of the ego, each (batch,).

    Attributes:
        acceleration: m/s².
        steering: Angle of the front wheels, rad.
    """

    acceleration: Float[np.ndarray, " batch"]
    steering: Float[np.ndarray, " batch"]


def width(options: Options) -> int:
    """Return the number of values of a continuous action; 0 if actions are discrete."""
    if not isinstance(options, ContinuousOptions):
        return 0
    return 2 if options.actions == "continuous_steering" else 1


def space_of(options: Options) -> spaces.Discrete | spaces.Box:
    """Return Gymnasium's space of one action: numbers of actions, or values in [-1, 1]."""
    if not options.continuous:
        return spaces.Discrete(len(ACTIONS))
    return spaces.Box(-1.0, 1.0, (width(options),), np.float32)


def checked(actions: Any, size: int, options: Options) -> Any:
    """Return the actions of a batch as an array, int64 or floats as given.

    Args:
        actions: One for each episode: 0, 1 or 2, or rows of values in [-1, 1].
        size: Number of episodes.
        options: Scenario.

    Raises:
        UserError: If they have another shape or type, or one is out of range or NaN.
    """
    if options.continuous:
        return _checked_values(actions, (size, width(options)))
    return checked_numbers(actions, size, len(ACTIONS))


def _checked_values(actions: Any, shape: tuple[int, int]) -> Float[np.ndarray, "batch value"]:
    chosen = np.asarray(actions)
    if chosen.shape != shape or chosen.dtype not in (np.float32, np.float64):
        raise UserError(
            f"actions must be float32 or float64 of the shape {shape}, got {chosen.dtype} of the "
            f"shape {chosen.shape}"
        )
    wrong = chosen[~(np.abs(chosen) <= 1.0)]
    if len(wrong):
        raise UserError(f"actions must lie between -1 and 1, got {wrong[0]}: clip them")
    return chosen


def commands(actions: Float[np.ndarray, "batch value"]) -> Commands:
    """Return the commands that continuous actions mean, computed in the actions' own precision.

    Args:
        actions: Acceleration, and steering if there is a second column, in [-1, 1].
    """
    acceleration = _mapped(actions[:, 0], ACCELERATION_RANGE)
    if actions.shape[1] == 1:
        return Commands(acceleration, np.zeros(len(actions)))
    return Commands(acceleration, _mapped(actions[:, 1], STEERING_RANGE))


def _mapped(
    values: Float[np.ndarray, " batch"], interval: tuple[float, float]
) -> Float[np.ndarray, " batch"]:
    # highway-env's order of operations; in float32 it rounds differently from float64.
    low, high = interval
    return low + (values - -1) * (high - low) / (1 - -1)


BackEnd = Literal["core", "highway_env"]
BACK_ENDS = ("core", "highway_env")


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
        for name, values in commands(actions[rows])._asdict().items():
            self._buffers.vehicles[name][ego] = values
        return np.zeros(len(actions), np.int64)


class Batch(RoadBatch):
    """Episodes of one scenario side by side; see `RoadBatch`.

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
        check_sizes(size, threads)
        one_of("back end", back_end, BACK_ENDS)
        super().__init__(options, buffers_of(options, size, traced))
        self.options: Options = options
        self._threads = threads
        self._engine = self._engine_of(back_end, threads)

    def _engine_of(self, back_end: BackEnd, threads: int) -> Engine:
        if back_end == "core":
            return Core(self.options, self.buffers, threads)
        from socialiq.worlds.intersection.reference import Reference

        return Reference(self.options, self.buffers)

    def _run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        self._engine.run(commands, seeds, seeded, actions)

    def like(self, size: int) -> Batch:
        """Return a batch of so many episodes of the same scenario, on the core."""
        return type(self)(self.options, size, self._threads)

    @property
    def lanes(self) -> np.ndarray:
        """Records of the crossing's lanes."""
        from socialiq.worlds.intersection.core.geometry import LANES

        return LANES

    @property
    def n_actions(self) -> int:
        """Number of discrete actions."""
        return len(ACTIONS)

    def _checked(self, actions: Any) -> np.ndarray:
        """Return actions: 0 slower, 1 idle, 2 faster; or, if the options say so, continuous ones.

        Those are of float32 or float64 in [-1, 1], (batch, values).
        """
        return checked(actions, self.size, self.options)

    def save(self) -> State:
        """Return a copy of the state of every episode.

        Raises:
            UserError: On the back end highway_env, whose state is held in Python objects.
        """
        self._check_core("saved")
        return super().save()

    def restore(self, state: State) -> None:
        """Restore a saved state; see `RoadBatch.restore`.

        Raises:
            UserError: If the shapes differ, or on the back end highway_env.
        """
        self._check_core("restored")
        super().restore(state)

    def _check_core(self, what: str) -> None:
        if not isinstance(self._engine, Core):
            raise UserError(f"the state of highway-env can't be {what}: use the core")
