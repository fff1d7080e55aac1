"""Where training online tends to: half of term 2 sees the learner's own rows (`value`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError, one_of
from socialiq.mdp.solve import soft_policy
from socialiq.mdp.tabular import TabularMDP
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem
from socialiq.theory.rows import visits_by_time
from socialiq.theory.semi_gradient import fixed_point

_ROUNDS = 200
_SETTLED = 1e-7  # change of a state's share of the replay's rows


class Replay(NamedTuple):
    """The learner's own rows, in expectation.

    Attributes:
        states: Share of each state among the rows.
        entry: What is left of Σ [V(s) - γ (1 - d) V(s')] over the rows, by state.
    """

    states: Float[np.ndarray, " state"]
    entry: Float[np.ndarray, " state"]


def replayed(
    mdp: TabularMDP, policy: Float[np.ndarray, "state action"], horizon: int, discount: float
) -> Replay:
    """Rows of a policy's episodes, evenly drawn; the clock's cut is an end, as in `theory.rows`."""
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
    start: Float[np.ndarray, "state action"] | None = None,
) -> Float[np.ndarray, "state action"]:
    """Q that solves the objective for the replay that its own policy fills.

    Solved in turns: Q for a replay, the replay for Q, each new one mixed with the last.

    Args:
        problem: The problem for rows (`theory.rows`), of mass 1.
        mdp: The world in which the learner acts, without the rows' changes.
        horizon: Largest number of steps of an episode.
        next_value: "online" passes the gradient through V(s'), "target" doesn't (a target network).
        start: Q of a similar problem on the same support.

    Returns:
        Q(s, a), -inf off the support; the learner is taken to act on the support only.

    Raises:
        UserError: If the turns don't settle.
    """
    one_of("next value", next_value, ("online", "target"))
    demonstrated = problem.demonstrated.sum(axis=1)
    q = start if start is not None else minimise(problem).q
    own: Replay | None = None
    for _ in range(_ROUNDS):
        new = replayed(mdp, _policy(q, problem), horizon, problem.discount)
        settled = own is not None and np.abs(new.states - own.states).max() <= _SETTLED
        own = (
            new if own is None else Replay(*((a + b) / 2.0 for a, b in zip(own, new, strict=True)))
        )
        if settled:
            return q
        if next_value == "online":
            q = minimise(problem, q, (problem.entry + own.entry) / 2.0).q
        else:
            seen = np.where(demonstrated > 0.0, demonstrated, 1.0)
            q = fixed_point(problem, q, (1.0 + own.states / seen) / 2.0)
    raise UserError(f"learner and replay don't settle in {_ROUNDS} turns: lower the strength")


def _policy(
    q: Float[np.ndarray, "state action"], problem: Problem
) -> Float[np.ndarray, "state action"]:
    """softmax(Q / τ), even where nothing is demonstrated."""
    known = problem.support.any(axis=1, keepdims=True)
    return soft_policy(np.where(known, q, 0.0), problem.temperature)
