"""Theory for V(s') of a target network, through which no gradient passes, and for online training.

Online, half of term 2 sees the learner's own rows (value term `value`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.mdp.solve import evaluate_policy, soft_policy
from socialiq.mdp.tabular import StateActionArray, StateArray, TabularMDP
from socialiq.theory.demonstrators import visits_by_time
from socialiq.theory.minimise import Point, Support, Vector, minimise
from socialiq.theory.objective import Problem

_MAX_STEPS = 200


def demonstrated_policy(problem: Problem) -> StateActionArray:
    """Return π_E(a|s) = ρ_E(s, a) / ρ_E(s); 0 in states that are not demonstrated."""
    level = np.where(problem.support, problem.demonstrated, 0.0)
    total = level.sum(axis=1, keepdims=True)
    return level / np.where(total > 0.0, total, 1.0)


def pooled_advantage(problem: Problem) -> StateActionArray:
    """Return A(s, a) of the target under the demonstrators' pooled policy; 0 off the support."""
    policy = demonstrated_policy(problem)
    closed = np.where(policy.sum(axis=1, keepdims=True) > 0.0, policy, 1.0 / policy.shape[1])
    target = np.where(problem.support, problem.target, 0.0)
    value = evaluate_policy(problem.mdp, closed, target, problem.discount)
    return np.where(problem.support, value.q - value.v[:, None], 0.0)


def policy_slope(problem: Problem) -> StateActionArray:
    """Return dπ(a|s)/dλ = 2 w π_E A, valid until an action has probability 0, as τ → 0.

    With the gradient of V(s) alone the fixed point is r̂ = m + [1 - π / π_E] / (2κ). As τ → 0 the
    actions in use have Q = V, hence π = π_E [1 + 2κ (m + γ E V(s') - V(s))]. As π sums to 1
    in each state, V is the value of π_E on the reward m.
    """
    return 2.0 * problem.prior_weight * demonstrated_policy(problem) * pooled_advantage(problem)


def fixed_point(
    problem: Problem, start: StateActionArray | None = None, weight: StateArray | None = None
) -> StateActionArray:
    """Return the Q at which the semi-gradient of the offline objective is 0 (`value_expert`).

    r̂ = m + [1 - π / π_E] / (2κ) with π = softmax(Q / τ). Given V(s') each state has a monotone
    equation, and V is a γ-contraction, so the fixed point is unique. Newton's method finds it.

    Args:
        problem: The objective; only the shares of actions of its `demonstrated` matter.
        start: Q of a similar problem on the same support, from which the search begins; None begins
            with the demonstrators' policy.
        weight: Factor of π above, for each state: μ(s) / ρ_E(s), with μ(s) the share of s among the
            rows of term 2; None is 1.

    Returns:
        Q of each (state, action), -inf off the support.

    Raises:
        UserError: If Newton's method doesn't converge.
    """
    support = Support(problem)
    shares = support.weight / support.total(support.weight)
    if weight is not None:
        shares = shares / weight[support.states][support.state]

    def solve(q: Vector, temperature: float, tolerance: float) -> Point:
        return _newton(support, q, temperature, shares, tolerance)

    return support.table(support.follow(solve, start).q, -np.inf)


def _newton(
    support: Support, q: Vector, temperature: float, shares: Vector, tolerance: float
) -> Point:
    """Run Newton's method for the fixed point, halving steps that increase the residual."""
    twice = 2.0 * support.problem.curvature
    point = support.at(q, temperature)
    gap = (support.slope(point.reward) + point.pi / shares) / twice
    for _ in range(_MAX_STEPS):
        if np.abs(gap).max() <= tolerance:
            return point
        averages = support.averages(point.pi)
        spread = np.diag(point.pi) - averages.T @ averages
        matrix = np.eye(len(q)) - support.problem.discount * (support.flow @ averages)
        matrix += spread / (twice * temperature * shares)[:, None]
        direction = -np.linalg.solve(matrix, gap)
        size = 1.0
        while True:
            trial = support.at(point.q + size * direction, temperature)
            left = (support.slope(trial.reward) + trial.pi / shares) / twice
            if np.linalg.norm(left) < (1.0 - 1e-4 * size) * np.linalg.norm(gap) or size < 1e-9:
                break
            size /= 2.0
        point = trial
        gap = left
    raise UserError(
        f"the fixed point is still off by {np.abs(gap).max():.3g} after {_MAX_STEPS} steps at "
        f"temperature {temperature:g}: raise the temperature, or lower the strength"
    )


_ROUNDS = 200
_SETTLED = 1e-7  # largest change of a state's share of the replay's rows


class Replay(NamedTuple):
    """Learner's own rows, in expectation."""

    states: StateArray  # share of each state among the rows
    entry: StateArray  # weight of V(s) in the mean of V(s) - γ (1 - d) V(s') over the rows


def replayed(mdp: TabularMDP, policy: StateActionArray, horizon: int, discount: float) -> Replay:
    """Return uniformly drawn rows of a policy's episodes; a timeout is an end (`drawn_rows`).

    Args:
        mdp: The world in which the policy acts.
        policy: π(a|s).
        horizon: Steps after which an episode is cut off.
        discount: γ.

    Returns:
        The shares of states among the rows, and the weights of V in their mean.

    Raises:
        UserError: If the policy is not a distribution over the actions of this MDP.
    """
    times = visits_by_time(mdp, policy, horizon)
    total = times.sum()
    states = times.sum(axis=(0, 2)) / total
    going_on = times[:-1].sum(axis=0) / total
    return Replay(states, states - discount * mdp.arrivals(going_on))


def equilibrium(
    problem: Problem,
    mdp: TabularMDP,
    horizon: int,
    next_value: str,
    start: StateActionArray | None = None,
) -> StateActionArray:
    """Return the Q that solves the objective for the replay generated by its own policy.

    The iteration alternates Q for a replay and the replay for Q, mixed with the previous replay.
    The learner is assumed to act on the support only.

    Args:
        problem: The problem for rows (`theory.demonstrators`), of mass 1.
        mdp: The world in which the learner acts, without the rows' changes.
        horizon: Steps after which an episode is cut off.
        next_value: "online" if the gradient passes through V(s'), or "target" (target network) if
            it doesn't.
        start: Q of a similar problem; None begins with the minimum of `problem`.

    Returns:
        Q of each (state, action), -inf off the support.

    Raises:
        UserError: If `next_value` is unknown, or the iteration doesn't converge.
    """
    one_of("next value", next_value, ("online", "target"))
    demonstrated = problem.demonstrated.sum(axis=1)
    support = problem.support.any(axis=1, keepdims=True)
    q = start if start is not None else minimise(problem).q
    average: Replay | None = None
    for _ in range(_ROUNDS):
        # Uniform in states without demonstrations.
        policy = soft_policy(np.where(support, q, 0.0), problem.temperature)
        new = replayed(mdp, policy, horizon, problem.discount)
        previous = new if average is None else average
        settled = average is not None and np.abs(new.states - average.states).max() <= _SETTLED
        average = Replay(*((a + b) / 2.0 for a, b in zip(previous, new, strict=True)))
        if settled:
            return q
        if next_value == "online":
            q = minimise(problem, q, (problem.entry + average.entry) / 2.0).q
        else:
            level = np.where(demonstrated > 0.0, demonstrated, 1.0)
            q = fixed_point(problem, q, (1.0 + average.states / level) / 2.0)
    raise UserError(f"learner and replay don't settle in {_ROUNDS} turns: lower the strength")
