"""Priors: terms of the objective with the social score R(α) (thesis 4.3.1 and appendix B).

`target` is always R(α) of the chosen pair of returns, shape (batch,); `strength` is λ.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.state import HyperparameterArrays
from socialiq.social.angle import score

Scalar = Float[Array, ""]
Column = Float[Array, " batch"]


def social_prior(reward: Column, target: Column, strength: Scalar | float) -> Scalar:
    """L_reg = E_E[(r̂ - λ R(α))²] (Eq 4.4)."""
    return jnp.mean(jnp.square(reward - strength * target))


def bellman_shift(reward: Column, target: Column, strength: Scalar | float) -> Column:
    """r̂_shifted = r̂ - λ R(α) (Eq B.1).

    In term 1 with χ² (φ' = 1) the shift adds a constant to the loss, so it has no gradient: it
    steers only under another divergence or inside term 3, where it is `shifted_chi2`.
    """
    return reward - strength * target


def shifted_chi2(
    reward: Column, target: Column, strength: Scalar | float, chi2_alpha: Scalar | float
) -> Scalar:
    """E[(r̂ - λ R(α))²] / (4 α_χ): term 3 itself centred on the social score.

    One quadratic instead of Eq 4.5's two, whose sum is itself such a quadratic: with
    c = 1/(4 α_χ), c r̂² + w (r̂ - λR)² = (c + w) (r̂ - λR w/(c + w))² + constant.
    """
    return jnp.mean(jnp.square(reward - strength * target)) / (4.0 * chi2_alpha)


def demonstration_weights(
    target: Float[Array, " transition"],
    allowed: Bool[Array, " transition"],
    reweight_temperature: Scalar | float,
) -> Float[Array, " transition"]:
    """w_i = exp(R_i / τ_w) / sum_j exp(R_j / τ_w) (Eq B.2), over the allowed transitions."""
    logits = jnp.where(allowed, target / reweight_temperature, -jnp.inf)
    exponentials = jnp.exp(logits - jnp.max(logits))
    return exponentials / jnp.sum(exponentials)


def table_weights(
    table: ExpertTable, hyperparameters: HyperparameterArrays
) -> Float[Array, " transition"]:
    """Eq B.2 over the transitions of a run's data set, by their targets; 0 on other rows."""
    rows = jnp.arange(table.columns.action.shape[0])
    dataset = hyperparameters.dataset
    first, end = table.row_bounds[dataset], table.row_bounds[dataset + 1]
    target = score(hyperparameters.weights, table.columns.target)
    allowed = (rows >= first) & (rows < end)
    return demonstration_weights(target, allowed, hyperparameters.reweight_temperature)


def cumulative_weights(
    table: ExpertTable, hyperparameters: HyperparameterArrays
) -> Float[Array, " transition"]:
    """Return the cumulative sum of `table_weights`, as `ExpertTable.sample_weighted` takes it."""
    return jnp.cumsum(table_weights(table, hyperparameters))


def effective_sample_size(weights: Float[Array, " transition"]) -> Scalar:
    """1 / sum_i w_i²: how many equally weighted transitions the weights are worth."""
    return 1.0 / jnp.sum(jnp.square(weights))
