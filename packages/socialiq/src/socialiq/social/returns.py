"""Targets from the rewards of episodes: four variants of "cumulative returns", and advantages.

The thesis (5.3, 5.3.1) trains on cumulative discounted returns without saying from where to where
they accumulate, and its results depend on it (docs/reproduction/grid.md). Each variant is a
function (rewards of one episode, discount) -> targets, and `TARGET_KINDS` names them.

The advantage is A_t = r_t + γ V(s_{t+1}) - V(s_t), where V(s) is the mean return-to-go of the
demonstrators in s: potential-based shaping of the rewards (Ng, Harada and Russell 1999). V needs
all episodes that pass a state, so it is not a variant of the return of one episode.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int, Shaped
from scipy.signal import lfilter

from socialiq.errors import UserError, one_of

Rewards = Float[np.ndarray, " steps"]


def running(rewards: Rewards, discount: float) -> Rewards:
    """Return G_t = sum_{k<=t} γ^k r_k, the return since the start of the episode.

    Args:
        rewards: Rewards of one episode.
        discount: γ_svo.
    """
    return np.cumsum(discount ** np.arange(len(rewards)) * rewards)


def to_go(rewards: Rewards, discount: float) -> Rewards:
    """Return G_t = sum_{k>=t} γ^(k-t) r_k, the return-to-go.

    Args:
        rewards: Rewards of one episode.
        discount: γ_svo.
    """
    return np.asarray(lfilter([1.0], [1.0, -discount], rewards[::-1]))[::-1].copy()


def trajectory(rewards: Rewards, discount: float) -> Rewards:
    """Return G_t = sum_k γ^k r_k for every t, the return of the whole episode.

    Args:
        rewards: Rewards of one episode, at least one.
        discount: γ_svo.
    """
    return np.full(len(rewards), running(rewards, discount)[-1])


def instantaneous(rewards: Rewards, discount: float) -> Rewards:  # noqa: ARG001
    """Return G_t = r_t, not cumulative. It has the policies of the advantage (docs/theory.md).

    Args:
        rewards: Rewards of one episode.
        discount: Not used.
    """
    return np.array(rewards)


TARGET_KINDS: dict[str, Callable[[Rewards, float], Rewards]] = {
    "running": running,
    "to_go": to_go,
    "trajectory": trajectory,
    "instantaneous": instantaneous,
}


def cumulative(
    kind: str,
    rewards: Float[np.ndarray, " transitions"],
    episode: Int[np.ndarray, " transitions"],
    discount: float,
) -> Float[np.ndarray, " transitions"]:
    """Return the targets of one kind for every episode of a table of transitions.

    Args:
        kind: One of `TARGET_KINDS`.
        rewards: Reward of each transition.
        episode: Number of each transition's episode; its rows are adjacent and in order.
        discount: γ_svo.

    Raises:
        UserError: If the kind is unknown.
    """
    one_of("target kind", kind, tuple(TARGET_KINDS))
    starts = np.flatnonzero(np.diff(episode)) + 1
    pieces = np.split(np.asarray(rewards, np.float64), starts)
    return np.concatenate([TARGET_KINDS[kind](piece, discount) for piece in pieces])


Column = Float[np.ndarray, " transitions"]


def advantage(
    rewards: Column, value: Column, episode: Int[np.ndarray, " transitions"], discount: float
) -> Column:
    """Return A_t = r_t + γ V(s_{t+1}) - V(s_t), with V = 0 after an episode's last row.

    As for returns-to-go, V is 0 after every kind of ending.

    Args:
        rewards: Reward of each transition.
        value: V(s) of each transition.
        episode: Number of each transition's episode; its rows are adjacent and in order.
        discount: γ.
    """
    last = np.diff(episode, append=episode[-1:] + 1) != 0
    following = np.where(last, 0.0, np.roll(value, -1))
    return rewards + discount * following - value


def mean_by_state(
    observation: Shaped[np.ndarray, "transitions feature"], returns: Column
) -> Column:
    """Return V(s) of each transition: the mean return-to-go over equal observations.

    Args:
        observation: s of each transition.
        returns: Return-to-go of each transition.

    Raises:
        UserError: If no observation occurs twice: each V would be its own return, each A 0.
    """
    _, state = np.unique(observation, axis=0, return_inverse=True)
    counts = np.bincount(state)
    if counts.max() < 2:
        raise UserError(
            "no state occurs twice, so its mean return is one return: use the target kind "
            "advantage_fitted"
        )
    return (np.bincount(state, weights=returns) / counts)[state]
