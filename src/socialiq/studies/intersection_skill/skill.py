"""The hidden skill: smooth driving that keeps the junction clear, as a reward c h(s, a, s').

    h = - |v' - v| / 4.5 m/s - [the ego stands in the junction in s']

counts changes of speed, in levels between two target speeds, and decisions that end with the ego
in the way of others. Neither r_env nor r_social speaks of it. It is told to those who demonstrate,
and to no other method.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from socialiq.learners.collect import Act, Source
from socialiq.learners.expert_table import Batch
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair
from socialiq.worlds.intersection.policies import STOP_LINE
from socialiq.worlds.intersection.state import FEATURES, POSITION_RANGE, SPEED_RANGE

LEVEL = 4.5
"""m/s between two target speeds."""
STANDING = 1.0
"""m/s; who is slower stands."""


def skill(
    observation: Float[np.ndarray, "step feature"],
    following: Float[np.ndarray, "step feature"],
) -> Float[np.ndarray, " step"]:
    """The skill h of each transition, at most 0.

    Args:
        observation: Where the ego decided.
        following: What was reached a decision later.
    """
    return -levels_changed(observation, following) - stands_in_junction(following)


def levels_changed(
    observation: Float[np.ndarray, "step feature"],
    following: Float[np.ndarray, "step feature"],
) -> Float[np.ndarray, " step"]:
    """By how many levels the ego's speed changed, in either direction."""
    return np.abs(speed(following) - speed(observation)) / LEVEL


def speed(observation: Float[np.ndarray, "step feature"]) -> Float[np.ndarray, " step"]:
    """The ego's, in m/s."""
    across, along = FEATURES.index("vx"), FEATURES.index("vy")
    return np.hypot(observation[:, across], observation[:, along]) * SPEED_RANGE


def stands_in_junction(
    observation: Float[np.ndarray, "step feature"],
) -> Bool[np.ndarray, " step"]:
    """Whether the ego's centre is between the stop lines of all arms, and the ego stands."""
    columns = [FEATURES.index("x"), FEATURES.index("y")]
    inside = (np.abs(observation[:, columns]) * POSITION_RANGE < STOP_LINE).all(axis=1)
    return inside & (speed(observation) < STANDING)


def told(source: Source, weight: float, angle: float) -> Source:
    """The same experience, its reward pair such that its score at the angle is R(α) + c h.

    h is put along (cos α, sin α), which has length 1; a pair scored at another angle means nothing.

    Args:
        source: Of the experience.
        weight: The skill's, c.
        angle: In degrees.
    """
    direction = exact_weights(angle)

    def source_with_skill(act: Act, rng: np.random.Generator) -> Batch:
        batch = source(act, rng)
        h = skill(np.asarray(batch.observation), np.asarray(batch.next_observation))
        worth = (weight * h).astype(np.float32)
        pair = RewardPair(
            batch.target.env + np.float32(direction.env) * worth,
            batch.target.social + np.float32(direction.social) * worth,
        )
        return batch._replace(target=pair)

    return source_with_skill
