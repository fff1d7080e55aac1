"""Intersection as a world of the registry."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.worlds.highway.settings import SIGNALS
from socialiq.worlds.highway.state import FEATURES
from socialiq.worlds.intersection.actions import space_of
from socialiq.worlds.intersection.batch import BackEnd, Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import ACTIONS

if TYPE_CHECKING:
    from socialiq.worlds.highway.pictures.render import View


@dataclass(frozen=True)
class Intersection:
    """highway-env's unsignalised crossing with the thesis' reward pair (5.1.3).

    Attributes:
        options: Scenario and reward options.
        name: Name in the registry.
    """

    options: Options = field(default_factory=Options)
    name: str = "intersection"

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions, in the order of their numbers."""
        return ACTIONS

    @property
    def n_actions(self) -> int:
        """Number of actions.

        Raises:
            UserError: If they are continuous.
        """
        if self.options.continuous:
            raise UserError(
                "the actions of this intersection are continuous: choose discrete ones, or a "
                "method for continuous actions"
            )
        return len(ACTIONS)

    @property
    def action_space(self) -> spaces.Discrete | spaces.Box:
        """Space of one action: `n_actions` numbers, or values in [-1, 1]."""
        return space_of(self.options)

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.options.observed_vehicles * len(FEATURES)

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of all signals, those of r_env first."""
        return SIGNALS

    @property
    def description(self) -> str:
        """Name of the world and its options."""
        return f"{self.name} {self.options}"

    @property
    def view(self) -> View:
        """The crossing as pictures show it."""
        from socialiq.worlds.intersection.pictures.crossing import VIEW  # imports Numba

        return VIEW

    def batch(
        self, size: int, threads: int = 1, back_end: BackEnd = "core", traced: bool = False
    ) -> Batch:
        """Return episodes side by side; see `Batch`."""
        return Batch(self.options, size, threads, back_end, traced)


def make(options: Options) -> Intersection:
    """Build the world."""
    return Intersection(options)
