"""The words that every other room uses: reward pairs, endings of episodes, policies."""

from __future__ import annotations

import enum
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np


class RewardPair(NamedTuple):
    """The two rewards of a transition (thesis 4.1), always kept apart until they are scored.

    Either scalars or arrays of one common shape.

    Attributes:
        env: r_env, the ego's own progress (Eq 4.1).
        social: r_social, the ego's effect on its neighbours (Eq 4.2).
    """

    env: Any
    social: Any


class Ending(enum.IntEnum):
    """How a transition ended its episode.

    `TIMEOUT` is the world's clock, not a state: it is a truncation. The others are terminal
    states. `OTHER` is the terminal state of an environment that names no kind.
    """

    NONE = 0
    ARRIVAL = 1
    COLLISION = 2
    TIMEOUT = 3
    OTHER = 4


@runtime_checkable
class Policy(Protocol):
    """Anything that chooses actions, in the form of Stable-Baselines3's `predict`."""

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions for one observation, shape (features,), or a batch (batch, features)."""
        ...
