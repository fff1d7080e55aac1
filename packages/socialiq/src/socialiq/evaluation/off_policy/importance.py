"""Weighted importance sampling over episodes of one or several demonstrators.

An episode is weighed by how much more probable its actions are for the policy than for the mixture
of demonstrators that it was drawn from:

    ρ_t = Π_{k <= t} π(a_k|s_k) / Σ_m p_m Π_{k <= t} π_m(a_k|s_k)

with p_m the share of episodes of mode m (the balance heuristic of Veach and Guibas 1995, for
policies Agarwal et al. 2017). The world's own chances cancel. Both estimates are self-normalised:

    whole episodes   Σ_i ρ_T G / Σ_i ρ_T
    step by step     Σ_t Σ_i ρ_t r_t / Σ_i ρ_t       (Precup, Sutton and Singh 2000; Thomas 2015)
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.evaluation.off_policy.logged import Logged


def ratios(
    logged: Logged,
    chances: Float[np.ndarray, "state action"],
    behaviour: Float[np.ndarray, "mode state action"],
    shares: Float[np.ndarray, " mode"],
) -> Float[np.ndarray, "episode step"]:
    """Return ρ of each episode up to each step; beyond its end the last one.

    Args:
        logged: The episodes.
        chances: The policy's probabilities at each distinct observation.
        behaviour: Each demonstrator's probabilities at each distinct observation.
        shares: p_m, which sum to 1.
    """
    state, action = logged.state, logged.data.action
    taken = chances[state, action]
    with np.errstate(divide="ignore"):
        target = np.cumsum(np.log(logged.by_step(taken, 1.0)), axis=1)
        driven = np.stack(
            [
                np.cumsum(np.log(logged.by_step(one, 1.0)), axis=1)
                for one in behaviour[:, state, action]
            ]
        )
        mixed = np.logaddexp.reduce(driven + np.log(shares)[:, None, None], axis=0)
        # An episode has a probability under its own demonstrator, so `mixed` is finite.
        return np.exp(target - mixed)


def whole_episodes(
    ratio: Float[np.ndarray, "episode step"],
    rewards: Float[np.ndarray, "episode step signal"],
    counts: Float[np.ndarray, "resample episode"],
) -> Float[np.ndarray, "resample signal"]:
    """Return the self-normalised estimate by whole episodes; NaN without any weight.

    Args:
        ratio: ρ by episode and step.
        rewards: Rewards by episode and step, 0 beyond an end.
        counts: How often each episode is in each resample.
    """
    weight = counts * ratio[:, -1]
    with np.errstate(invalid="ignore"):
        return weight @ rewards.sum(axis=1) / weight.sum(axis=1, keepdims=True)


def step_by_step(
    ratio: Float[np.ndarray, "episode step"],
    rewards: Float[np.ndarray, "episode step signal"],
    counts: Float[np.ndarray, "resample episode"],
) -> Float[np.ndarray, "resample signal"]:
    """Return the self-normalised per-decision estimate; NaN without any weight.

    Args:
        ratio: ρ by episode and step.
        rewards: Rewards by episode and step, 0 beyond an end.
        counts: How often each episode is in each resample.
    """
    weighed = np.einsum("re,et,ets->rts", counts, ratio, rewards, optimize=True)
    with np.errstate(invalid="ignore"):
        return (weighed / (counts @ ratio)[:, :, None]).sum(axis=1)


def effective_episodes(ratio: Float[np.ndarray, "episode step"]) -> float:
    """Return (Σ ρ)² / Σ ρ²: how many episodes of the policy itself the weights are worth."""
    weight = ratio[:, -1]
    squares = float(np.square(weight).sum())
    return float(weight.sum()) ** 2 / squares if squares else 0.0
