"""The social scoring function R(α) of Eq 4.3."""

from __future__ import annotations

from typing import Any

from socialiq.types import RewardPair


def score(weights: RewardPair, rewards: RewardPair) -> Any:
    """R(α) = cos α · r_env + sin α · r_social (Eq 4.3).

    Args:
        weights: (cos α, sin α), of `social.angle.weights`; scalars or traced arrays.
        rewards: The reward pair, or the pair of cumulative returns; any common shape.

    Returns:
        The score, of the rewards' shape.
    """
    return weights.env * rewards.env + weights.social * rewards.social
