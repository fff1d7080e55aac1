"""Several demonstrators pooled for one learner: occupancy, mean target, and drawn rows.

Batches draw rows without the discount, and the thesis' flag d treats a truncation as an end. The
shares of rows are not a discounted occupancy of the MDP. They are an occupancy of the MDP with two
changes. An episode may start in the state of any row, because V of every row's state counts in
term 2. A pair ends the episode with the probability with which a truncation followed the pair.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError, one_of
from socialiq.mdp.solve import discounted_occupancy, evaluate_policy
from socialiq.mdp.tabular import StateActionArray, TabularMDP, check_policy, check_reward
from socialiq.theory.objective import entry_mass
from socialiq.types import Ending

TARGET_KINDS = ("instantaneous", "to_go", "advantage", "own_advantage")


def occupancies(
    mdp: TabularMDP, policies: Sequence[StateActionArray], shares: Sequence[float], discount: float
) -> Float[np.ndarray, "demonstrator state action"]:
    """Return each demonstrator's part of ρ_E, by its share of episodes; the sum is ρ_E.

    Args:
        mdp: The world of all demonstrators.
        policies: π_k(a|s) of each demonstrator.
        shares: Share of each demonstrator's episodes among all episodes.
        discount: γ in [0, 1).

    Returns:
        The parts, (demonstrator, state, action).

    Raises:
        UserError: If the shares are not a distribution over the demonstrators.
    """
    _check_shares(shares, len(policies))
    pairs = zip(shares, policies, strict=True)
    return np.stack(
        [share * discounted_occupancy(mdp, policy, discount) for share, policy in pairs]
    )


def mean_target(
    mdp: TabularMDP,
    policies: Sequence[StateActionArray],
    by_demonstrator: Float[np.ndarray, "demonstrator state action"],
    reward: StateActionArray,
    kind: str,
    discount: float,
) -> StateActionArray:
    """Return T̄(s, a), the mean of the prior's target over the rows of (s, a), reward.

    - instantaneous: R(s, a), R(α) of Eq 4.3.
    - to_go: Σ_k p(k|s, a) Q_k(s, a), the returns-to-go of the demonstrators that take a in s.
    - advantage: R + γ E V(s') - V(s) with V of the pooled policy: a shaping of R.
    - own_advantage: Σ_k p(k|s, a) A_k(s, a), each against its own V. It is not a shaping of R,
      because p(k|s, a) depends on a. A deterministic demonstrator has A_k = 0 on its own actions.

    p(k|s, a) is the share of demonstrator k at (s, a) of `by_demonstrator`.

    Args:
        mdp: The world of all demonstrators.
        policies: π_k(a|s) of each demonstrator.
        by_demonstrator: Parts of ρ_E, the result of `occupancies`.
        reward: R(α) of each (state, action).
        kind: One of `TARGET_KINDS`.
        discount: γ of the returns.

    Returns:
        T̄ of each (state, action). It is 0 where no action is demonstrated, except for the kind
        instantaneous.

    Raises:
        UserError: If the kind is unknown, or no function of state and action.
    """
    _check_kind(kind)
    check_reward(mdp, reward)
    if kind == "instantaneous":
        return reward
    level = by_demonstrator.sum(axis=0)
    demonstrated = level > 0.0
    if kind == "advantage":
        states = level.sum(axis=1, keepdims=True)
        pooled = np.where(
            states > 0.0, level / np.where(states > 0.0, states, 1.0), 1.0 / mdp.n_actions
        )
        values = evaluate_policy(mdp, pooled, reward, discount)
        return np.where(demonstrated, values.q - values.v[:, None], 0.0)
    values = [evaluate_policy(mdp, policy, reward, discount) for policy in policies]
    targets = [value.q if kind == "to_go" else value.q - value.v[:, None] for value in values]
    return np.where(
        demonstrated,
        (by_demonstrator * np.stack(targets)).sum(axis=0) / np.where(demonstrated, level, 1.0),
        0.0,
    )


def _check_kind(kind: str) -> None:
    """Refuse a target kind that is not covered by the formulas of this module."""
    if kind in ("running", "trajectory"):
        raise UserError(
            f"target kind {kind} is not a function of state and action, so nothing is predicted: "
            f"choose one of {', '.join(TARGET_KINDS)}"
        )
    one_of("target kind", kind, TARGET_KINDS)


def _check_shares(shares: Sequence[float], count: int) -> None:
    """Refuse shares that are not a distribution over the demonstrators."""
    if len(shares) != count or min(shares) < 0.0 or abs(sum(shares) - 1.0) > 1e-9:
        raise UserError(f"give one share for each of {count} demonstrators, 0 or more, of sum 1")


class Drawn(NamedTuple):
    """Expected rows of several demonstrators' episodes."""

    mdp: TabularMDP  # the MDP of which `shares` is a discounted occupancy
    shares: StateActionArray  # share of each (state, action) among the rows; sums to 1
    target: StateActionArray  # T̄, the mean target of these rows, reward; 0 where there are none


def drawn_rows(
    mdp: TabularMDP,
    policies: Sequence[StateActionArray],
    shares: Sequence[float],
    reward: StateActionArray,
    kind: str,
    horizon: int,
    discount: float,
) -> Drawn:
    """Return the rows of a data set with infinitely many episodes of at most `horizon` steps.

    Args:
        mdp: The world of all demonstrators.
        policies: π_k(a|s) of each demonstrator.
        shares: Share of each demonstrator's episodes among all episodes.
        reward: R(α) of Eq 4.3, of each (state, action).
        kind: "instantaneous" or "to_go", whose returns end at the truncation.
        horizon: Steps after which an episode is truncated.
        discount: γ of the returns, and of the occupancy.

    Returns:
        The shares of rows and their mean target, with the MDP of which the shares are an occupancy.

    Raises:
        UserError: If an argument is invalid.
    """
    _check_kind(kind)
    _check_shares(shares, len(policies))
    check_reward(mdp, reward)
    if kind not in ("instantaneous", "to_go"):
        raise UserError(f"rows carry no target kind {kind}: choose instantaneous or to_go")
    visits = np.zeros(reward.shape)
    earned = np.zeros(reward.shape)
    cut = np.zeros(reward.shape)
    for share, policy in zip(shares, policies, strict=True):
        times = share * visits_by_time(mdp, policy, horizon)
        to_go = []  # Q(s, a) from the last step back
        after = np.zeros(mdp.n_states)
        for _ in range(horizon):
            to_go.append(reward + discount * mdp.expected_next(after))
            after = (policy * to_go[-1]).sum(axis=1)
        visits += times.sum(axis=0)
        earned += (times * np.stack(to_go[::-1])).sum(axis=0)
        cut += times[-1]
    visited = visits > 0.0
    counts = np.where(visited, visits, 1.0)
    target = reward if kind == "instantaneous" else earned / counts
    timed = with_cuts(mdp, cut / counts)
    occupancy = visits / visits.sum()
    entered = np.maximum(entry_mass(timed, occupancy, discount), 0.0)  # rounding may give -1e-19
    timed = dataclasses.replace(timed, initial=entered / entered.sum())
    return Drawn(timed, occupancy, np.where(visited, target, 0.0))


def with_cuts(mdp: TabularMDP, cut: StateActionArray) -> TabularMDP:
    """Return the MDP in which every pair also ends the episode at random, as `Ending.OTHER`.

    Args:
        mdp: The MDP without truncations.
        cut: Probability of a truncation after (s, a), of each (state, action). It does not depend
            on whether the step would have ended the episode.

    Returns:
        An MDP with one more outcome for each (state, action).
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
    mdp: TabularMDP, policy: StateActionArray, horizon: int
) -> Float[np.ndarray, "time state action"]:
    """Return the probability of (s, a) at each time.

    Args:
        mdp: The world; its initial distribution is that of time 0.
        policy: π(a|s), the same at each time.
        horizon: Number of times.

    Returns:
        The probabilities, (time, state, action). Those of one time sum to the probability that the
        episode lasts until then.

    Raises:
        UserError: If the policy is not a distribution over the actions of this MDP.
    """
    check_policy(mdp, policy)
    times = []
    running = mdp.initial
    for _ in range(horizon):
        times.append(running[:, None] * policy)
        running = mdp.arrivals(times[-1])
    return np.stack(times)
