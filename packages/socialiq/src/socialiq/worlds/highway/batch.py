"""Episodes of a road side by side, as NumPy arrays."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int64, Integer

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.along_route import AlongRoute
from socialiq.worlds.highway.effects import (
    ACCOUNT,
    BEGIN,
    PREPARE,
    EffectOptions,
    Ledger,
    record_of,
)
from socialiq.worlds.highway.effects import SIGNALS as EFFECT_SIGNALS
from socialiq.worlds.highway.options import (
    DECIDE,
    DECIDE_AND_RESET,
    FEATURES,
    RESET,
    SIGNALS,
    SKIP,
    AgentOptions,
    Buffers,
    RoadOptions,
    is_over,
)
from socialiq.worlds.highway.scenes import Road
from socialiq.worlds.world import Decisions, observed_with_time, rows_of


class State(NamedTuple):
    """Complete state of some episodes, as plain arrays."""

    episodes: np.ndarray  # EPISODE records, (rows,)
    vehicles: np.ndarray  # records of vehicles, (rows, capacity)
    people: np.ndarray  # records of people, (rows, person)
    observation: np.ndarray  # (rows, vehicles seen by all agents, 7)
    waiting: np.ndarray  # whether the episodes have ended and need a reset, (rows,)
    ledger: Ledger | None = None  # of what the ego causes, if that is measured
    beside: tuple[np.ndarray, ...] = ()  # columns of faults and of a front end

    def arrays(self) -> list[np.ndarray]:
        """Return all columns."""
        return [*self[:5], *(self.ledger or ()), *self.beside]

    def of(self, arrays: Sequence[np.ndarray]) -> State:
        """Return a state of the same layout with other columns.

        Args:
            arrays: Columns in the order of `arrays`.
        """
        last = 5 + len(self.ledger or ())
        ledger = Ledger(*arrays[5:last]) if self.ledger is not None else None
        return State(*arrays[:5], ledger=ledger, beside=tuple(arrays[last:]))

    def with_more(self, columns: tuple[np.ndarray, ...]) -> State:
        """Return the state with further columns of a wrapper."""
        return self._replace(beside=columns)

    def rows(self, chosen: Sequence[int] | np.ndarray) -> State:
        """Return the state of the chosen episodes; indices may repeat."""
        return self.of([column[np.asarray(chosen)] for column in self.arrays()])


class RoadBatch(abc.ABC):
    """Episodes of one road side by side (`worlds.world.Batch`).

    With `AgentOptions` each has several controlled vehicles: actions, observations and results have
    an axis for the agents after that for the episodes.

    Every episode has its own random stream, so results don't depend on the batch's size or the
    number of threads. By default `step` resets an episode that ends. The new episode continues the
    stream, as in highway-env after a `reset()` without seed. The buffers are the arrays that the
    road's core reads and writes. A single thread is best for small batches.
    """

    n_actions: int  # of the road, discrete
    faster: int  # action that selects the next higher speed
    idle: int  # action that changes nothing

    def __init__(
        self,
        options: RoadOptions,
        buffers: Buffers,
        settings: np.ndarray,
        threads: int,
        effects: EffectOptions | None = None,
    ) -> None:
        if threads < 1:
            raise UserError(f"threads must be at least 1, got {threads}")
        self.options = options
        self.buffers = buffers
        self.effects = effects
        self._settings = settings
        self._threads = threads
        self.size = size = len(buffers.episodes)
        # of observations, actions and results: with an axis for agents if there may be several
        several = isinstance(options, AgentOptions)
        self.shape: tuple[int, ...] = (size, options.agents) if several else (size,)
        self.ledger: Ledger | None = None
        if effects is not None:
            self._effects = record_of(effects, options)
            self.ledger = Ledger.of(self._effects, buffers.vehicles.shape[1], size)
        # schema along the route, of a road whose options ask for it
        self._along: AlongRoute | None = None
        self._observed = np.zeros((len(buffers.ending), 0), np.float32)  # in that schema
        self._outdated = np.ones(len(buffers.ending), bool)  # results whose state has changed since
        self._waiting = np.ones(size, bool)  # for a reset
        self.begun = np.zeros(size, bool)  # rows whose random stream has begun

    @abc.abstractmethod
    def _core(self) -> tuple[Any, Any, np.ndarray]:
        """Return the module of the road's core, its tables for that, and its lanes."""

    @property
    def lanes(self) -> np.ndarray:
        """Records of the road's lanes, by the number that a vehicle has."""
        return self._core()[2]

    @property
    def road(self) -> Road:
        """Tables of the road."""
        return self._core()[1]

    @property
    @abc.abstractmethod
    def _arguments(self) -> dict[str, Any]:
        """Arguments that make another batch of the same road, without its size."""

    def like(self, size: int) -> RoadBatch:
        """Return a batch of so many episodes of the same road, on the core and not traced."""
        kind: type[Any] = type(self)
        return kind(**self._arguments, size=size)

    def branch(self, rows: Sequence[int] | np.ndarray) -> RoadBatch:
        """Return a batch of copies of some episodes, which may repeat; this one is not changed.

        Copies have the same hidden state and random numbers: the same drivers and later traffic.
        """
        copies = self.like(len(rows))
        copies.restore(self.save().rows(rows))
        return copies

    def _run(self, command: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        """Carry out one command for each episode, as `core.step.run`."""
        from socialiq.worlds.highway.core.compile import run_in_parts  # imports Numba

        core, road, _ = self._core()
        arguments = command, seeds, seeded, actions, self._settings, road
        run_in_parts(core.run, self._threads, self.size, self.buffers, *arguments)

    def measure(self, command: int, rows: np.ndarray) -> None:
        """Carry out a command of `highway.effects` in some rows, if effects are measured.

        Args:
            command: One of BEGIN, PREPARE, ACCOUNT, NEXT_ABSENT and ABSENT, or REPEAT plus an
                action.
            rows: Whether to carry it out in each row, bool (batch,).
        """
        if self.ledger is None:
            return
        from socialiq.worlds.highway.core.compile import run_in_parts  # imports Numba

        core, road, _ = self._core()
        arguments = self.ledger, rows, self._settings, road, self._effects
        run_in_parts(core.effects, self._threads, self.size, command, self.buffers, *arguments)

    @property
    def late(self) -> Bool[np.ndarray, "*batch"]:
        """Whether the actions of each agent come late."""
        return np.zeros(self.shape, bool)

    @property
    def egos(self) -> Integer[np.ndarray, " batch"]:
        """Identity of each ego."""
        buffers = self.buffers
        return buffers.vehicles["identity"][
            np.arange(self.size), buffers.episodes["controlled"][:, 0]
        ]

    @property
    def credited(self) -> Bool[np.ndarray, "batch slot"]:
        """Whether each vehicle is near the ego after the last decision, as Eq 4.2 counts them."""
        after = self.buffers.after
        ego = after[np.arange(self.size), self.buffers.present[:, 1]]
        apart = np.hypot(after["x"] - ego["x"][:, None], after["y"] - ego["y"][:, None])
        return apart <= self.options.conflict_distance

    def _checked(self, actions: Any) -> np.ndarray:
        """Return a whole number for each agent, int64, in one row; refuse other actions."""
        chosen = np.asarray(actions)
        if chosen.shape != self.shape or chosen.dtype.kind not in "iu":
            count = " x ".join(map(str, self.shape))
            raise UserError(f"actions must be {count} whole numbers, got {actions!r}")
        if chosen.min() < 0 or chosen.max() >= self.n_actions:
            numbers = sorted({*chosen.ravel().tolist()})
            raise UserError(f"actions must be 0 to {self.n_actions - 1}, got {numbers}")
        return chosen.astype(np.int64).reshape(-1)

    @property
    def _resets_in_core(self) -> bool:
        """Whether nothing is to be read between the end of an episode and the next one."""
        return self.ledger is None and self._along is None

    @property
    def running(self) -> Bool[np.ndarray, " batch"]:
        """Whether each episode has begun and not ended."""
        return ~self._waiting

    @property
    def shown_rows(self) -> Float32[np.ndarray, "result value"]:
        """Rows of road users that every agent is shown, one after another."""
        return self.buffers.observation.reshape(len(self.buffers.ending), -1)

    @property
    def observation(self) -> Float32[np.ndarray, "*batch feature"]:
        """Current observation of every agent, zeros after it has left."""
        if self._along is None:
            return self.shown_rows.reshape(*self.shape, -1).copy()
        outdated = np.flatnonzero(self._outdated)
        if len(outdated):
            observed = self._along(self.shown_rows[outdated], self._agents(outdated))
            if not self._observed.size:
                self._observed = np.zeros((len(self._outdated), observed.shape[1]), np.float32)
            self._observed[outdated] = observed
            self._outdated[:] = False
        return self._observed.reshape(*self.shape, -1).copy()

    def _outdate(self, episodes: Bool[np.ndarray, " batch"]) -> None:
        """Note that the state of some episodes has changed since they were observed."""
        self._outdated |= np.repeat(episodes, self.options.agents)

    @abc.abstractmethod
    def _agents(self, results: Int64[np.ndarray, " chosen"]) -> np.ndarray:
        """Return what some agents know of themselves, AGENT records (chosen,).

        Args:
            results: Number of each agent, those of one episode in turn.
        """

    @property
    def driving(self) -> Bool[np.ndarray, "*batch"]:
        """Whether each agent has neither arrived nor crashed nor run out of time."""
        ended = self.buffers.episodes["ended"][:, : self.options.agents]
        return (ended == int(Ending.NONE)).reshape(self.shape)

    @property
    def time(self) -> Float32[np.ndarray, " batch"]:
        """Number of decisions since the last reset of every episode, the clock's feature."""
        seconds = self.buffers.episodes["time"] * self.options.policy_frequency
        return np.rint(seconds).astype(np.float32)

    @property
    def clocks(self) -> Float32[np.ndarray, " result"]:
        """The clock's feature of every agent, agents of one episode in turn."""
        return np.repeat(self.time, self.options.agents)

    @property
    def equivalent_actions(self) -> Int64[np.ndarray, "*batch action"]:
        """For each action the first one that does the same in the present state."""
        return np.broadcast_to(np.arange(self.n_actions), (*self.shape, self.n_actions)).copy()

    @property
    def action_mask(self) -> Bool[np.ndarray, "*batch action"]:
        """Whether each action is `idle` or does something else, in the present state."""
        same = self.equivalent_actions
        return (same != same[..., self.idle, None]) | (np.arange(self.n_actions) == self.idle)

    def seen_by(self, policy: Any) -> Float32[np.ndarray, "*batch feature"]:
        """Return what a policy observes: with the time at the end if it has one feature more."""
        reads_rows = getattr(policy, "reads_rows", False)
        flat = (
            self.shown_rows
            if reads_rows
            else self.observation.reshape(len(self.buffers.ending), -1)
        )
        for rows in self.options.narrow_rows:
            known = rows * len(FEATURES)
            if getattr(policy, "n_features", None) in (known, known + 1):
                flat = flat[:, :known]  # it does not observe other classes
        return observed_with_time(flat, self.clocks, policy).reshape(*self.shape, -1)

    def reset(
        self, seeds: int | Sequence[int] | np.ndarray | None = None, rows: Any = None
    ) -> Float32[np.ndarray, "*batch feature"]:
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
        unused = np.zeros(len(self.buffers.ending), np.int64)
        self._run(commands, entropy, chosen & (seeds is not None), unused)
        self.measure(BEGIN, chosen)
        self._outdate(chosen)
        self._waiting[chosen] = False
        self.begun[chosen] = True
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
        chosen = self._checked(actions)
        deciding = rows_of(rows, self.size)
        if (self._waiting & deciding).any():
            raise UserError("an episode has not begun, or has ended: reset it first")
        resets = auto_reset and self._resets_in_core
        command = DECIDE_AND_RESET if resets else DECIDE
        commands = np.where(deciding, command, SKIP).astype(np.int8)
        self.measure(PREPARE, deciding)
        self._run(commands, np.zeros(self.size, np.uint64), np.zeros(self.size, bool), chosen)
        self.measure(ACCOUNT, deciding)
        self._outdate(deciding)
        joint = not self._settings["each"][0]
        ended = deciding & is_over(self.buffers.ending.reshape(self.size, -1), joint)
        decisions = self._decisions()
        if not auto_reset:
            self._waiting |= ended
        elif not resets and ended.any():  # after what followed the ego's end
            self.reset(rows=ended)
        return decisions

    def _decisions(self) -> Decisions:
        buffers = self.buffers
        reached = buffers.reached.reshape(*self.shape, -1).copy()
        return Decisions(
            observation=reached if self._along is None else self.observation,
            rewards=RewardPair(*self._by_agent(buffers.rewards)),
            ending=buffers.ending.reshape(self.shape).copy(),
            signals=self._signals(),
            speed=buffers.speed.reshape(self.shape).copy(),
            contact=buffers.contact.reshape(self.shape).copy(),
            neighbours_collided=buffers.neighbours_collided.reshape(self.shape).copy(),
        )

    def _by_agent(self, columns: np.ndarray) -> np.ndarray:
        """Return columns of results as rows of arrays of the batch's shape."""
        return columns.T.reshape(-1, *self.shape).copy()

    def _signals(self) -> dict[str, np.ndarray]:
        names = [*SIGNALS]
        columns = [*self._by_agent(self.buffers.signals)]
        if self.ledger is not None:
            names = [*names, *EFFECT_SIGNALS]
            columns = [*columns, *self.ledger.signals.T.copy()]
        return dict(zip(names, columns, strict=True))

    @property
    def _columns(self) -> Any:
        buffers = self.buffers
        rows = buffers.observation.reshape(self.size, -1, len(FEATURES))  # of all agents, no copy
        records = buffers.episodes, buffers.vehicles, buffers.people
        return State(*records, rows, self._waiting, self.ledger)

    def save(self) -> Any:
        """Return a copy of the state of every episode."""
        columns = self._columns
        return columns.of([column.copy() for column in columns.arrays()])

    def restore(self, state: Any) -> None:
        """Restore a state of this size and these options; episodes go on with identical bits."""
        columns = self._columns.arrays()
        values = state.arrays()
        if len(columns) != len(values):
            raise UserError("only one of state and batch measures effects: use one world for both")
        for column, saved in zip(columns, values, strict=True):
            if column.shape != saved.shape or column.dtype != saved.dtype:
                raise UserError(
                    f"the saved state has the shape {saved.shape}, this batch {column.shape}: "
                    "restore it under the options and the size it was saved with"
                )
        for column, saved in zip(columns, values, strict=True):
            column[:] = saved
        self._outdated[:] = True
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
