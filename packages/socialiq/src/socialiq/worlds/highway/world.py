"""Roads as worlds: what the intersection and the scenes share; the scenes and their batches."""

from __future__ import annotations

import abc
import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from gymnasium import spaces

from socialiq.errors import one_of
from socialiq.worlds.highway.episodes import RoadBatch
from socialiq.worlds.highway.options import RoadOptions, reward_definition, settings_of
from socialiq.worlds.highway.scenes import ACTIONS, CAR, Scene, scene_of
from socialiq.worlds.highway.state import FEATURES, Buffers
from socialiq.worlds.world import World

if TYPE_CHECKING:
    from socialiq.worlds.highway.render import View

_CLOCK = {"simulation_frequency": 15, "observed_vehicles": 5}  # highway-env's on these roads


class RoadWorld(World):
    """Compiled road with the thesis' reward pair."""

    options: RoadOptions
    draws_by_seed: ClassVar[bool] = True

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.options.observed_vehicles * len(FEATURES)

    @property
    def description(self) -> str:
        """Name of the world and its options."""
        return f"{self.name} {self.options}"

    @property
    def reward(self) -> dict[str, Any]:
        """Definition of the reward pair: weights of the signals, and the options that matter."""
        return reward_definition(self.options)

    @property
    @abc.abstractmethod
    def view(self) -> View:
        """The road as pictures show it."""

    @abc.abstractmethod
    def batch(self, size: int, threads: int = 1, traced: bool = False) -> RoadBatch:
        """Return episodes side by side, with every sub-step in `buffers.trace` if `traced`."""


class Batch(RoadBatch):
    """Episodes of one scene side by side; see `RoadBatch`.

    With `traced`, `buffers.trace` has the vehicles of every sub-step, for films.
    """

    n_actions = len(ACTIONS)

    def __init__(
        self, scene: Scene, options: RoadOptions, size: int, threads: int = 1, traced: bool = False
    ) -> None:
        self.scene = scene
        most = len(scene.road.entries) + len(scene.road.obstacles)
        buffers = Buffers.of(options, CAR, most, size, traced)
        super().__init__(options, buffers, settings_of(options), threads)

    def _core(self) -> tuple[Any, Any]:
        from socialiq.worlds.highway.core import step  # import Numba only when it is needed

        return step.run, self.scene.road

    def like(self, size: int) -> Batch:
        """Return a batch of so many episodes of the same scene."""
        return type(self)(self.scene, self.options, size, self._threads)

    @property
    def lanes(self) -> np.ndarray:
        """Records of the scene's lanes."""
        return self.scene.road.lanes


@dataclass(frozen=True)
class SceneWorld(RoadWorld):
    """Scene of highway-env."""

    scene: Scene
    options: RoadOptions

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Name of the scene."""
        return self.scene.name

    @property
    def action_space(self) -> spaces.Discrete:
        """Space of one action."""
        return spaces.Discrete(len(ACTIONS))

    @property
    def view(self) -> View:
        """The road as pictures show it."""
        from socialiq.worlds.highway.views import Lanes  # imports Numba

        return Lanes(self.scene)

    def batch(self, size: int, threads: int = 1, traced: bool = False) -> Batch:
        """Return episodes side by side; see `Batch`."""
        return Batch(self.scene, self.options, size, threads, traced)


def world_of(scene: Scene | str, **options: Any) -> SceneWorld:
    """Return a scene, or one of `SCENES` by name, as a world; other options are the scene's own.

    Raises:
        UserError: If the scene, an option or a value is unknown.
    """
    chosen = scene_of(scene) if isinstance(scene, str) else scene
    names = tuple(field.name for field in dataclasses.fields(RoadOptions))
    for option in options:
        one_of(f"option of {chosen.name}", option, names)
    return SceneWorld(chosen, RoadOptions(**{**_CLOCK, **chosen.defaults, **options}))
