"""Choices of drivers who follow a family of policies, one for each angle, such as a dial.

A driver of angle α takes the candidate a of a decision s with probability

    p(a | s) = (1 - ε) softmax(β Q_α(s, .))(a) + ε / n,

with β shared and ε the share of choices at random among the n candidates. A candidate whose value
is minus infinity is none (`by_effect`). What weights of two rewards are to
`recordings.trait.traits`, the family's own values are here: all that is inferred from first halves
stays the same.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64
from scipy.special import softmax

from socialiq_recordings.trait.choice_model import LEAST_SCALE, Tabulated
from socialiq_recordings.trait.traits import STRENGTHS, Trait, normal_on_grid

Values = Float[np.ndarray, "decision candidate value"]


def family_trait(
    angle: Float[np.ndarray, " value"],
    largest_spread: float = 90.0,
    strengths: tuple[float, ...] = STRENGTHS,
    scale: float = 1.0,
) -> Trait:
    """Return the angle of a family of policies as a trait.

    Prior: β, the population's mean and its spread each even over their grids. A population is a
    normal distribution that is cut off at the ends of the family.

    Args:
        angle: Of the policies, degrees, at equal distances.
        largest_spread: Of the population, degrees.
        strengths: Grid of β times `scale`.
        scale: Typical difference of value between candidates.
    """
    step, shared = float(angle[1] - angle[0]), np.array(strengths) / scale
    spreads = np.arange(0.0, largest_spread + step / 2, step)
    mean, spread = (one.ravel() for one in np.meshgrid(angle, spreads, indexing="ij"))
    population = np.array([normal_on_grid(angle, m, s) for m, s in zip(mean, spread, strict=True)])
    weights = np.zeros((len(shared), len(angle), 2))  # of rewards: the values replace them
    return Trait("angle", shared, angle, weights, mean, spread, population)


def value_scale(values: Values) -> float:
    """Return the typical difference of value between candidates; 1 if there is none."""
    known = np.isfinite(values)
    variance = values.var(axis=1, where=known) if values.size else np.zeros(1)
    scale = float(np.sqrt(variance.mean()))
    return scale if scale > LEAST_SCALE else 1.0


def by_effect(values: Values, same: Int64[np.ndarray, "decision candidate"]) -> Values:
    """Return values in which candidates of one effect are one: the first, with their largest value.

    The others get minus infinity.

    Args:
        values: Q_α(s, a).
        same: For each candidate the first one of the same effect.
    """
    merged = np.full(values.shape, -np.inf)
    rows = np.arange(len(values))
    for candidate, first in enumerate(same.T):
        merged[rows, first] = np.maximum(merged[rows, first], values[:, candidate])
    return merged


def tabulate_family(
    values: Values, grid: Float[np.ndarray, " candidate"], trait: Trait, random: float
) -> Tabulated:
    """Return log p(a | s) of every candidate, and the mean candidate, by β and angle.

    Args:
        values: Q_α(s, a).
        grid: The candidates.
        trait: Of the family (`family_trait`).
        random: ε, above 0.
    """
    known = np.isfinite(values)[:, :, None, :]
    score = trait.shared[:, None] * np.where(known, values[:, :, None, :], 0.0)
    chance = softmax(np.where(known, score, -np.inf), axis=1)
    chance = np.where(known, (1 - random) * chance + random / known.sum(axis=1, keepdims=True), 0.0)
    log_p = np.log(np.maximum(chance, np.finfo(np.float64).tiny))
    return Tabulated(log_p, np.einsum("dcsv,c->dsv", chance, grid))
