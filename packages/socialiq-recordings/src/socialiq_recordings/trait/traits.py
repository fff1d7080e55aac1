"""Traits of one number by driver: the weights that they give to the rewards of a choice.

A driver takes the candidate a of a decision s with probability

    p(a | s) proportional to p_base(a | s) exp(w_env r_env(s, a) + w_social r_social(s, a)).

A trait is a curve in the plane of the weights. Every driver is somewhere on it, all drivers share
one more number, and the drivers' places follow a population of some mean and spread. So all traits
have the same freedom, and without spread they are the same model.

A grid must be finer than what the data determine: where it is coarser, a population of some spread
can come closer to drivers who are all alike than any point of the grid, and differences between
drivers are found that aren't there. `Trait.narrowed` lays the same number of points over the part
of a grid that the data leave.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

STRENGTHS = (0.0, *(0.1 * 2.0 ** (third / 3) for third in range(19)))
"""β from 0 to 6.4, per typical difference of reward (`choice_model.reward_scale`)."""

PROGRESS_SPREADS = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Spreads of g, per typical difference of reward."""

_TURNS = 3  # of the circle beyond which a wrapped normal of 90 degrees has nothing left


class Rule(NamedTuple):
    """Functions from which a trait follows on any grid.

    Attributes:
        weights: Of r_env and r_social, for shared numbers (a column) and values (a row).
        shares: Of drivers with each value, for values, mean and spread.
    """

    weights: Callable[[Any, Any], Any]
    shares: Callable[[Any, float, float], Any]


class Trait(NamedTuple):
    """Grid of a trait: what is integrated out.

    Attributes:
        name: Name in tables.
        shared: What all drivers have in common, by grid point.
        value: What a driver has of its own, ascending.
        weights: Of r_env and r_social at each of them.
        mean: Mean of the population, by grid point of the population.
        spread: Spread of the population; 0 if all drivers are alike.
        population: Share of the drivers with each value, given mean and spread.
        rule: How weights and shares follow from the grids; None if the grids are fixed.
    """

    name: str
    shared: Float[np.ndarray, " shared"]
    value: Float[np.ndarray, " value"]
    weights: Float[np.ndarray, "shared value 2"]
    mean: Float[np.ndarray, " hyper"]
    spread: Float[np.ndarray, " hyper"]
    population: Float[np.ndarray, "hyper value"]
    rule: Rule | None = None

    @staticmethod
    def of(
        name: str,
        rule: Rule,
        shared: Float[np.ndarray, " shared"],
        value: Float[np.ndarray, " value"],
        spreads: Float[np.ndarray, " spread"],
    ) -> Trait:
        """Return the trait of a rule on grids; means are on the grid of the values."""
        mean, spread = (grid.ravel() for grid in np.meshgrid(value, spreads, indexing="ij"))
        population = np.array([rule.shares(value, m, s) for m, s in zip(mean, spread, strict=True)])
        weights = rule.weights(shared[:, None], value[None, :])
        return Trait(name, shared, value, weights, mean, spread, population, rule)

    def narrowed(
        self,
        shared: Bool[np.ndarray, " shared"],
        value: Bool[np.ndarray, " value"],
        spread: Bool[np.ndarray, " hyper"],
    ) -> Trait | None:
        """Return the trait on finer grids, as many points over the part that is left.

        Args:
            shared: Shared numbers that the data leave.
            value: Values that they leave.
            spread: Populations whose spreads they leave.

        Returns:
            The trait; None if nothing is left out, or its grids are fixed.
        """
        if self.rule is None:
            return None
        spreads = np.unique(self.spread)
        left = np.isin(spreads, self.spread[spread])
        grids = [(self.shared, shared), (self.value, value), (spreads, left)]
        finer = [_finer(*grid_and_left) for grid_and_left in grids]
        if all(
            len(new) == len(old) and (new == old).all()
            for new, (old, _) in zip(finer, grids, strict=True)
        ):
            return None
        return Trait.of(self.name, self.rule, *finer)

    def alike(self) -> Trait:
        """Return the trait without differences between drivers: only populations of spread 0."""
        without_spread = self.spread == 0.0
        return self._replace(
            name="population",
            mean=self.mean[without_spread],
            spread=self.spread[without_spread],
            population=self.population[without_spread],
        )


