"""Hierarchical inference of a value by driver: population, then driver, integrated on a grid.

All drivers share one number, and their own values follow a population of some mean and spread.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64
from scipy.special import softmax

Likelihood = Float[np.ndarray, "driver shared value"]
Prior = Float[np.ndarray, "shared value"]


def populations(
    value: Float[np.ndarray, " value"], spreads: Float[np.ndarray, " spread"]
) -> Float[np.ndarray, "population value"]:
    """Return normal distributions on a grid of equal steps, cut off at its ends.

    Means are on the grid. With a spread of 0 all drivers are at the mean.
    """
    off = value - value[:, None, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.where(off == 0, 1.0, np.exp(-0.5 * (off / spreads[:, None]) ** 2))
    return (density / density.sum(axis=2, keepdims=True)).reshape(-1, len(value))


def driver_log_likelihood(
    of_decision: Float[np.ndarray, "decision shared value"],
    driver: Int64[np.ndarray, " decision"],
    drivers: int,
) -> Likelihood:
    """Return the sum over each driver's decisions of log p(a | s); 0 without a decision.

    `driver` is the number of each decision's driver, below the number of drivers.
    """
    total = np.zeros((drivers, *of_decision.shape[1:]))
    np.add.at(total, driver, of_decision)
    return total


def driver_prior(
    log_likelihood: Likelihood, population: Float[np.ndarray, "population value"]
) -> Prior:
    """Return the distribution of a new driver's value, jointly with the shared number.

    Shared numbers and populations have an even prior, and the drivers' own values are integrated
    out: log Σ_z p(z | population) p(decisions | z).
    """
    top = log_likelihood.max(axis=2, keepdims=True)
    within = np.exp(log_likelihood - top) @ population.T
    marginal = np.log(np.maximum(within, np.finfo(np.float64).tiny)) + top
    return softmax(marginal.sum(axis=0)) @ population


def driver_posteriors(log_likelihood: Likelihood, prior: Prior) -> Likelihood:
    """Return each driver's posterior of its value, jointly with the shared number.

    The prior must come from other decisions: otherwise the driver's evidence would count twice.
    """
    weight = prior * np.exp(log_likelihood - log_likelihood.max(axis=(1, 2), keepdims=True))
    return weight / weight.sum(axis=(1, 2), keepdims=True)
