"""Intersection as a world, and the limits of an episode's rewards there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from gymnasium import spaces

from socialiq.types import Policy
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.actions import space_of
from socialiq.worlds.intersection.batch import BackEnd, Batch
from socialiq.worlds.intersection.options import POPULATIONS, Options
from socialiq.worlds.intersection.state import ACTIONS

if TYPE_CHECKING:
    from socialiq.worlds.highway.pictures.render import View


@dataclass(frozen=True)
class Intersection(RoadWorld):
    """highway-env's unsignalised crossing with the thesis' reward pair (5.1.3).

    Attributes:
        options: Scenario and reward options.
        name: Name in the registry.
    """

    options: Options = field(  # pyright: ignore[reportIncompatibleVariableOverride]  it is frozen
        default_factory=Options
    )
    name: str = "intersection"

    drivers: ClassVar[tuple[str, ...]] = policies.NAMES
    references: ClassVar[tuple[str, ...]] = ("go", "wait", "idm")

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions, in the order of their numbers."""
        return ACTIONS

    @property
    def action_space(self) -> spaces.Discrete | spaces.Box:
        """Space of one action: `n_actions` numbers, or values in [-1, 1]."""
        return space_of(self.options)

    @property
    def view(self) -> View:
        """The crossing as pictures show it."""
        from socialiq.worlds.intersection.pictures.crossing import VIEW  # imports Numba

        return VIEW

    def batch(  # pyright: ignore[reportIncompatibleMethodOverride]  one argument more
        self, size: int, threads: int = 1, back_end: BackEnd = "core", traced: bool = False
    ) -> Batch:
        """Return episodes side by side; see `Batch`."""
        return Batch(self.options, size, threads, back_end, traced)

    def driver(self, name: str, seed: int = 0) -> Policy:
        """Return a rule-based driver of `policies.NAMES`.

        Raises:
            UserError: If the name is unknown.
        """
        return policies.policy(name, seed, self.options)

    def largest_difference(self, weights: tuple[float, float]) -> float | None:
        """Return the most by which two episodes can differ; None where nothing limits progress."""
        from socialiq.worlds.intersection import episode_range  # imports Numba

        if episode_range.is_unlimited(self.options):
            return None
        sides = episode_range.env_range(self.options), episode_range.social_range(self.options)
        return sum(abs(w) * side.width for w, side in zip(weights, sides, strict=True))

    def other_traffic(self) -> dict[str, dict[str, Any]]:
        """Return the other populations of drivers, and connected lanes switched the other way."""
        populations = [name for name in POPULATIONS if name != self.options.population]
        connected = not self.options.connected_lanes
        sight = "who see across connected lanes" if connected else "who see their own lane only"
        return {
            **{f"drivers of population {name}": {"population": name} for name in populations},
            f"drivers {sight}": {"connected_lanes": connected},
        }


def make(options: Options) -> Intersection:
    """Build the world."""
    return Intersection(options)
