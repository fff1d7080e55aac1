"""Configuration of the study of dials' zeros."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.errors import UserError

PLAIN = "another recipe"
"""Name of `DIAL` beside the trained dials, which have a clock, another network and other rates."""

CALIBRATED = "longer training"
"""Name of `OTHER_DIAL` beside them: of their recipe, with 40,000 updates and settings."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    dials: tuple[int, ...] = (70, 71, 72, 73, 74)
    """Training seeds of the dials that are a family, each left out in turn to drive. 101 to 103
    were used in development."""
    updates: int = 12_000
    """Gradient steps of each of these dials."""
    first_episode: int = 63_000_000
    """Seed of the first episode. 50,900,000 to 51,199,999 were used in development."""
    scale_episodes: int = 300
    """Episodes at each angle of which a dial's common scale is measured."""
    zero_episodes: int = 25
    """Episodes of each angle that are projected on other dials."""
    drivers: int = 20
    """Drivers of a population."""
    episodes: int = 16
    """Episodes of a driver, half to infer and half to test."""
    mean: float = 45.0
    """Mean of the planted angles, degrees."""
    spreads: tuple[float, ...] = (0.0, 25.0)
    """Standard deviations of the planted angles; angles are cut off at 0 and 90 degrees."""

    def __post_init__(self) -> None:
        """Check what no population can be made of."""
        if len({*self.dials}) < 3 or len({*self.dials}) < len(self.dials):
            raise UserError("dials must be three different training seeds or more")
        if self.episodes < 2 or self.episodes % 2 or self.drivers < 2:
            raise UserError("episodes must be an even number from 2, and drivers at least 2")
        if min(self.updates, self.scale_episodes, self.zero_episodes) < 1:
            raise UserError("updates, scale_episodes and zero_episodes must be at least 1")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all dials, the trained ones first."""
        return (*(str(seed) for seed in self.dials), PLAIN, CALIBRATED)

    def family_of(self, driver: str) -> tuple[str, ...]:
        """Return the names of the dials that are the model of a driver of some dial."""
        return tuple(str(seed) for seed in self.dials if str(seed) != driver)