def _finer(
    grid: Float[np.ndarray, " point"], left: Bool[np.ndarray, " point"]
) -> Float[np.ndarray, " point"]:
    """Return as many points between the neighbours of those that are left.

    They are even in the index of the old grid, so that the density of the prior stays.
    """
    places = np.flatnonzero(left)
    ends = max(int(places[0]) - 1, 0), min(int(places[-1]) + 1, len(grid) - 1)
    if ends == (0, len(grid) - 1):
        return grid
    return np.interp(np.linspace(*ends, len(grid)), np.arange(len(grid)), grid)


def wrapped_normal(
    angle: Float[np.ndarray, " value"], mean: float, spread: float
) -> Float[np.ndarray, " value"]:
    """Return the shares of a wrapped normal distribution (Mardia and Jupp 2000, 3.5.7) on a grid.

    On a grid of the whole circle whose step is at most the spread, sums of smooth functions over it
    are their integrals to a relative error of about exp(-2 π²).

    Args:
        angle: The grid, degrees, evenly spaced.
        mean: One of the grid's angles, degrees.
        spread: Standard deviation in degrees; with 0 all is at the mean.
    """
    off = (angle - mean + 180.0) % 360.0 - 180.0
    if spread == 0.0:
        return (np.abs(off) < 1e-9).astype(np.float64)
    turns = 360.0 * np.arange(-_TURNS, _TURNS + 1)
    density = np.exp(-0.5 * ((off[:, None] + turns) / spread) ** 2).sum(axis=1)
    return density / density.sum()


def normal_on_grid(
    value: Float[np.ndarray, " value"], mean: float, spread: float
) -> Float[np.ndarray, " value"]:
    """Return the shares of a normal distribution on a grid of any spacing, cut off at its ends."""
    if spread == 0.0:
        return (np.abs(value - mean) < 1e-9).astype(np.float64)
    density = np.exp(-0.5 * ((value - mean) / spread) ** 2) * np.gradient(value)
    return density / density.sum()


def angle_grid(step: float) -> Float[np.ndarray, " value"]:
    """Return the angles of the circle from -180 + step to 180 degrees; the step divides 360."""
    return step * np.arange(1, round(360 / step) + 1) - 180.0


def angle_trait(
    step: float = 5.0,
    largest_spread: float = 90.0,
    strengths: tuple[float, ...] = STRENGTHS,
    scale: float = 1.0,
) -> Trait:
    """Return the social angle as a trait: β (cos α r_env + sin α r_social), β shared.

    Prior: β, the population's mean and its spread each even over their grids.

    Args:
        step: Of the angles and spreads, degrees; divides 360.
        largest_spread: Of the population, degrees.
        strengths: Grid of β times `scale`.
        scale: Typical difference of reward between candidates.
    """
    spreads = np.arange(0.0, largest_spread + step / 2, step)
    rule = Rule(_by_angle, wrapped_normal)
    return Trait.of("angle", rule, np.array(strengths) / scale, angle_grid(step), spreads)


def _by_angle(strength: Any, angle: Any) -> Any:
    radians = np.radians(angle)
    return strength[..., None] * np.stack([np.cos(radians), np.sin(radians)], axis=-1)


def progress_trait(strengths: tuple[float, ...] = STRENGTHS, scale: float = 1.0) -> Trait:
    """Return the progress gain as a trait: g r_env + c r_social, g a driver's own, c shared.

    It has the freedom of `angle_trait` (mean, spread, one shared number), reaches as far, and says
    nothing about others.

    Args:
        strengths: Grid of the size of g and c times `scale`.
        scale: Typical difference of reward between candidates.
    """
    sizes = np.array(sorted({0.0, *strengths})) / scale
    value = np.concatenate([-sizes[:0:-1], sizes])
    rule = Rule(_by_progress, normal_on_grid)
    return Trait.of("progress gain", rule, value, value, np.array(PROGRESS_SPREADS) / scale)


def _by_progress(others: Any, gain: Any) -> Any:
    return np.stack(np.broadcast_arrays(gain, others), axis=-1)
