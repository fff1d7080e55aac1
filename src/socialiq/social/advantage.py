"""Advantages of a recording: rewards with the change in the demonstrators' own value added.

A_t = r_t + γ V(s_{t+1}) - V(s_t), where V(s) is the mean return-to-go of the demonstrators in s.
It is potential-based shaping of the rewards (Ng, Harada and Russell 1999) by what the
demonstrators get from there on, and says how much better a step turned out than usual. V is no
reading of one episode, as those of `social.returns` are: it needs all episodes that pass a state.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, Shaped

from socialiq.errors import UserError

Column = Float[np.ndarray, " transitions"]


def advantage(
    rewards: Column, value: Column, episode: Int[np.ndarray, " transitions"], discount: float
) -> Column:
    """A_t = r_t + γ V(s_{t+1}) - V(s_t), with V = 0 after an episode's last row.

    The same end as that of returns-to-go: whatever ended the episode, nothing follows.

    Args:
        rewards: r_env or r_social of each transition, in units of reward.
        value: V(s) of each transition's state, in the same units.
        episode: Episode number of each transition; an episode's rows are adjacent and in order.
        discount: γ.
    """
    last = np.diff(episode, append=episode[-1:] + 1) != 0
    following = np.where(last, 0.0, np.roll(value, -1))
    return rewards + discount * following - value


def mean_by_state(
    observation: Shaped[np.ndarray, "transitions feature"], returns: Column
) -> Column:
    """V(s) of each transition: the mean of `returns` over all transitions with its observation.

    Args:
        observation: s; states are one if their observations are equal in every number.
        returns: Returns-to-go of one reward, in units of reward.

    Raises:
        UserError: If no observation is there twice: each V would be its own return, each A 0.
    """
    _, state = np.unique(observation, axis=0, return_inverse=True)
    counts = np.bincount(state)
    if counts.max() < 2:
        raise UserError(
            "no state is there twice, so its mean return is one return: use the target kind "
            "advantage_fitted"
        )
    return (np.bincount(state, weights=returns) / counts)[state]
