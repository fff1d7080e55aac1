"""Uniformly drawn rows of truncated episodes, as an occupancy of a modified MDP.

Batches draw rows without the discount, and the thesis' flag d treats a truncation as an end. The
shares of rows are not a discounted occupancy of the MDP. They are an occupancy of the MDP with two
changes. An episode may start in the state of any row, because V of every row's state counts in
term 2. A pair ends the episode with the probability with which episodes were truncated there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.mdp.tabular import TabularMDP, check_policy, check_reward
from socialiq.theory.demonstrators import check_kind, check_shares
from socialiq.theory.objective import entry_mass
from socialiq.types import Ending


class Drawn(NamedTuple):
    """Expected rows of several demonstrators' episodes.

    Attributes:
        mdp: The MDP of which `shares` is a discounted occupancy.
        shares: Share of each (state, action) among the rows; sums to 1.
        target: T̄, the mean target of these rows, reward; 0 where there are none.
    """

    mdp: TabularMDP
    shares: Float[np.ndarray, "state action"]
    target: Float[np.ndarray, "state action"]


def drawn_rows(
    mdp: TabularMDP,
    policies: Sequence[Float[np.ndarray, "state action"]],
    shares: Sequence[float],
    reward: Float[np.ndarray, "state action"],
    kind: str,
    horizon: int,
    discount: float,
) -> Drawn:
    """Return the rows of a data set with infinitely many episodes.

    Args:
        mdp: The dynamics.
        policies: Policy of each demonstrator.
        shares: Share of episodes of each demonstrator.
        reward: R(α) of Eq 4.3.
        kind: "instantaneous" or "to_go"; returns end at the truncation.
        horizon: Largest number of steps of an episode.
        discount: γ, and γ_svo of the returns.

    Raises:
        UserError: If an argument is invalid.
    """
    check_kind(kind)
    check_shares(shares, len(policies))
    check_reward(mdp, reward)
    if kind not in ("instantaneous", "to_go"):
        raise UserError(f"rows carry no target kind {kind}: choose instantaneous or to_go")
    visits = np.zeros(reward.shape)
    earned, cut = np.zeros(reward.shape), np.zeros(reward.shape)
    for share, policy in zip(shares, policies, strict=True):
        times = share * visits_by_time(mdp, policy, horizon)
        to_go = _to_go(mdp, policy, reward, horizon, discount)
        visits += times.sum(axis=0)
        earned += (times * to_go).sum(axis=0)
        cut += times[-1]
    seen = visits > 0.0
    known = np.where(seen, visits, 1.0)
    target = reward if kind == "instantaneous" else earned / known
    timed = with_cuts(mdp, cut / known)
    drawn = visits / visits.sum()
    entered = np.maximum(entry_mass(timed, drawn, discount), 0.0)  # rounding may give -1e-19
    timed = dataclasses.replace(timed, initial=entered / entered.sum())
    return Drawn(timed, drawn, np.where(seen, target, 0.0))


def with_cuts(mdp: TabularMDP, cut: Float[np.ndarray, "state action"]) -> TabularMDP:
    """Return the MDP in which every pair also ends the episode at random, as `Ending.OTHER`.

    Args:
        mdp: The dynamics.
        cut: Probability of a truncation after (s, a), whether the episode ended there or not.
    """
    ends = np.full_like(mdp.successor[..., :1], int(Ending.OTHER))
    return dataclasses.replace(
        mdp,
        successor=np.concatenate([mdp.successor, mdp.successor[..., :1]], axis=2),
        probability=np.concatenate(
            [mdp.probability * (1.0 - cut[..., None]), cut[..., None]], axis=2
        ),
        ending=np.concatenate([mdp.ending, ends], axis=2),
    )


def visits_by_time(
    mdp: TabularMDP, policy: Float[np.ndarray, "state action"], horizon: int
) -> Float[np.ndarray, "time state action"]:
    """Return the probability of (s, a) at each time."""
    check_policy(mdp, policy)
    times, running = [], mdp.initial
    for _ in range(horizon):
        times.append(running[:, None] * policy)
        running = mdp.arrivals(times[-1])
    return np.stack(times)


def _to_go(
    mdp: TabularMDP,
    policy: Float[np.ndarray, "state action"],
    reward: Float[np.ndarray, "state action"],
    horizon: int,
    discount: float,
) -> Float[np.ndarray, "time state action"]:
    """Return Q(s, a) at each time of an episode that is truncated at the horizon."""
    times, after = [], np.zeros(mdp.n_states)
    for _ in range(horizon):
        times.append(reward + discount * mdp.expected_next(after))
        after = (policy * times[-1]).sum(axis=1)
    return np.stack(times[::-1])
