"""Episodes with faults on any road: late actions, and observations as they are shown."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32

from socialiq.worlds.highway import shifts
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.highway.shifts import Shift
from socialiq.worlds.world import Decisions, rows_of

_AGENT = np.uint64(48)  # bits of a seed below the number of the agent, in the key of its faults


class Faults(NamedTuple):
    """Faults and front end of the episodes of a batch."""

    choices: tuple[Shift, ...]  # of which each episode draws one
    front_end: FrontEnd | None
    ego: EgoModel


class ShiftedBatch(RoadBatch):
    """Episodes whose agents each draw one of several shifts; a mixin over a road's batch (`over`).

    Every observation, also one of `Decisions`, is what an agent is shown. With a front end it is
    what this makes of that; where several shifts are drawn, it knows the noise of the agent, and
    whether it is late. Arrays have a row for each agent, agents of one episode in turn.
    """

    def __init__(self, *arguments: Any, faults: Faults, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._faults = faults
        self._drawn = faults.choices
        self._front_end = faults.front_end
        self._latency = max(shift.latency for shift in self._drawn)
        width = (self.options.width,) if self.options.continuous else ()
        self._still = 0 if width else faults.ego.idle
        still = np.array(self._still, np.float32 if width else np.int64)
        count = len(self.buffers.ending)
        self._queue = np.full((count, self._latency, *width), still)
        self._key = np.zeros(count, np.uint64)
        self._late = np.zeros(count, np.int64)
        self._shown = self.buffers.observation.reshape(count, -1).copy()
        self._memory = np.zeros((count, 0), np.float32)
        if self._front_end is not None:
            self._memory = self._front_end.memory(count, self._shown.shape[1])

    @property
    def late(self) -> Bool[np.ndarray, "*batch"]:
        """Whether the actions of each agent come late."""
        return (self._late > 0).reshape(self.shape)

    @property
    def shown_rows(self) -> Float32[np.ndarray, "result value"]:
        """Rows of road users that every agent is shown, with faults."""
        return self._shown

    @property
    def time(self) -> Float32[np.ndarray, " batch"]:
        """Number of decisions since the last reset, as the front end shows it to first agents."""
        return self.clocks[:: self.options.agents]

    @property
    def clocks(self) -> Float32[np.ndarray, " result"]:
        """The clock's feature of every agent, as the front end shows it."""
        time = self._by_result(super().time)
        if self._front_end is None:
            return time
        return self._front_end.clock(time[:, None], self._is_late())[:, 0]

    def _by_result(self, values: np.ndarray) -> np.ndarray:
        """Return a value of each episode for each of its agents."""
        return np.repeat(values, self.options.agents)

    def reset(self, seeds: Any = None, rows: Any = None) -> Float32[np.ndarray, "*batch feature"]:
        """Start new episodes in some rows, with faults.

        Args:
            seeds: As for `RoadBatch.reset`. Faults follow from the seed; without seeds, from the
                key of the episode before.
            rows: Rows, by numbers or as a mask; None: all.

        Returns:
            The observations of all rows, as they are shown.
        """
        begun = rows_of(rows, self.size)
        super().reset(seeds, rows)
        chosen = self._by_result(begun)
        keys = self._key[chosen]
        if seeds is not None:
            keys = np.asarray(seeds, np.uint64)
            keys = keys + np.arange(begun.sum(), dtype=np.uint64) if keys.ndim == 0 else keys
            agents = np.arange(self.options.agents, dtype=np.uint64)
            keys = (keys[:, None] ^ (agents << _AGENT)).ravel()
        self._key[chosen] = shifts.key_of(keys)
        self._late[chosen] = shifts.values_of(self._drawn, "latency", self._key[chosen])
        self._queue[chosen] = self._still
        if self._front_end is not None:
            width = self._shown.shape[1]
            targets = None if self._faults.ego.accelerates else self._targets()[chosen]
            self._memory[chosen] = self._front_end.memory(len(keys), width, targets)
        self._show(chosen)
        return self.observation

    def _targets(self) -> Float[np.ndarray, " result"]:
        """Return the target speed of every agent, m/s: agents may enter at unlike speeds."""
        agents = self.buffers.episodes["controlled"][:, : self.options.agents]
        rows = np.arange(self.size)[:, None]
        return self.buffers.vehicles["target_speed"][rows, agents].ravel()

    def step(self, actions: Any, auto_reset: bool = True, rows: Any = None) -> Decisions:
        """Take one decision in some rows; agents with latency carry out an earlier action.

        Args:
            actions: Actions that are decided now, of all rows, as for `RoadBatch.step`.
            auto_reset: Whether a new episode starts where one ended.
            rows: Rows that take a decision, by numbers or as a mask; None: all.

        Returns:
            Results as in `RoadBatch.step`, with observations as they are shown.
        """
        deciding = self._by_result(rows_of(rows, self.size))
        chosen = self._checked(actions)
        queue = np.concatenate([self._queue, chosen[:, None].astype(self._queue.dtype)], axis=1)
        self._queue[deciding] = queue[deciding, 1:]
        self._deciding = deciding
        self._decided = chosen
        applied = queue[np.arange(len(queue)), self._latency - self._late].astype(chosen.dtype)
        return super().step(applied.reshape(np.shape(actions)), auto_reset, rows)

    @property
    def _resets_in_core(self) -> bool:
        return False

    def _decisions(self) -> Decisions:
        self._show(self._deciding, self._decided)
        decisions = super()._decisions()
        return decisions._replace(observation=self.observation)

    def _show(self, rows: np.ndarray, decided: np.ndarray | None = None) -> None:
        """Show some agents' states, after the actions that were decided."""
        if not rows.any():
            return
        self._outdated |= rows
        true = self.buffers.observation.reshape(len(rows), -1)[rows]
        key = self._key[rows]
        time = self._by_result(super().time)[rows]
        self._shown[rows] = shifts.with_faults(self._drawn, true, key, time, self._faults.ego)
        if (front := self._front_end) is not None:
            features = true.shape[1]
            memory = self._memory[rows]
            if decided is not None:
                actions = decided[rows].reshape(len(memory), -1).astype(np.float32)
                memory = front.decided(memory, actions, features)
            known = self._is_late(rows), None
            if len(self._drawn) > 1:
                noise = shifts.values_of(self._drawn, "noise", key)
                known = known[0], noise[:, None].astype(np.float32)
            estimate, self._memory[rows] = front.see(self._shown[rows], memory, features, *known)
            estimate[true[:, 0] == 0.0] = 0.0  # agents that have left
            self._shown[rows] = estimate

    def _is_late(self, rows: Any = slice(None)) -> Float32[np.ndarray, "row 1"] | None:
        """Whether each agent has latency, where that is drawn."""
        late = (self._late[rows, None] > 0).astype(np.float32)
        return late if len(self._drawn) > 1 else None

    @property
    def _arguments(self) -> dict[str, Any]:
        return {**super()._arguments, "faults": self._faults}

    @property
    def _columns(self) -> Any:
        faults = self._key, self._late, self._queue, self._shown, self._memory
        return super()._columns.with_more(
            tuple(column.reshape(*self.shape, *column.shape[1:]) for column in faults)
        )


@cache
def over(kind: type[RoadBatch]) -> type[Any]:
    """Return the class of a road's batch with faults and a front end."""
    return type(f"Shifted{kind.__name__}", (ShiftedBatch, kind), {})
