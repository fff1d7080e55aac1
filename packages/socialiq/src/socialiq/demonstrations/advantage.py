"""The advantage as a target: a table's rewards, shaped by its demonstrators' mean returns.

Two kinds, by how the mean return-to-go V of a state is found. `advantage` takes the mean over the
rows with the same observation, which is exact in worlds with a table of states. `advantage_fitted`
fits a small network, for observations that never repeat; each row's V comes from a network that
has not seen its episode, because a V that was fitted to a row's own return would cancel it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Int

from socialiq.nn.regression import cross_fitted
from socialiq.social.returns import advantage, mean_by_state
from socialiq.types import RewardPair

ADVANTAGE_KINDS = ("advantage", "advantage_fitted")


def advantages(
    kind: str,
    observation: Float32[np.ndarray, "transition feature"],
    rewards: RewardPair,
    to_go: RewardPair,
    episode: Int[np.ndarray, " transition"],
    discount: float,
) -> RewardPair:
    """Return A of both rewards, each by its own V, each (transition,), in units of reward.

    Args:
        kind: One of `ADVANTAGE_KINDS`.
        observation: s.
        rewards: (r_env, r_social).
        to_go: Their returns-to-go at the same discount.
        episode: Number of the episode, from 0 without gaps; its rows are adjacent and in order.
        discount: γ. The policy of the rewards themselves is kept if it is the learner's γ.

    Raises:
        UserError: If V cannot be estimated: no state occurs twice, or there is one episode.
    """
    values = _fitted if kind == "advantage_fitted" else _grouped
    found = values(observation, to_go, episode)
    return RewardPair(
        *(advantage(r, v, episode, discount) for r, v in zip(rewards, found, strict=True))
    )


def _grouped(
    observation: Float32[np.ndarray, "transition feature"],
    to_go: RewardPair,
    _episode: Int[np.ndarray, " transition"],
) -> RewardPair:
    return RewardPair(*(mean_by_state(observation, returns) for returns in to_go))


def _fitted(
    observation: Float32[np.ndarray, "transition feature"],
    to_go: RewardPair,
    episode: Int[np.ndarray, " transition"],
) -> RewardPair:
    both: Float[np.ndarray, "transition 2"] = np.stack(to_go, axis=1)
    return RewardPair(*cross_fitted(observation, both, episode).T)
