"""Many episodes of a scene side by side, as NumPy arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.worlds.highway.episodes import RoadBatch, check_sizes, checked_numbers
from socialiq.worlds.highway.options import RoadOptions
from socialiq.worlds.highway.scene import ACTIONS, CAR, Scene
from socialiq.worlds.highway.settings import settings_of
from socialiq.worlds.highway.state import Buffers


class Batch(RoadBatch):
    """Episodes of one scene side by side; see `RoadBatch`.

    Args:
        scene: The scene.
        options: Its options.
        size: Number of episodes.
        threads: Number of threads.
        traced: Record the vehicles of every sub-step in `buffers.trace`, for films.

    Attributes:
        scene: The scene.

    Raises:
        UserError: If a number is not positive.
    """

    def __init__(
        self,
        scene: Scene,
        options: RoadOptions,
        size: int,
        threads: int = 1,
        traced: bool = False,
    ) -> None:
        check_sizes(size, threads)
        most = len(scene.road.entries) + len(scene.road.obstacles)
        super().__init__(options, Buffers.of(options, CAR, most, size, traced))
        self.scene, self._threads = scene, threads
        self._settings = settings_of(options)

    def _run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        from socialiq.worlds.highway.core import step  # import Numba only when it is needed
        from socialiq.worlds.highway.core.compile import run_in_parts

        arguments = commands, seeds, seeded, actions, self._settings, self.scene.road
        run_in_parts(step.run, self._threads, self.size, self.buffers, *arguments)

    def like(self, size: int) -> Batch:
        """Return a batch of so many episodes of the same scene."""
        return type(self)(self.scene, self.options, size, self._threads)

    @property
    def lanes(self) -> np.ndarray:
        """Records of the scene's lanes."""
        return self.scene.road.lanes

    @property
    def n_actions(self) -> int:
        """Number of discrete actions."""
        return len(ACTIONS)

    def _checked(self, actions: Any) -> np.ndarray:
        """Return actions, numbers of `scene.ACTIONS`, as int64."""
        return checked_numbers(actions, self.size, len(ACTIONS))
