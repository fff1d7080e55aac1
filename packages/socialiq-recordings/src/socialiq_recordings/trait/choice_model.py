"""Probabilities of choices: by weights of the two rewards, or by a family of policies.

Of a family with one policy for each angle, such as a dial, a driver of angle α takes the candidate
a of a decision s with probability

    p(a | s) = (1 - ε) softmax(β Q_α(s, .))(a) + ε / n,

with β shared and ε the share of choices at random among the n candidates. A candidate whose value
is minus infinity is none (`by_effect`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from scipy.special import log_softmax, softmax

from socialiq_recordings.prediction.choices import ChoiceTable
from socialiq_recordings.trait.traits import STRENGTHS, Trait, normal_on_grid

_BLOCK = 500_000  # probabilities held at once, 4 MB

LEAST_SCALE = 1e-9
"""Typical difference of reward below which the rewards of all candidates count as equal."""


def log_choice(
    log_base: Float[np.ndarray, "decision candidate"],
    rewards: Float[np.ndarray, "decision candidate 2"],
    weights: Float[np.ndarray, "weight 2"],
) -> Float[np.ndarray, "decision weight candidate"]:
    """Return log p(a | s), proportional to p_base(a | s) exp(w · (r_env, r_social)(s, a)).

    Args:
        log_base: log p_base of each candidate.
        rewards: r_env and r_social of each candidate.
        weights: w, of r_env and r_social.
    """
    score = np.einsum("dcr,wr->dwc", rewards, weights)
    return log_softmax(log_base[:, None, :] + score, axis=2)


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
    """Predictions of every grid point of a trait.

    Attributes:
        log_likelihood: log p of the chosen candidate.
        mean: Mean of the candidates, in the unit of the table's grid.
    """

    log_likelihood: Float[np.ndarray, "decision shared value"]
    mean: Float[np.ndarray, "decision shared value"]

    def rows(self, mask: np.ndarray) -> Evaluated:
        """Return some decisions."""
        return Evaluated(self.log_likelihood[mask], self.mean[mask])


def evaluate(table: ChoiceTable, trait: Trait) -> Evaluated:
    """Return the predictions of every decision for every grid point of a trait."""
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
    shape = (len(table), *trait.weights.shape[:2])
    return Evaluated(result[0].reshape(shape), result[1].reshape(shape))


class Tabulated(NamedTuple):
    """Predictions of every candidate at every decision and grid point of a trait.

    Attributes:
        log_p: By decision, candidate, shared number and value.
        mean: By decision, shared number and value.
    """

    log_p: Float[np.ndarray, "decision candidate shared value"]
    mean: Float[np.ndarray, "decision shared value"]

    @staticmethod
    def of(table: ChoiceTable, trait: Trait) -> Tabulated:
        """Evaluate all candidates once, so that repeats only look them up."""
        shape, weights = trait.weights.shape[:2], trait.weights.reshape(-1, 2)
        score = table.log_base[:, :, None] + rewards_of(table) @ weights.T
        log_p = log_softmax(score, axis=1)
        mean = np.einsum("dcw,c->dw", np.exp(log_p), table.grid)
        return Tabulated(log_p.reshape(len(table), -1, *shape), mean.reshape(len(table), *shape))

    def at(self, rows: np.ndarray, chosen: Int64[np.ndarray, " decision"]) -> Evaluated:
        """Return the predictions of some rows for what was chosen there."""
        return Evaluated(self.log_p[rows, chosen], self.mean[rows])


class Prediction(NamedTuple):
    """Predictions of one model for some decisions.

    Attributes:
        log_likelihood: log p of the chosen candidate, nats.
        mean: Mean of the candidates.
    """

    log_likelihood: Float[np.ndarray, " decision"]
    mean: Float[np.ndarray, " decision"]


def predict(
    evaluated: Evaluated,
    posterior: Float[np.ndarray, "driver shared value"],
    driver: Int64[np.ndarray, " decision"],
) -> Prediction:
    """Return the predictions with the trait integrated out over each decision's own posterior.

    log Σ p(shared, z | first half) p(a | s, shared, z), and the mean under the same mixture.

    Args:
        evaluated: Of the decisions to predict.
        posterior: Of each row of posteriors.
        driver: Row of each decision's posterior.
    """
    weight = posterior[driver]
    within = np.einsum("dsv,dsv->d", weight, np.exp(evaluated.log_likelihood))
    mean = np.einsum("dsv,dsv->d", weight, evaluated.mean)
    return Prediction(np.log(np.maximum(within, np.finfo(np.float64).tiny)), mean)


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
    mean, spread = (grid.ravel() for grid in np.meshgrid(angle, spreads, indexing="ij"))
    population = np.array([normal_on_grid(angle, m, s) for m, s in zip(mean, spread, strict=True)])
    weights = np.zeros((len(shared), len(angle), 2))  # of rewards: the values replace them
    return Trait("angle", shared, angle, weights, mean, spread, population)


def value_scale(values: Values) -> float:
    """Return the typical difference of value between candidates; 1 if there is none."""
    finite = np.isfinite(values)
    variance = values.var(axis=1, where=finite) if values.size else np.zeros(1)
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
    finite = np.isfinite(values)[:, :, None, :]
    score = trait.shared[:, None] * np.where(finite, values[:, :, None, :], 0.0)
    chance = softmax(np.where(finite, score, -np.inf), axis=1)
    chance = np.where(
        finite, (1 - random) * chance + random / finite.sum(axis=1, keepdims=True), 0.0
    )
    log_p = np.log(np.maximum(chance, np.finfo(np.float64).tiny))
    return Tabulated(log_p, np.einsum("dcsv,c->dsv", chance, grid))
