"""Demonstrated pairs of a problem as one vector, for the solvers."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.theory.objective import Problem

_TOLERANCE = 1e-10  # of r̂, relative to the largest reward; rounding gives 1e-13
_ON_THE_WAY = 1e-6  # the same at intermediate temperatures
_SHRINK = 0.3  # factor between successive temperatures

Vector = Float[np.ndarray, " pair"]


class Point(NamedTuple):
    """Parts of the objective at one Q, over the support."""

    q: Vector
    v: Float[np.ndarray, " state"]
    pi: Vector
    reward: Vector
    loss: float


Solve = Callable[[Vector, float, float], Point]
"""(initial Q, temperature, tolerance of r̂) -> the solution at that temperature."""


class Support:
    """Demonstrated pairs as one vector, and the matrices between pairs and their states.

    The matrices are dense, which is faster for the few hundred demonstrated pairs.
    """

    def __init__(self, problem: Problem, entry: Float[np.ndarray, " state"] | None = None) -> None:
        mdp, demonstrated = problem.mdp, problem.support
        self.problem = problem
        self.pairs = np.flatnonzero(demonstrated.ravel())
        self.states = np.flatnonzero(demonstrated.any(axis=1))
        place = np.zeros(mdp.n_states, np.int64)
        place[self.states] = np.arange(len(self.states))
        self.state = place[self.pairs // mdp.n_actions]
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
        """Return the objective and its parts."""
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
        """Return ρ_π on the support."""
        chain = np.eye(len(self.states)) - self.problem.discount * (averages @ self.flow)
        return np.linalg.solve(chain.T, self.entry)[self.state] * pi

    def follow(self, solve: Solve, start: Float[np.ndarray, "state action"] | None) -> Point:
        """Solve at the problem's temperature, starting from the demonstrators' policy at 1 or more.

        V and the policy are kept between successive temperatures. A start skips this continuation.
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
            q, temperature = highest + cooler / temperature * (point.q - highest), cooler
        return solve(q, final, _TOLERANCE * self.scale)

    def table(self, values: Vector, elsewhere: float) -> Float[np.ndarray, "state action"]:
        """Return a vector over pairs as a table over all states and actions."""
        mdp = self.problem.mdp
        full = np.full(mdp.n_states * mdp.n_actions, elsewhere)
        full[self.pairs] = values
        return full.reshape(mdp.n_states, mdp.n_actions)

    def policy_table(self, pi: Vector) -> Float[np.ndarray, "state action"]:
        """Return a policy over all states, uniform in states without demonstrations."""
        policy = self.table(pi, 0.0)
        policy[policy.sum(axis=1) == 0.0] = 1.0 / policy.shape[1]
        return policy
