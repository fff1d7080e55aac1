"""Minimum of the regularized objective, by Newton's method on Q of the demonstrated pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.mdp.tabular import StateActionArray, StateArray
from socialiq.theory.objective import Problem

_TOLERANCE = 1e-10  # of r̂, relative to the largest reward; rounding gives 1e-13
_ON_THE_WAY = 1e-6  # the same at intermediate temperatures
_SHRINK = 0.3  # factor between successive temperatures

Vector = Float[np.ndarray, " pair"]


class Point(NamedTuple):
    """Parts of the objective at one Q, over the support."""

    q: Vector
    v: StateArray
    pi: Vector
    reward: Vector
    loss: float


Solve = Callable[[Vector, float, float], Point]
"""(initial Q, temperature, tolerance of r̂) -> the solution at that temperature."""


class Support:
    """Demonstrated pairs as one vector, and the matrices between pairs and their states.

    The matrices are dense, which is faster for the few hundred demonstrated pairs.
    """

    def __init__(self, problem: Problem, entry: StateArray | None = None) -> None:
        mdp = problem.mdp
        demonstrated = problem.support
        self.problem = problem
        self.pairs = np.flatnonzero(demonstrated.ravel())
        self.states = np.flatnonzero(demonstrated.any(axis=1))
        index = np.zeros(mdp.n_states, np.int64)
        index[self.states] = np.arange(len(self.states))
        self.state = index[self.pairs // mdp.n_actions]
        self.first = np.flatnonzero(np.diff(self.state, prepend=-1))
        self.flow = mdp.flow[self.pairs][:, self.states].toarray()
        self.weight = problem.demonstrated.ravel()[self.pairs]
        self.goal = problem.strength * problem.target.ravel()[self.pairs]
        self.entry = (problem.entry if entry is None else entry)[self.states]
        self.scale = 1.0 + float(np.abs(self.goal).max())

    def total(self, values: Vector) -> Vector:
        """Return, for each pair, the sum over the pairs of its state."""
        return np.add.reduceat(values, self.first)[self.state]

    def slope(self, reward: Vector) -> Vector:
        """Return the derivative of the integrand -r + c r² + w (r - λ T̄)² by r."""
        problem = self.problem
        pulled = problem.prior_weight * (reward - self.goal)
        return 2.0 * (problem.chi2_coefficient * reward + pulled) - 1.0

    def at(self, q: Vector, temperature: float) -> Point:
        """Return the objective and its parts.

        Args:
            q: Q of each pair.
            temperature: τ of the soft value and of the policy, in units of reward.

        Returns:
            The point; V has one entry for each demonstrated state.
        """
        problem = self.problem
        highest = np.maximum.reduceat(q, self.first)
        powers = np.exp((q - highest[self.state]) / temperature)
        totals = np.add.reduceat(powers, self.first)
        v = highest + temperature * np.log(totals)
        reward = q - problem.discount * (self.flow @ v)
        quadratics = problem.chi2_coefficient * reward**2
        quadratics += problem.prior_weight * (reward - self.goal) ** 2
        loss = float(self.weight @ (quadratics - reward) + self.entry @ v)
        return Point(q, v, powers / totals[self.state], reward, loss)

    def averages(self, pi: Vector) -> Float[np.ndarray, "state pair"]:
        """Return Π, the policy's mean over the pairs of each state."""
        means = np.zeros((len(self.states), len(pi)))
        means[self.state, np.arange(len(pi))] = pi
        return means

    def occupancy(self, pi: Vector, averages: Float[np.ndarray, "state pair"]) -> Vector:
        """Return ρ_π on the support.

        Args:
            pi: π(a|s) of each pair.
            averages: Π of the same policy, the result of `averages`.

        Returns:
            ρ_π(s, a) of each pair, for episodes that enter the states by the weights `entry`.
        """
        chain = np.eye(len(self.states)) - self.problem.discount * (averages @ self.flow)
        return np.linalg.solve(chain.T, self.entry)[self.state] * pi

    def follow(self, solve: Solve, start: StateActionArray | None) -> Point:
        """Solve at the problem's temperature, starting from the demonstrators' policy at 1 or more.

        V and the policy are kept between successive temperatures.

        Args:
            solve: Solver of one temperature.
            start: Q of a similar problem, (state, action), which skips the higher temperatures;
                None begins with the demonstrators' policy.

        Returns:
            The solution at the problem's temperature.
        """
        final = self.problem.temperature
        if start is not None:
            return solve(start.ravel()[self.pairs], final, _TOLERANCE * self.scale)
        temperature = max(final, 1.0)
        q = temperature * np.log(self.weight / self.total(self.weight))
        while temperature > final:
            point = solve(q, temperature, _ON_THE_WAY * self.scale)
            cooler = max(final, _SHRINK * temperature)
            highest = point.v[self.state]
            q = highest + cooler / temperature * (point.q - highest)
            temperature = cooler
        return solve(q, final, _TOLERANCE * self.scale)

    def table(self, values: Vector, elsewhere: float) -> StateActionArray:
        """Return a vector over pairs as a table over all states and actions.

        Args:
            values: A number for each pair.
            elsewhere: The number of all pairs that are not demonstrated.

        Returns:
            The table, (state, action).
        """
        mdp = self.problem.mdp
        full = np.full(mdp.n_states * mdp.n_actions, elsewhere)
        full[self.pairs] = values
        return full.reshape(mdp.n_states, mdp.n_actions)

    def policy_table(self, pi: Vector) -> StateActionArray:
        """Return a policy over all states, uniform in states without demonstrations."""
        policy = self.table(pi, 0.0)
        policy[policy.sum(axis=1) == 0.0] = 1.0 / policy.shape[1]
        return policy


