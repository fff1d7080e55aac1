"""Discounted optimal policies, policy evaluation and occupancy of a finite MDP, exact."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Int
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu
from scipy.special import softmax

from socialiq.errors import UserError
from socialiq.mdp.tabular import (
    StateActionArray,
    StateArray,
    TabularMDP,
    check_discount,
    check_reward,
    closure,
)
from socialiq.types import Ending

# Least number of further sweeps for small values once the large values have converged.
_PATIENCE = 100
_TIED = 1e-12  # relative difference below which two actions tie


class Solution(NamedTuple):
    """Action values, state values, and their accuracy."""

    q: StateActionArray  # Q(s, a)
    v: StateArray  # V(s)
    sweeps: int  # number of Bellman sweeps; 0 if a linear system was solved instead
    residual: float  # largest change of V in the last sweep, or largest error of the linear system


def value_iteration(
    mdp: TabularMDP,
    reward: StateActionArray,
    discount: float,
    tolerance: float = 1e-12,
    max_sweeps: int = 100_000,
) -> Solution:
    """Solve V(s) = max_a [r(s, a) + γ E V(s')], the optimum of Eq 2.1 (thesis 5.2).

    Values of 1e-16, a residue of cos 90°, select the thesis' altruistic expert of the 5x5 world.
    Values that cancel to almost 0 may oscillate by a rounding error. They are ignored once the
    largest value has met the tolerance for half of all sweeps.

    Args:
        mdp: The MDP; its own rewards are not used.
        reward: r, (state, action), usually R(α) of Eq 4.3.
        discount: γ in [0, 1]; 1 only if the optimum is finite.
        tolerance: The sweeps stop where one changes each state's value by at most this, relative to
            it.
        max_sweeps: Largest number of sweeps.

    Raises:
        UserError: If the reward or the discount is invalid, or the sweeps do not converge.
    """
    check_reward(mdp, reward)
    check_discount(discount)
    # Action-major, because a maximum over the leading axis is many times as fast.
    rows = np.arange(reward.size).reshape(reward.shape).T
    flow = discount * mdp.flow[rows.ravel()]
    earned = np.ascontiguousarray(reward.T)
    v = np.zeros(mdp.n_states)
    residual = np.inf
    settled_sweeps = 0
    for sweep in range(1, max_sweeps + 1):
        q = earned + (flow @ v).reshape(earned.shape)
        previous = v
        v = q.max(axis=0)
        change = np.abs(v - previous)
        size = np.abs(v)
        residual = float(change.max())
        settled_sweeps += residual <= tolerance * size.max()
        given_up = settled_sweeps > max(_PATIENCE, sweep // 2)
        if given_up or (change <= tolerance * size).all():
            return Solution(np.ascontiguousarray(q.T), v, sweep, residual)
    raise UserError(
        f"values still move by {residual:.3g} after {max_sweeps} sweeps: "
        "lower the discount, or allow more sweeps"
    )


def evaluate_policy(
    mdp: TabularMDP,
    policy: StateActionArray,
    reward: StateActionArray,
    discount: float,
) -> Solution:
    """Return the value of a stationary policy, by one sparse linear system (Eq 2.1).

    V(s) = Σ_a π(a|s) Q(s, a), Q(s, a) = r(s, a) + γ E V(s').

    Args:
        mdp: The MDP; its own rewards are not used.
        policy: π, (state, action).
        reward: r, (state, action).
        discount: γ in [0, 1]; at 1 the policy must be able to end from every state.

    Raises:
        UserError: If an argument is invalid, or the undiscounted value is not finite.
    """
    check_reward(mdp, reward)
    check_discount(discount)
    chain = mdp.under(policy)
    if discount == 1.0:
        ends = (policy * (1.0 - mdp.ending_probability[:, :, Ending.NONE])).sum(axis=1) > 0.0
        if not closure(chain, ends).all():
            raise UserError("the policy never ends from some state: evaluate with a discount < 1")
    earned = (policy * reward).sum(axis=1)
    system = eye_array(mdp.n_states) - discount * chain
    v = splu(csc_array(system)).solve(earned)
    q = reward + discount * mdp.expected_next(v)
    return Solution(q, v, 0, float(np.abs(system @ v - earned).max()))


def soft_value(q: StateActionArray, temperature: float) -> StateArray:
    """Return V(s) = τ log Σ_a exp(Q(s, a) / τ) (Eq 2.5), without overflow.

    SciPy's logsumexp would take most of a sweep's time on small tables.

    Args:
        q: Q, (state, action).
        temperature: τ > 0, in units of the reward.
    """
    highest = q.max(axis=1)
    above = np.exp((q.T - highest) / temperature).sum(axis=0)
    return highest + temperature * np.log(above)


def greedy_policy(
    q: StateActionArray, prefer: Literal["first", "last"] = "first"
) -> StateActionArray:
    """Return the one-hot policy of the action of largest Q up to rounding.

    The tolerance is relative to the largest `|Q|` of the state alone, with no absolute part: at 90
    degrees values of 1e-16 select the 5x5 world's expert (docs/worlds/crossing5.md).

    Args:
        q: Q, (state, action).
        prefer: Whether the first or the last of tied actions is taken.
    """
    return np.eye(q.shape[1])[best_action(q, prefer)]


def best_action(
    q: StateActionArray, prefer: Literal["first", "last"] = "first"
) -> Int[np.ndarray, " state"]:
    """Return the index of the action that `greedy_policy` takes.

    Args:
        q: Q, (state, action).
        prefer: Whether the first or the last of tied actions is taken.
    """
    highest = q.max(axis=1, keepdims=True)
    tied = highest - q <= _TIED * np.abs(highest)
    if prefer == "first":
        return tied.argmax(axis=1)
    return q.shape[1] - 1 - tied[:, ::-1].argmax(axis=1)


def soft_policy(q: StateActionArray, temperature: float) -> StateActionArray:
    """Return π(a|s) = exp((Q(s, a) - V(s)) / τ), the optimal policy of Eq 2.5.

    Args:
        q: Q, (state, action).
        temperature: τ, in units of the reward.

    Raises:
        UserError: If the temperature is not positive.
    """
    check_temperature(temperature)
    return softmax(q / temperature, axis=1)


def bellman_reward(
    mdp: TabularMDP, q: StateActionArray, v: StateArray, discount: float
) -> StateActionArray:
    """Return r(s, a) = Q(s, a) - γ E V(s'), the inverse soft Bellman operator (Eq 2.6).

    Args:
        mdp: The MDP.
        q: Q, (state, action).
        v: V, (state,).
        discount: γ.
    """
    return q - discount * mdp.expected_next(v)


def check_temperature(temperature: float) -> None:
    """Refuse a temperature that is not positive and finite."""
    if not (np.isfinite(temperature) and temperature > 0.0):
        raise UserError(f"temperature {temperature:g} is not a positive number")


def discounted_occupancy(
    mdp: TabularMDP, policy: StateActionArray, discount: float
) -> StateActionArray:
    """Return ρ(s, a) = (1 - γ) Σ_t γ^t P(s_t = s, a_t = a) (thesis 2.2.2; Garg et al. 2021).

    The sum over states and actions is (1 - γ) times the expected discounted length of an episode:
    1 if episodes never end, less otherwise. For this measure
    E_ρ[V(s) - γ V(s')] = (1 - γ) E_p0[V(s_0)], with V(s') = 0 where the episode ends.

    Args:
        mdp: The MDP.
        policy: Action probabilities, (state, action).
        discount: γ in [0, 1).

    Raises:
        UserError: If the policy is not a distribution, or the discount is outside [0, 1).
    """
    if not 0.0 <= discount < 1.0:
        raise UserError(f"discount {discount:g} is outside [0, 1): an occupancy needs it below 1")
    system = eye_array(mdp.n_states) - discount * mdp.under(policy)
    states = splu(csc_array(system)).solve((1.0 - discount) * mdp.initial, trans="T")
    return states[:, None] * policy
