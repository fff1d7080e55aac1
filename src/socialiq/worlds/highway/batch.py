"""Many episodes of a scene side by side, as NumPy arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int8

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.options import options_of
from socialiq.worlds.highway.scenes import scene_of
from socialiq.worlds.highway.state import ACTIONS, Buffers
from socialiq.worlds.intersection.batch import seeds_of
from socialiq.worlds.intersection.settings import SIGNALS, settings_of
from socialiq.worlds.intersection.state import DECIDE, DECIDE_AND_RESET, RESET, SKIP


class Decisions(NamedTuple):
    """Results of one decision in every episode.

    Attributes:
        observation: Of the state reached, before any reset, (batch, features).
        rewards: The reward pair, each (batch,).
        ending: Values of `types.Ending`, (batch,).
        signals: Every named signal, unweighted, each (batch,).
        speed: The ego's speed, m/s, (batch,).
    """

    observation: Float32[np.ndarray, "batch feature"]
    rewards: RewardPair
    ending: Int8[np.ndarray, " batch"]
    signals: Mapping[str, Float[np.ndarray, " batch"]]
    speed: Float[np.ndarray, " batch"]


class Batch:
    """Episodes of one scene side by side, each with its own random stream.

    Args:
        scene: Name of the scene.
        size: Number of episodes.
        threads: Number of threads.
        options: Values by name, of `options.NAMES`.

    Attributes:
        buffers: Arrays that the core reads and writes.
        begun: Rows whose random stream has begun, bool (batch,).

    Raises:
        UserError: If the scene or an option is unknown, or a number is not positive.
    """

    def __init__(self, scene: str, size: int, threads: int = 1, **options: Any) -> None:
        for name, value in (("size", size), ("threads", threads)):
            if value < 1:
                raise UserError(f"{name} must be at least 1, got {value}")
        self.scene, self.size, self._threads = scene_of(scene), size, threads
        self.options = options_of(scene, **options)
        self.buffers = Buffers.of(self.scene.road, self.options, size)
        self.begun, self._waiting = np.zeros(size, bool), np.ones(size, bool)
        self._settings = settings_of(self.options)

    @property
    def observation(self) -> Float32[np.ndarray, "batch feature"]:
        """Current observation of every episode, (batch, features)."""
        return self.buffers.observation.reshape(self.size, -1).copy()

    def reset(
        self, seeds: int | Sequence[int] | np.ndarray | None = None, rows: Any = None
    ) -> Float32[np.ndarray, "batch feature"]:
        """Start new episodes, and return the observation of all rows.

        Args:
            seeds: A seed for each row, or one number: row i gets seed + i. None continues the
                rows' streams.
            rows: Rows to reset, as an index or a mask; all by default.

        Raises:
            UserError: If a seed is negative, or a stream to continue was never seeded.
        """
        chosen = self._chosen(rows)
        if seeds is None and not self.begun[chosen].all():
            raise UserError("the first reset needs a seed")
        entropy = np.zeros(self.size, np.uint64)
        if seeds is not None:
            entropy[chosen] = seeds_of(seeds, int(chosen.sum()))
        seeded = chosen & (seeds is not None)
        self._run(np.where(chosen, RESET, SKIP), entropy, seeded, np.zeros(self.size, np.int64))
        self._waiting[chosen] = False
        self.begun[chosen] = True
        return self.observation

    def step(self, actions: Any, auto_reset: bool = True, rows: Any = None) -> Decisions:
        """Take one decision in every episode, or in some.

        Args:
            actions: An action for each episode, a number of `state.ACTIONS`.
            auto_reset: Start a new episode where one ended.
            rows: Episodes to advance, as an index or a mask; all by default.

        Raises:
            UserError: If an action is not one of these, or an episode has not begun or has ended.
        """
        chosen = np.asarray(actions)
        if chosen.shape != (self.size,) or chosen.dtype.kind not in "iu":
            raise UserError(f"actions must be {self.size} whole numbers, got {actions!r}")
        if chosen.min() < 0 or chosen.max() >= len(ACTIONS):
            raise UserError(f"actions must be 0 to 4, got {sorted({*chosen.tolist()})}")
        deciding = self._chosen(rows)
        if (self._waiting & deciding).any():
            raise UserError("an episode has not begun, or has ended: reset it first")
        commands = np.where(deciding, DECIDE_AND_RESET if auto_reset else DECIDE, SKIP)
        nothing = np.zeros(self.size, np.uint64)
        self._run(commands, nothing, nothing.astype(bool), chosen.astype(np.int64))
        if not auto_reset:
            self._waiting |= deciding & (self.buffers.ending != int(Ending.NONE))
        made = self.buffers
        return Decisions(
            observation=made.reached.reshape(self.size, -1).copy(),
            rewards=RewardPair(*made.rewards.T.copy()),
            ending=made.ending.copy(),
            signals=dict(zip(SIGNALS, made.signals.T.copy(), strict=True)),
            speed=made.speed.copy(),
        )

    def _run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        from socialiq.worlds.highway.core import step  # import Numba only when it is needed
        from socialiq.worlds.intersection.core.compile import run_in_parts

        given = commands.astype(np.int8), seeds, seeded, actions, self._settings, self.scene.road
        run_in_parts(step.run, self._threads, self.size, self.buffers, *given)

    def _chosen(self, rows: Any) -> np.ndarray:
        chosen = np.zeros(self.size, bool)
        chosen[slice(None) if rows is None else rows] = True
        return chosen
