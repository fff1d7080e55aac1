"""The hidden skill: smooth driving that keeps the junction clear, as a reward h(s, a, s').

    h = - comfort |v' - v| / 4.5 m/s - clear [s' stands in the junction]

Neither r_env nor r_social speaks of it. It is told to those who demonstrate, and to nobody else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from socialiq.errors import UserError
from socialiq.learners.collect import Act, Source
from socialiq.learners.expert_table import Batch
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair
from socialiq.worlds.intersection.interface import FEATURES, POSITION_RANGE, SPEED_RANGE
from socialiq.worlds.intersection.policies import STOP_LINE

LEVEL = 4.5
"""m/s between two target speeds: a change of speed by so much costs `comfort`."""
STANDING = 1.0
"""m/s; who is slower stands."""


@dataclass(frozen=True)
class Skill:
    """What the parts of the skill are worth, in units of reward."""

    comfort: float = 1.0
    """Of a change of speed by one level within a decision."""
    clear: float = 1.0
    """Of a decision that ends with the ego standing in the junction."""

    def __post_init__(self) -> None:
        """Refuse what is no cost."""
        if not (0.0 <= self.comfort < np.inf and 0.0 <= self.clear < np.inf):
            raise UserError("comfort and clear are costs: give numbers of at least 0")

    def of(
        self,
        observation: Float[np.ndarray, "step feature"],
        following: Float[np.ndarray, "step feature"],
    ) -> Float[np.ndarray, " step"]:
        """h of each transition, at most 0.

        Args:
            observation: Where the ego decided.
            following: What was reached a decision later.
        """
        changed = np.abs(speed(following) - speed(observation)) / LEVEL
        return -self.comfort * changed - self.clear * stands_in_junction(following)


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


def told(source: Source, skill: Skill, angle: float) -> Source:
    """The same experience, its reward pair such that its score at the angle is R(α) + h.

    h is put along (cos α, sin α), which has length 1; a pair scored at another angle means nothing.
    """
    direction = exact_weights(angle)

    def source_with_skill(act: Act, rng: np.random.Generator) -> Batch:
        batch = source(act, rng)
        worth = skill.of(np.asarray(batch.observation), np.asarray(batch.next_observation))
        worth = worth.astype(np.float32)
        pair = RewardPair(
            batch.target.env + np.float32(direction.env) * worth,
            batch.target.social + np.float32(direction.social) * worth,
        )
        return batch._replace(target=pair)

    return source_with_skill
