"""Traits of one number by driver: the weights that they give to the rewards of a choice.

A driver takes the candidate a of a decision s with probability

    p(a | s) proportional to p_base(a | s) exp(w_env r_env(s, a) + w_social r_social(s, a)).

A trait is a curve in the plane of the weights. All drivers share one more number, and their places
on the curve follow a population of some mean and spread. So all traits have the same freedom. A
grid must be finer than what the data determine (`Trait.narrowed`): on a coarser one a population of
some spread can come closer to drivers who are all alike than any point, and differences are found
that aren't there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from socialiq.social.angle import angle_difference
from socialiq_recordings.prediction.choices import ChoiceTable

STRENGTHS = (0.0, *(0.1 * 2.0 ** (third / 3) for third in range(19)))
"""β from 0 to 6.4, per typical difference of reward (`reward_scale`)."""

PROGRESS_SPREADS = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)  # spreads of g, per typical difference of reward
LEAST_SCALE = 1e-9
"""Typical difference of reward below which the rewards of all candidates count as equal."""

_WIDEST = 90.0  # degrees; largest spread of angles
_TURNS = 3  # of the circle beyond which a wrapped normal of 90 degrees has nothing left
_BLOCK = 500_000  # probabilities held at once, 4 MB

Values = Float[np.ndarray, " value"]


class Rule(NamedTuple):
    """Functions from which a trait follows on any grid."""

    # of r_env and r_social, for shared numbers (a column) and values (a row)
    weights: Callable[[Any, Any], Any]
    # of drivers with each value, for values, mean and spread
    shares: Callable[[Any, float, float], Any]


class Trait(NamedTuple):
    """Grid of a trait: what is integrated out."""

    shared: Float[np.ndarray, " shared"]  # what all drivers have in common, by grid point
    value: Float[np.ndarray, " value"]  # what a driver has of its own, ascending
    weights: Float[np.ndarray, "shared value 2"]  # of r_env and r_social at each of them
    mean: Float[np.ndarray, " hyper"]  # mean of the population, by grid point of the population
    spread: Float[np.ndarray, " hyper"]  # spread of the population; 0 if all drivers are alike
    # share of the drivers with each value, given mean and spread
    population: Float[np.ndarray, "hyper value"]
    # how weights and shares follow from the grids; None if the grids are fixed
    rule: Rule | None = None

    @staticmethod
    def of(rule: Rule, shared: np.ndarray, value: np.ndarray, spreads: np.ndarray) -> Trait:
        """Return the trait of a rule on grids; means are on the grid of the values."""
        mean, spread = (grid.ravel() for grid in np.meshgrid(value, spreads, indexing="ij"))
        population = np.array([rule.shares(value, m, s) for m, s in zip(mean, spread, strict=True)])
        weights = rule.weights(shared[:, None], value[None, :])
        return Trait(shared, value, weights, mean, spread, population, rule)

    def narrowed(
        self,
        shared: Bool[np.ndarray, " shared"],
        value: Bool[np.ndarray, " value"],
        spread: Bool[np.ndarray, " hyper"],
    ) -> Trait | None:
        """Return the trait on finer grids, as many points over the part that the data leave.

        `spread` says of which populations they leave the spread. None if nothing is left out, or
        the grids are fixed.
        """
        if self.rule is None:
            return None
        spreads = np.unique(self.spread)
        left = np.isin(spreads, self.spread[spread])
        grids = [(self.shared, shared), (self.value, value), (spreads, left)]
        finer, same = [], True
        for grid, remaining in grids:
            # Between the neighbours of what is left, even in the index of the old grid, so that the
            # density of the prior stays.
            places = np.flatnonzero(remaining)
            ends = max(int(places[0]) - 1, 0), min(int(places[-1]) + 1, len(grid) - 1)
            is_same = ends == (0, len(grid) - 1)
            at, numbers = np.linspace(*ends, len(grid)), np.arange(len(grid))
            finer.append(grid if is_same else np.interp(at, numbers, grid))
            same = same and is_same
        return None if same else Trait.of(self.rule, *finer)

    def alike(self) -> Trait:
        """Return the trait without differences between drivers: only populations of spread 0."""
        alike = self.spread == 0.0
        mean, spread, population = self.mean[alike], self.spread[alike], self.population[alike]
        return self._replace(mean=mean, spread=spread, population=population)


def _wrapped_normal(angle: Values, mean: float, spread: float) -> Values:
    """Return the shares of a wrapped normal distribution (Mardia and Jupp 2000) on a grid."""
    off = angle_difference(angle, mean)
    if spread == 0.0:
        return (np.abs(off) < 1e-9).astype(np.float64)
    turns = 360.0 * np.arange(-_TURNS, _TURNS + 1)
    density = np.exp(-0.5 * ((off[:, None] + turns) / spread) ** 2).sum(axis=1)
    return density / density.sum()


def _normal_on_grid(value: Values, mean: float, spread: float) -> Values:
    """Return the shares of a normal distribution on a grid of any spacing, cut off at its ends."""
    if spread == 0.0:
        return (np.abs(value - mean) < 1e-9).astype(np.float64)
    density = np.exp(-0.5 * ((value - mean) / spread) ** 2) * np.gradient(value)
    return density / density.sum()


def angle_trait(
    step: float = 5.0, strengths: tuple[float, ...] = STRENGTHS, scale: float = 1.0
) -> Trait:
    """Return the social angle as a trait: β (cos α r_env + sin α r_social), β shared.

    Prior: β, the population's mean and its spread each even over their grids. The grid of β is
    `strengths` over the typical difference of reward `scale`; `step` in degrees divides 360.
    """

    def weights(strength: Any, angle: Any) -> Any:
        radians = np.radians(angle)
        return strength[..., None] * np.stack([np.cos(radians), np.sin(radians)], axis=-1)

    rule, spreads = Rule(weights, _wrapped_normal), np.arange(0.0, _WIDEST + step / 2, step)
    circle = step * np.arange(1, round(360 / step) + 1) - 180.0
    return Trait.of(rule, np.array(strengths) / scale, circle, spreads)


def progress_trait(strengths: tuple[float, ...] = STRENGTHS, scale: float = 1.0) -> Trait:
    """Return the progress gain as a trait: g r_env + c r_social, g a driver's own, c shared.

    It has the freedom of `angle_trait` (mean, spread, one shared number), reaches as far, and says
    nothing about others.
    """

    def weights(social: Any, gain: Any) -> Any:
        return np.stack(np.broadcast_arrays(gain, social), axis=-1)

    sizes = np.array(sorted({0.0, *strengths})) / scale
    value = np.concatenate([-sizes[:0:-1], sizes])
    spreads = np.array(PROGRESS_SPREADS) / scale
    return Trait.of(Rule(weights, _normal_on_grid), value, value, spreads)


def family_trait(angle: Values, shares: tuple[float, ...]) -> Trait:
    """Return the angle of a family of policies as a trait, with shares of the dial in place of β.

    A population is a normal distribution that is cut off at the ends of the family, angles at equal
    distances. Policies take the place of rewards, which have no weight.
    """
    step, rule = float(angle[1] - angle[0]), Rule(lambda *_: np.zeros((0, 2)), _normal_on_grid)
    return Trait.of(rule, np.array(shares), angle, np.arange(0.0, _WIDEST + step / 2, step))


def rewards_of(table: ChoiceTable) -> Float[np.ndarray, "decision candidate 2"]:
    """Return the reward pairs of all candidates."""
    return np.stack([table.r_env, table.r_social], axis=2)


def reward_scale(table: ChoiceTable) -> float:
    """Return the typical difference of reward between candidates; 1 if there is none.

    It is the root mean square over decisions and both rewards of the standard deviation under the
    base predictor. Both rewards are divided by one number, so that an angle keeps its meaning.
    """
    chance, rewards = np.exp(table.log_base)[:, :, None], rewards_of(table)
    off = rewards - (chance * rewards).sum(axis=1, keepdims=True)
    scale = float(np.sqrt((chance * off**2).sum(axis=1).mean())) if len(table) else 0.0
    return scale if scale > LEAST_SCALE else 1.0


class Evaluated(NamedTuple):
    """Predictions of some decisions: by one model, or by every grid point of a trait."""

    log_likelihood: Float[np.ndarray, "decision ..."]  # log p of the chosen candidate, nats
    # mean of the candidates, in the unit of the table's grid
    mean: Float[np.ndarray, "decision ..."]

    def rows(self, mask: np.ndarray) -> Evaluated:
        """Return some decisions."""
        return Evaluated(self.log_likelihood[mask], self.mean[mask])


def evaluate(table: ChoiceTable, trait: Trait) -> Evaluated:
    """Return the predictions of every decision for every shared number and value of a trait."""
    weights = trait.weights.reshape(-1, 2)
    rewards, chosen = rewards_of(table), table.chosen
    result = np.empty((2, len(table), len(weights)))
    block = max(1, _BLOCK // (len(weights) * len(table.grid)))
    for first in range(0, len(table), block):
        block_rows = slice(first, first + block)
        score = table.log_base[block_rows, :, None] + rewards[block_rows] @ weights.T
        score -= score.max(axis=1, keepdims=True)
        of_chosen = np.take_along_axis(score, chosen[block_rows, None, None], axis=1)[:, 0]
        chance = np.exp(score, out=score)
        total = chance.sum(axis=1)
        result[0, block_rows] = of_chosen - np.log(total)
        result[1, block_rows] = np.einsum("dcw,c->dw", chance, table.grid) / total
    return Evaluated(*result.reshape(2, len(table), *trait.weights.shape[:2]))
