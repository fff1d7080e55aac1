"""Spread of the angles that drivers show, less what few and similar decisions make of one angle.

The spread of measured angles is too wide: a driver with two decisions shows some angle whatever it
is like. Here a driver's mean point has a normal error, its decisions' covariance over the number
of independent decisions that they are worth; both are pooled over the drivers. The angles behind
the points follow a wrapped normal distribution, whose mean and spread are inferred and integrated
over, as of any trait (`recordings.trait.hierarchy`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.special import log_ndtr

from socialiq.statistics.autocorrelation import Serial, fit_serial, mean_of
from socialiq.statistics.bootstrap import resample_rows
from socialiq_recordings.trait.hierarchy import (
    Direction,
    direction,
    infer,
    log_marginal,
    population_posterior,
)
from socialiq_recordings.trait.traits import Trait, angle_trait

_CLOSEST = 1e-6  # of the points' size: smaller errors count as this


@dataclass(frozen=True)
class Spread:
    """Posterior of a population of angles, degrees.

    Attributes:
        drivers: Number of drivers.
        chains: Number of chains that share no vehicle.
        autocorrelation: Of neighbouring decisions of a driver.
        worth: Mean number of independent decisions that a driver's are worth.
        mean: Mean of the population, with its interval.
        spread: Posterior median of the population's standard deviation.
        low: Lower end of its interval.
        high: Upper end; at the grid's end of 90 the angles are as good as even.
        chain_low: The same over resampled chains; None with fewer than two.
        chain_high: Upper end.
    """

    drivers: int
    chains: int
    autocorrelation: float
    worth: float
    mean: Direction
    spread: float
    low: float
    high: float
    chain_low: float | None
    chain_high: float | None


@dataclass(frozen=True)
class Deconvolved:
    """Population and its drivers.

    Attributes:
        population: The population.
        drivers: Angle of each driver with its interval, given the drivers of the other chains.
    """

    population: Spread
    drivers: tuple[Direction, ...]


def log_direction_likelihood(
    point: Float64[np.ndarray, " 2"],
    covariance: Float64[np.ndarray, "2 2"],
    angle: Float64[np.ndarray, " angle"],
) -> Float64[np.ndarray, " angle"]:
    """Return log ∫ N(m; r u(α), V) dr over r > 0, u(α) = (cos α, sin α): any length is as likely.

    With A = u' V^-1 u, B = u' V^-1 m and C = m' V^-1 m it is
    sqrt(2π / A) exp(-(C - B² / A) / 2) Φ(B / sqrt(A)) / (2π sqrt(det V)).

    Args:
        point: Mean point m of a driver.
        covariance: V, of its error.
        angle: α, degrees.
    """
    radians = np.radians(angle)
    toward = np.stack([np.cos(radians), np.sin(radians)])
    inverse = np.linalg.inv(covariance)
    a, b = (toward * (inverse @ toward)).sum(axis=0), toward.T @ inverse @ point
    c = point @ inverse @ point
    constant = math.log(2 * math.pi) + 0.5 * np.linalg.slogdet(covariance)[1]
    gauss = 0.5 * (np.log(2 * math.pi / a) - (c - b**2 / a))
    return gauss + log_ndtr(b / np.sqrt(a)) - constant


def deconvolve(
    pairs: Sequence[Float64[np.ndarray, "_ 2"]],
    chain: Int64[np.ndarray, " driver"],
    seed: int,
    confidence: float = 0.95,
    resamples: int = 200,
    step: float = 5.0,
) -> Deconvolved:
    """Infer the population of angles and each driver's own.

    Args:
        pairs: r_env and r_social of each driver's decisions, at least one driver.
        chain: Number of each driver's chain, from 0.
        seed: Of the resampling of chains.
        confidence: Of all intervals.
        resamples: Number of resamples.
        step: Of the angles, degrees.
    """
    serial, trait = fit_serial(pairs), angle_trait(step, strengths=(1.0,))
    if max(map(len, pairs)) == 1:  # nothing shows the error: it may be as large as the points
        points = np.concatenate(pairs)
        serial = serial._replace(covariance=points.T @ points / len(points))
    likelihood = np.array([_of_driver(one, serial, trait) for one in pairs])[:, None, :]
    found = infer(likelihood, chain, trait)
    ends = ((1 - confidence) / 2, 0.5, (1 + confidence) / 2)
    low, middle, high = found.population.quantiles("spread", ends)
    over = _over_chains(log_marginal(likelihood, trait), chain, trait, seed, resamples)
    by_chain = np.quantile(over, [ends[0], ends[2]]).tolist() if len(over) else [None, None]
    population = Spread(
        drivers=len(pairs),
        chains=int(chain.max()) + 1,
        autocorrelation=serial.correlation,
        worth=float(np.mean([serial.worth(len(one)) for one in pairs])),
        mean=direction(trait.mean, found.population.chance[0], confidence),
        spread=middle,
        low=low,
        high=high,
        chain_low=by_chain[0],
        chain_high=by_chain[1],
    )
    each = [direction(trait.value, one, confidence) for one in found.drivers[:, 0]]
    return Deconvolved(population, tuple(each))


def _of_driver(
    pairs: Float64[np.ndarray, "_ 2"], serial: Serial, trait: Trait
) -> Float64[np.ndarray, " angle"]:
    closest = (_CLOSEST * (1.0 + float(np.abs(pairs).max()))) ** 2 * np.eye(2)
    covariance = serial.covariance / serial.worth(len(pairs)) + closest
    return log_direction_likelihood(mean_of(pairs, serial.correlation), covariance, trait.value)


def _over_chains(
    marginals: Float64[np.ndarray, "driver shared hyper"],
    chain: Int64[np.ndarray, " driver"],
    trait: Trait,
    seed: int,
    resamples: int,
) -> list[float]:
    """Return posterior means of the spread for resampled chains; none of fewer than two."""
    chains = int(chain.max()) + 1
    found: list[float] = []
    for rows in resample_rows(chains, resamples, seed) if chains > 1 else ():
        for drawn in rows:
            counts = np.bincount(drawn, minlength=chains)[chain].astype(np.float64)
            chance = population_posterior(marginals, trait, counts).chance.sum(axis=0)
            found.append(float(chance @ trait.spread))
    return found