_ROUNDING = 1e-14  # of the loss, relative to its greatest terms
_MAX_STEPS = 200  # at one temperature; ten are typical
_SUFFICIENT = 1e-4  # share of the linear decrease that a step must achieve (Armijo)


@dataclass(frozen=True, eq=False)
class Minimum:
    """Minimum of the objective. Off the support Q and r̂ are -inf, π and ρ_π are 0."""

    q: StateActionArray  # Q(s, a)
    v: StateArray  # V(s), the soft value of the demonstrated actions; 0 if none is demonstrated
    reward: StateActionArray  # r̂(s, a) of Eq 2.6
    policy: StateActionArray  # π = softmax(Q / τ); uniform over all actions if none is demonstrated
    occupancy: StateActionArray  # ρ_π(s, a), with the scale of ρ_E
    loss: float  # the objective
    residual: float  # largest distance of r̂ from its closed form on the support; reward
    steps: int  # number of Newton steps


def minimise(
    problem: Problem, start: StateActionArray | None = None, entry: StateArray | None = None
) -> Minimum:
    """Return the minimum over all tables Q, with the gradient through every V.

    Only demonstrated actions are included: elsewhere the objective decreases without bound with Q.
    States without any are never reached, because demonstrated actions lead to demonstrated states
    only. The minimum is tracked from a temperature of 1 or more down to that of the problem.

    Args:
        problem: The objective, with its exact measures.
        start: Q of a similar problem on the same support, from which the search begins at the
            problem's temperature; None begins with the demonstrators' policy.
        entry: Weight of V(s) in term 2, for a mixture with replay; None is (1 - γ) p_0.

    Returns:
        The minimum, with its policy, its occupancy and the accuracy that was reached.

    Raises:
        UserError: If Newton's method doesn't converge.
    """
    support = Support(problem, entry)
    steps = 0
    residual = np.inf

    def solve(q: Vector, temperature: float, tolerance: float) -> Point:
        nonlocal steps, residual
        point, residual, taken = _newton(support, q, temperature, tolerance)
        steps += taken
        return point

    point = support.follow(solve, start)
    v = np.zeros(problem.mdp.n_states)
    v[support.states] = point.v
    occupancy = support.occupancy(point.pi, support.averages(point.pi))
    return Minimum(
        q=support.table(point.q, -np.inf),
        v=v,
        reward=support.table(point.reward, -np.inf),
        policy=support.policy_table(point.pi),
        occupancy=support.table(occupancy, 0.0),
        loss=point.loss,
        residual=residual,
        steps=steps,
    )


def _newton(
    support: Support, q: Vector, temperature: float, tolerance: float
) -> tuple[Point, float, int]:
    """Run Newton's method with a matrix that is positive everywhere and exact at the minimum.

    The second derivative of V(s) is weighted by the policy's occupancy of s. At the minimum that is
    its true weight; elsewhere the true weight may be negative, and the step would go uphill.
    """
    problem = support.problem
    point = support.at(q, temperature)
    residual = np.inf
    for step in range(_MAX_STEPS):
        averages = support.averages(point.pi)
        occupancy = support.occupancy(point.pi, averages)
        slope = support.slope(point.reward)
        gap = slope + occupancy / support.weight
        residual = float(np.abs(gap).max()) / (2.0 * problem.curvature)
        if residual <= tolerance:
            return point, residual, step
        pull = support.weight * slope
        through = support.entry - problem.discount * (support.flow.T @ pull)
        gradient = pull + through[support.state] * point.pi
        matrix = _curvature(support, averages, occupancy, temperature)
        scale = 1.0 / np.sqrt(support.weight)
        scaled = scale[:, None] * matrix * scale
        direction = -scale * np.linalg.solve(scaled, scale * gradient)
        point = _line_search(support, point, direction, float(gradient @ direction), temperature)
    raise UserError(
        f"the minimum is still off by {residual:.3g} after {_MAX_STEPS} steps at temperature "
        f"{temperature:g}: raise the temperature, or lower the strength"
    )


def _curvature(
    support: Support,
    averages: Float[np.ndarray, "state pair"],
    occupancy: Vector,
    temperature: float,
) -> Float[np.ndarray, "pair pair"]:
    """Return J' diag(2κ ρ_E) J + d(s)/τ (diag π - π π') with J = dr/dQ = 1 - γ F Π."""
    visited = support.total(occupancy)[support.first] / temperature
    jacobian = np.eye(len(occupancy)) - support.problem.discount * (support.flow @ averages)
    weight = 2.0 * support.problem.curvature * support.weight
    between = averages.T @ (visited[:, None] * averages)
    return jacobian.T @ (weight[:, None] * jacobian) + np.diag(occupancy / temperature) - between


def _line_search(
    support: Support, point: Point, direction: Vector, slope: float, temperature: float
) -> Point:
    """Halve the step until it decreases the loss, up to rounding."""
    size = 1.0
    rounding = _ROUNDING * support.weight.sum() * support.problem.curvature * support.scale**2
    while True:
        trial = support.at(point.q + size * direction, temperature)
        if trial.loss <= point.loss + _SUFFICIENT * size * slope + rounding or size < 1e-12:
            return trial
        size /= 2.0
