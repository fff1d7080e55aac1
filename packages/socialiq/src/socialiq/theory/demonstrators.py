"""Several demonstrators pooled for one learner: occupancy and mean target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError, one_of
from socialiq.mdp.solve import discounted_occupancy, evaluate_policy
from socialiq.mdp.tabular import TabularMDP, check_reward

TARGET_KINDS = ("instantaneous", "to_go", "advantage", "own_advantage")


def occupancies(
    mdp: TabularMDP,
    policies: Sequence[Float[np.ndarray, "state action"]],
    shares: Sequence[float],
    discount: float,
) -> Float[np.ndarray, "demonstrator state action"]:
    """Return each demonstrator's part of ρ_E; the sum over demonstrators is ρ_E.

    Args:
        mdp: The dynamics.
        policies: Policy of each demonstrator.
        shares: Share of episodes of each demonstrator.
        discount: γ.

    Raises:
        UserError: If the shares are not a distribution over the demonstrators.
    """
    check_shares(shares, len(policies))
    pairs = zip(shares, policies, strict=True)
    return np.stack(
        [share * discounted_occupancy(mdp, policy, discount) for share, policy in pairs]
    )


def mean_target(
    mdp: TabularMDP,
    policies: Sequence[Float[np.ndarray, "state action"]],
    parts: Float[np.ndarray, "demonstrator state action"],
    reward: Float[np.ndarray, "state action"],
    kind: str,
    discount: float,
) -> Float[np.ndarray, "state action"]:
    """Return T̄(s, a), the mean of the prior's target over the rows of (s, a), reward.

    - instantaneous: R(s, a).
    - to_go: Σ_k p(k|s, a) Q_k(s, a), the returns-to-go of the demonstrators that take a in s.
    - advantage: R + γ E V(s') - V(s) with V of the pooled policy: a shaping of R.
    - own_advantage: Σ_k p(k|s, a) A_k(s, a), each against its own V. It is not a shaping of R,
      because p(k|s, a) depends on a. A deterministic demonstrator has A_k = 0 on its own actions.

    Args:
        mdp: The dynamics.
        policies: Policy of each demonstrator.
        parts: Result of `occupancies`; p(k|s, a) is a part's share at (s, a).
        reward: R(α) of Eq 4.3.
        kind: One of `TARGET_KINDS`.
        discount: γ, and γ_svo of the returns.

    Returns:
        T̄, 0 where no action is demonstrated, except for the kind instantaneous.

    Raises:
        UserError: If the kind is unknown, or no function of state and action.
    """
    check_kind(kind)
    check_reward(mdp, reward)
    if kind == "instantaneous":
        return reward
    whole = parts.sum(axis=0)
    seen = whole > 0.0
    if kind == "advantage":
        states = whole.sum(axis=1, keepdims=True)
        pooled = np.where(
            states > 0.0, whole / np.where(states > 0.0, states, 1.0), 1.0 / mdp.n_actions
        )
        known = evaluate_policy(mdp, pooled, reward, discount)
        return np.where(seen, known.q - known.v[:, None], 0.0)
    known = [evaluate_policy(mdp, policy, reward, discount) for policy in policies]
    own = [one.q if kind == "to_go" else one.q - one.v[:, None] for one in known]
    return np.where(seen, (parts * np.stack(own)).sum(axis=0) / np.where(seen, whole, 1.0), 0.0)


def check_kind(kind: str) -> None:
    """Raise an error for a target kind that is not covered by the formulas of this module.

    Raises:
        UserError: If the kind is unknown, or no function of state and action.
    """
    if kind in ("running", "trajectory"):
        raise UserError(
            f"target kind {kind} is not a function of state and action, so nothing is predicted: "
            f"choose one of {', '.join(TARGET_KINDS)}"
        )
    one_of("target kind", kind, TARGET_KINDS)


def check_shares(shares: Sequence[float], count: int) -> None:
    """Raise an error for shares that are not a distribution over the demonstrators.

    Raises:
        UserError: If their number, a sign or their sum is wrong.
    """
    if len(shares) != count or min(shares) < 0.0 or abs(sum(shares) - 1.0) > 1e-9:
        raise UserError(f"give one share for each of {count} demonstrators, 0 or more, of sum 1")
