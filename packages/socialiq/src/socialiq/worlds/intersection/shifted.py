"""Episodes of the intersection with faults: late actions, and observations as they are shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32

from socialiq.worlds.highway.world import State
from socialiq.worlds.intersection import shifts
from socialiq.worlds.intersection.options import IDLE
from socialiq.worlds.intersection.perception import FrontEnd
from socialiq.worlds.intersection.shifts import Shift
from socialiq.worlds.intersection.world import Batch
from socialiq.worlds.world import Decisions, rows_of


class ShiftedBatch(Batch):
    """Episodes that each draw one of several shifts; see `Batch`.

    Every observation, also one of `Decisions`, is what the ego is shown. With a `front_end` it is
    what this makes of that; where several shifts are drawn, it knows the noise of the episode, and
    whether it is late.
    """

    def __init__(
        self,
        *arguments: Any,
        choices: Sequence[Shift],
        front_end: FrontEnd | None,
        **options: Any,
    ) -> None:
        super().__init__(*arguments, **options)
        self._drawn, self._front_end = tuple(choices), front_end
        self._latency = max(shift.latency for shift in choices)
        width = (self.options.width,) if self.options.continuous else ()
        still = np.zeros(width, np.float32) if width else np.int64(IDLE)
        self._queue = np.full((self.size, self._latency, *width), still)
        self._key, self._late = np.zeros(self.size, np.uint64), np.zeros(self.size, np.int64)
        self._shown = self.buffers.observation.reshape(self.size, -1).copy()
        self._memory = np.zeros((self.size, 0), np.float32)
        if front_end is not None:
            self._memory = front_end.memory(self.size, self._shown.shape[1])

    @property
    def late(self) -> Bool[np.ndarray, " batch"]:
        """Whether the actions of each episode come late."""
        return self._late > 0

    @property
    def observation(self) -> Float32[np.ndarray, "batch feature"]:
        """Current observations, as they are shown."""
        return self._shown.copy()

    @property
    def time(self) -> Float32[np.ndarray, " batch"]:
        """Number of decisions since the last reset, as the front end shows it."""
        time = super().time
        if self._front_end is None:
            return time
        return self._front_end.clock(time[:, None], self._is_late())[:, 0]

    def reset(self, seeds: Any = None, rows: Any = None) -> Float32[np.ndarray, "batch feature"]:
        """Start new episodes as `RoadBatch.reset`; faults follow from the seed, or continue."""
        chosen = rows_of(rows, self.size)
        super().reset(seeds, rows)
        given = self._key[chosen]
        if seeds is not None:
            given = np.asarray(seeds, np.uint64)
            given = given + np.arange(chosen.sum(), dtype=np.uint64) if given.ndim == 0 else given
        self._key[chosen] = shifts.key_of(given)
        self._late[chosen] = shifts.values_of(self._drawn, "latency", self._key[chosen])
        self._queue[chosen] = 0.0 if self.options.continuous else IDLE
        self._memory[chosen] = 0.0
        self._show(chosen)
        return self.observation

    def step(self, actions: Any, auto_reset: bool = True, rows: Any = None) -> Decisions:
        """Take one decision as `RoadBatch.step`, in which late episodes carry out earlier ones."""
        deciding, every = rows_of(rows, self.size), np.arange(self.size)
        chosen = self._checked(actions)
        queue = np.concatenate([self._queue, chosen[:, None].astype(self._queue.dtype)], axis=1)
        self._queue[deciding] = queue[deciding, 1:]
        self._deciding, self._decided = deciding, chosen
        applied = queue[every, self._latency - self._late]
        return super().step(applied.astype(chosen.dtype), auto_reset, rows)

    @property
    def _resets_in_core(self) -> bool:
        return False

    def _decisions(self) -> Decisions:
        decisions = super()._decisions()
        self._show(self._deciding, self._decided)
        return decisions._replace(observation=self._shown.copy())

    def _show(self, rows: np.ndarray, decided: np.ndarray | None = None) -> None:
        """Show some episodes' states, after the actions that were decided."""
        true = self.buffers.observation.reshape(self.size, -1)[rows]
        key, time = self._key[rows], super().time[rows]
        self._shown[rows] = shifts.with_faults(self._drawn, true, key, time)
        if (front := self._front_end) is not None:
            features, memory = true.shape[1], self._memory[rows]
            if decided is not None:
                memory = front.decided(memory, decided[rows, None].astype(np.float32), features)
            known = self._is_late(rows), None
            if len(self._drawn) > 1:
                noise = shifts.values_of(self._drawn, "noise", key)
                known = known[0], noise[:, None].astype(np.float32)
            estimate, self._memory[rows] = front.see(self._shown[rows], memory, features, *known)
            self._shown[rows] = estimate

    def _is_late(self, rows: Any = slice(None)) -> Float32[np.ndarray, "row 1"] | None:
        """Whether each episode has latency, where that is drawn."""
        late = (self._late[rows, None] > 0).astype(np.float32)
        return late if len(self._drawn) > 1 else None

    def like(self, size: int) -> ShiftedBatch:
        """Return a batch of so many episodes of the same scenario, on the core."""
        options: dict[str, Any] = {"effects": self.effects, "by_class": self._by_class}
        options |= {"choices": self._drawn, "front_end": self._front_end}
        return type(self)(self.options, size, self._threads, **options)

    @property
    def _columns(self) -> State:
        faults = self._key, self._late, self._queue, self._shown, self._memory
        return super()._columns._replace(beside=faults)
