"""Four readings of "cumulative returns" (thesis 5.3, 5.3.1): what G_env and G_social may mean.

The thesis trains on cumulative discounted returns without saying from where to where they
accumulate, and its results depend on it (docs/reproduction/grid.md). Each reading is a function
(rewards of one episode, discount) -> targets, and `TARGET_KINDS` names them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int
from scipy.signal import lfilter

from socialiq.errors import one_of

Rewards = Float[np.ndarray, " steps"]


def running(rewards: Rewards, discount: float) -> Rewards:
    """G_t = sum_{k<=t} γ^k r_k: what has been earned since the episode began."""
    return np.cumsum(discount ** np.arange(len(rewards)) * rewards)


def to_go(rewards: Rewards, discount: float) -> Rewards:
    """G_t = sum_{k>=t} γ^(k-t) r_k: what is still to be earned."""
    return np.asarray(lfilter([1.0], [1.0, -discount], rewards[::-1]))[::-1].copy()


def trajectory(rewards: Rewards, discount: float) -> Rewards:
    """G_t = sum_k γ^k r_k for every t: the whole episode's return on each of its transitions."""
    return np.full(len(rewards), running(rewards, discount)[-1])


def instantaneous(rewards: Rewards, discount: float) -> Rewards:  # noqa: ARG001
    """G_t = r_t: not cumulative. It gives the policies of the advantage (docs/theory.md)."""
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
    """Apply one reading to every episode of a table of transitions.

    Args:
        kind: One of `TARGET_KINDS`.
        rewards: r_env or r_social of each transition.
        episode: Episode number of each transition; an episode's rows are adjacent and in order.
        discount: γ_svo of Table C.1.

    Raises:
        UserError: If the kind is unknown.
    """
    one_of("target kind", kind, tuple(TARGET_KINDS))
    starts = np.flatnonzero(np.diff(episode)) + 1
    pieces = np.split(np.asarray(rewards, np.float64), starts)
    return np.concatenate([TARGET_KINDS[kind](piece, discount) for piece in pieces])
