"""Hierarchical inference of a trait: population, then driver, everything integrated on a grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.special import softmax

from socialiq.social.angle import angle_difference
from socialiq_recordings.trait.traits import Trait

FOLDS = 20  # most folds of chains
_BLOCK = 4_000_000  # numbers in one block of products, 32 MB
Likelihood = Float[np.ndarray, "driver shared value"]
Marginals = Float[np.ndarray, "driver shared hyper"]
OfPoints = Float[np.ndarray, " point"]


def driver_log_likelihood(
    of_decision: Float[np.ndarray, "decision shared value"],
    driver: Int64[np.ndarray, " decision"],
    drivers: int,
) -> Likelihood:
    """Return the sum over each driver's decisions of log p(a | s); 0 without a decision.

    `driver` is the number of each decision's driver, below the number of drivers.
    """
    order = np.argsort(driver, kind="stable")
    total = np.zeros((drivers, *of_decision.shape[1:]))
    if len(order):
        present, first = np.unique(driver[order], return_index=True)
        total[present] = np.add.reduceat(of_decision[order], first, axis=0)
    return total


def log_marginal(log_likelihood: Likelihood, trait: Trait) -> Marginals:
    """Return log Σ_z p(z | mean, spread) p(decisions | z), a driver's trait integrated out."""
    if not trait.spread.any():
        return log_likelihood[..., trait.population.argmax(axis=1)]  # all drivers at the mean
    top = log_likelihood.max(axis=2, keepdims=True)
    marginal = np.empty((*log_likelihood.shape[:2], len(trait.mean)))
    block = max(1, _BLOCK // marginal[0].size)
    tiny = np.finfo(np.float64).tiny
    for first in range(0, len(marginal), block):
        block_rows = slice(first, first + block)
        within = np.exp(log_likelihood[block_rows] - top[block_rows]) @ trait.population.T
        marginal[block_rows] = np.log(np.maximum(within, tiny)) + top[block_rows]
    return marginal


class Population(NamedTuple):
    """Posterior of what drivers have in common, on the grid of a trait."""

    trait: Trait  # the grid
    chance: Float[np.ndarray, "shared hyper"]  # of each shared number, mean and spread

    @property
    def driver_prior(self) -> Float[np.ndarray, "shared value"]:
        """Distribution of a new driver's trait, jointly with the shared number."""
        return self.chance @ self.trait.population

    def quantiles(self, name: str, at: tuple[float, ...]) -> list[float]:
        """Return posterior quantiles of `shared`, `mean` or `spread`; of angles see `direction`."""
        chance = self.chance.sum(axis=1 if name == "shared" else 0)
        return weighted_quantiles(getattr(self.trait, name), chance, at)


def population_posterior(
    log_marginals: Marginals, trait: Trait, counts: Float[np.ndarray, " driver"] | None = None
) -> Population:
    """Return the posterior of shared number, mean and spread, under an even prior on the grid.

    `counts` says how often each driver counts: once by default; 0 leaves it out.
    """
    weight = np.ones(len(log_marginals)) if counts is None else counts
    total = np.tensordot(weight, log_marginals, 1)
    return Population(trait, softmax(total))


def driver_posteriors(log_likelihood: Likelihood, population: Population) -> Likelihood:
    """Return each driver's posterior of its trait, jointly with the shared number.

    The population must come from other drivers: otherwise their own evidence would count twice.
    """
    prior = population.driver_prior
    weight = prior * np.exp(log_likelihood - log_likelihood.max(axis=(1, 2), keepdims=True))
    return weight / weight.sum(axis=(1, 2), keepdims=True)


class Inference(NamedTuple):
    """A trait inferred from drivers' decisions."""

    population: Population  # from all drivers
    fold: Int64[np.ndarray, " driver"]  # number of each driver's fold, a group of chains
    others: tuple[Population, ...]  # from the drivers of the other folds, by fold
    # posterior of each driver, with the population of the other folds as its prior
    drivers: Likelihood

    def left(
        self, least: float
    ) -> tuple[Bool[np.ndarray, " shared"], Bool[np.ndarray, " value"], Bool[np.ndarray, " hyper"]]:
        """Whether any population leaves each shared number, value and place of the population.

        It leaves a point whose probability is `least` times that of the likeliest one, or more.
        """
        populations = (self.population, *self.others)

        def any_leaves(chances: list[np.ndarray]) -> Bool[np.ndarray, " point"]:
            return np.any([chance >= least * chance.max() for chance in chances], axis=0)

        return (
            any_leaves([population.chance.sum(axis=1) for population in populations]),
            any_leaves([population.driver_prior.sum(axis=0) for population in populations]),
            any_leaves([population.chance.sum(axis=0) for population in populations]),
        )


def infer(
    log_likelihood: Likelihood, chain: Int64[np.ndarray, " driver"], trait: Trait
) -> Inference:
    """Infer a trait of all drivers; nothing of a driver's own chain is in its population.

    Up to `FOLDS` chains, numbered from 0, are folds of their own.
    """
    marginals, fold = log_marginal(log_likelihood, trait), chain % FOLDS
    without = tuple(
        population_posterior(marginals, trait, (fold != number).astype(np.float64))
        for number in range(int(fold.max()) + 1)
    )
    posterior = np.empty_like(log_likelihood)
    for number, population in enumerate(without):
        rows = np.flatnonzero(fold == number)
        posterior[rows] = driver_posteriors(log_likelihood[rows], population)
    return Inference(population_posterior(marginals, trait), fold, without, posterior)


def weighted_quantiles(values: OfPoints, chance: OfPoints, at: tuple[float, ...]) -> list[float]:
    """Return quantiles of a distribution on grid points: the first value that reaches the order."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(chance[order]) / chance.sum()
    places = np.searchsorted(reached, np.array(at) - 1e-12)
    return values[order][np.minimum(places, len(values) - 1)].tolist()


class Direction(NamedTuple):
    """Mean direction of a distribution of angles and its interval, degrees."""

    angle: float  # direction of the mean unit vector
    low: float  # `angle` plus a quantile of the wrapped deviations
    high: float  # likewise


def direction(angle: OfPoints, chance: OfPoints, confidence: float) -> Direction:
    """Return the circular mean of grid points in degrees, and the interval of equal tails."""
    radians = np.radians(angle)
    mean = float(np.degrees(np.arctan2(chance @ np.sin(radians), chance @ np.cos(radians))))
    off = angle_difference(angle, mean)
    low, high = weighted_quantiles(off, chance, ((1 - confidence) / 2, (1 + confidence) / 2))
    return Direction(mean, mean + low, mean + high)
