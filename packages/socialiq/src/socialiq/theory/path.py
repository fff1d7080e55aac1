"""Solutions along λ, and the strengths at which greedy actions change."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from socialiq.theory.objective import Problem
from socialiq.theory.response import Flip

_PRECISION = 1e-3  # of a flip's λ, relative

Table = Float[np.ndarray, "state action"]
QSolver = Callable[[Problem, Table | None], Table]
"""(problem, Q of a similar problem) -> Q; `minimise(...).q` or `semi_gradient.fixed_point`."""


def found_flips(problem: Problem, solve: QSolver, strengths: Sequence[float]) -> list[Flip]:
    """Return the least λ at which each state's greedy action differs from that at λ = 0.

    The first step of the range with another action is bisected to a relative width of 0.001. A flip
    and its reversal within one step are not detected.

    Args:
        problem: The problem; its own strength isn't used.
        solve: Finds Q.
        strengths: λ > 0, ascending.

    Returns:
        A flip for each state with two or more demonstrated actions, in ascending order of its
        strength, which is infinite if no change is found.
    """

    def q_at(strength: float, start: Table | None) -> Table:
        return solve(dataclasses.replace(problem, strength=strength), start)

    low, q = 0.0, q_at(0.0, None)
    lead = q.argmax(axis=1)
    waiting = [int(s) for s in np.flatnonzero(problem.support.sum(axis=1) > 1)]
    found: list[Flip] = []
    for high in map(float, strengths):
        if not waiting:
            break
        after = q_at(high, q)
        for state in [s for s in waiting if after[s].argmax() != lead[s]]:
            waiting.remove(state)
            found.append(_narrowed(q_at, state, int(lead[state]), (low, q), (high, after)))
        low, q = high, after
    found += [Flip(state, int(lead[state]), int(lead[state]), np.inf) for state in waiting]
    return sorted(found, key=lambda flip: flip.strength)


def first_flip(problem: Problem, solve: QSolver, strengths: Sequence[float]) -> float:
    """Return the least λ at which any greedy action differs from that at λ = 0.

    This is the least strength of `found_flips`, without bisecting the others.

    Args:
        problem: The problem; its own strength isn't used.
        solve: Finds Q.
        strengths: λ > 0, ascending.

    Returns:
        λ, infinite if no action changes in the range.
    """

    def q_at(strength: float, start: Table | None) -> Table:
        return solve(dataclasses.replace(problem, strength=strength), start)

    def before(q: Table) -> bool:
        return bool((q[choices].argmax(axis=1) == lead).all())

    choices = np.flatnonzero(problem.support.sum(axis=1) > 1)
    below = 0.0, q_at(0.0, None)
    lead = below[1][choices].argmax(axis=1)
    for strength in map(float, strengths):
        above = strength, q_at(strength, below[1])
        if not before(above[1]):
            return _halved(q_at, before, below, above)[1][0]
        below = above
    return float("inf")


def _narrowed(
    q_at: Callable[[float, Table | None], Table],
    state: int,
    lead: int,
    below: tuple[float, Table],
    above: tuple[float, Table],
) -> Flip:
    """Bisect an interval of λ at whose ends a state's greedy action differs."""
    _, above = _halved(q_at, lambda q: bool(q[state].argmax() == lead), below, above)
    return Flip(state, lead, int(above[1][state].argmax()), above[0])


def _halved(
    q_at: Callable[[float, Table | None], Table],
    before: Callable[[Table], bool],
    below: tuple[float, Table],
    above: tuple[float, Table],
) -> tuple[tuple[float, Table], tuple[float, Table]]:
    """Bisect an interval of λ, at whose lower end only `before` holds, to the precision."""
    while above[0] - below[0] > _PRECISION * above[0]:
        middle = (below[0] + above[0]) / 2.0
        q = q_at(middle, below[1])
        below, above = ((middle, q), above) if before(q) else (below, (middle, q))
    return below, above
