"""The seeds of an audit's episodes, all from the one that the auditor draws."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int64

from socialiq.errors import UserError

_AUDIT = 7212  # what is drawn by a seed for this purpose is independent of all else drawn by it
FEWEST_EPISODES = 20
"""Below, no bound of the audit says anything."""

MOST_EPISODES = 1_000_000


def episode_seeds(seed: int, episodes: int) -> Int64[np.ndarray, " episode"]:
    """Draw the seeds of the episodes, spread over all that a world can take.

    They are not 0, 1, 2, ...: a policy that was tuned to those meets other episodes here.

    Args:
        seed: The auditor's, drawn after policy and profile were fixed.
        episodes: How many.

    Raises:
        UserError: If the seed is negative, or the number of episodes is none that can be played.
    """
    if seed < 0:
        raise UserError(f"seed must be at least 0, got {seed}")
    check_episodes(episodes)
    rng = np.random.default_rng([_AUDIT, seed])
    drawn = np.unique(rng.integers(2**62, size=episodes + 16))  # so many that none need repeat
    return rng.permutation(drawn)[:episodes]


def check_episodes(episodes: int) -> None:
    """Refuse a number of episodes that no audit has.

    Raises:
        UserError: If it is too small or too large.
    """
    if not FEWEST_EPISODES <= episodes <= MOST_EPISODES:
        raise UserError(
            f"episodes must be from {FEWEST_EPISODES} to {MOST_EPISODES}, got {episodes}"
        )
