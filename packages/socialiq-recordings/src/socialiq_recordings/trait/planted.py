"""Simulated drivers of known angles at the recorded moments.

The recorded decisions are kept: their candidates, rewards, base predictor, drivers and halves. Only
what was chosen is drawn again, from the very model that is inferred. Larger samples repeat whole
chains, with new drivers.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from scipy.special import softmax

from socialiq_recordings.trait.choice_model import reward_scale, rewards_of
from socialiq_recordings.trait.models import Sample

CERTAIN = 60.0
"""β times the typical difference of reward above which every choice is certain."""


class Planted(NamedTuple):
    """A population of simulated drivers.

    Attributes:
        spread: Standard deviation of the angles, degrees.
        mean: Mean of the angles, degrees.
        strength: β, per unit of reward.
    """

    spread: float
    mean: float
    strength: float

    def weights(self, angle: Float[np.ndarray, " driver"]) -> Float[np.ndarray, "driver 2"]:
        """Return the weights of both rewards, of angles in degrees."""
        radians = np.radians(angle)
        return self.strength * np.stack([np.cos(radians), np.sin(radians)], axis=1)


def larger_sample(sample: Sample, size: int, rng: np.random.Generator) -> tuple[Sample, np.ndarray]:
    """Return a sample of `size` times as many chains, and the row of each of its decisions.

    With size 1 it is the sample itself; otherwise chains are drawn with replacement. Each draw is a
    chain of its own with drivers of its own.

    Args:
        sample: The sample at hand.
        size: How many times as many chains.
        rng: Generator of the draws.
    """
    chains = int(sample.chain.max()) + 1
    chain_numbers = np.arange(chains) if size == 1 else rng.integers(chains, size=size * chains)
    of_chain = [np.flatnonzero(sample.chain[sample.driver] == number) for number in range(chains)]
    rows = np.concatenate([of_chain[drawn_chain] for drawn_chain in chain_numbers])
    repeat_of = np.repeat(
        np.arange(len(chain_numbers)), [len(of_chain[drawn_chain]) for drawn_chain in chain_numbers]
    )
    number = repeat_of * len(sample.chain) + sample.driver[rows]
    identity, first, driver = np.unique(number, return_index=True, return_inverse=True)
    driver, chain = driver.astype(np.int64), repeat_of.astype(np.int64)
    table = dataclasses.replace(sample.table.rows(rows), driver=driver, chain=chain)
    return Sample(table, driver, repeat_of[first], identity), rows


def decide(
    sample: Sample,
    weights: Float[np.ndarray, "driver 2"],
    rng: np.random.Generator,
) -> Sample:
    """Return the sample with choices drawn by p(a | s), for weights of each driver.

    Args:
        sample: The decisions.
        weights: Of r_env and r_social, by driver.
        rng: Generator of the draws.
    """
    table = sample.table
    score = np.einsum("dcr,dr->dc", rewards_of(table), weights[sample.driver])
    below = softmax(table.log_base + score, axis=1).cumsum(axis=1)
    choice = (below < rng.random((len(table), 1)) * below[:, -1:]).sum(axis=1)
    acceleration = table.grid[choice]
    off = acceleration - np.exp(table.log_base) @ table.grid
    residual = before(off, sample.driver, table.time)
    table = dataclasses.replace(table, acceleration=acceleration, residual=residual)
    return sample._replace(table=table)


def before(
    values: Float[np.ndarray, " decision"],
    driver: Int64[np.ndarray, " decision"],
    time: Float[np.ndarray, " decision"],
) -> Float[np.ndarray, " decision"]:
    """Return the value of each driver's decision before, in time; 0 at the first."""
    order = np.lexsort([time, driver])
    same = driver[order][1:] == driver[order][:-1]
    earlier = np.zeros(len(values))
    earlier[order[1:]] = np.where(same, values[order][:-1], 0.0)
    return earlier


def known_angle_gain(sample: Sample, planted: Planted, draws: int = 61) -> float:
    """Return the share of the RMSE that knowing every driver's angle saves, of second halves.

    With m_α the mean choice of a driver of angle α and v_α its variance, the error is E[v_α] if α
    is known and E[v_α] + Var[m_α] if only the population is.

    Args:
        sample: The decisions.
        planted: The population.
        draws: Number of angles, at quantiles of a normal distribution.
    """
    from scipy.stats import norm

    table = sample.table.rows(sample.second)
    angle = planted.mean + planted.spread * norm.ppf((np.arange(draws) + 0.5) / draws)
    mean, variance = np.empty((2, draws, len(table)))
    for number, weight in enumerate(planted.weights(angle)):
        chance = softmax(table.log_base + rewards_of(table) @ weight, axis=1)
        mean[number] = chance @ table.grid
        variance[number] = chance @ table.grid**2 - mean[number] ** 2
    error_if_known = variance.mean()
    return 1.0 - float(np.sqrt(error_if_known / (error_if_known + mean.var(axis=0).mean())))


def strength_of_gain(sample: Sample, spread: float, mean: float, gain: float) -> float | None:
    """Return the least β, per unit of reward, with which known angles save a share of the error.

    Args:
        sample: The decisions.
        spread: Of the angles, degrees.
        mean: Of the angles, degrees.
        gain: The share.

    Returns:
        β to 1 %, by bisection; None if no β saves as much on these moments.
    """
    scale = reward_scale(sample.table)
    tried = np.geomspace(0.05, CERTAIN, 40) / scale
    gains = [known_angle_gain(sample, Planted(spread, mean, strength)) for strength in tried]
    enough = np.flatnonzero(np.array(gains) >= gain)
    if len(enough) == 0:
        return None
    high = float(tried[enough[0]])
    low = float(tried[enough[0] - 1]) if enough[0] else 0.0
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        if known_angle_gain(sample, Planted(spread, mean, middle)) >= gain:
            high = middle
        else:
            low = middle
    return high
