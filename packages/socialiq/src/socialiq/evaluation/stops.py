"""Stops of policies in the 7x7 world, by the places of both vehicles (thesis Figs 6.3, 6.4)."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from socialiq.mdp.horizon import horizon_evaluation

if TYPE_CHECKING:
    from socialiq.types import Row
    from socialiq.worlds.enumerate import Table

BEFORE = 2
"""Cell of the ego before the conflict."""
STOP = 0  # number of the action


def visited(
    part: Table, chances: Float[np.ndarray, "*time state action"]
) -> tuple[Float[np.ndarray, "state action"], Float[np.ndarray, " state"]]:
    """Return a policy's action probabilities by state, and its expected visits of an episode.

    Args:
        part: Reachable part of the world.
        chances: Action probabilities, also by time; these become means over the policy's visits,
            or over all times in a state that it never visits.
    """
    by_action = horizon_evaluation(part.mdp, chances, part.world.horizon).visits
    visits = by_action.sum(axis=1)
    if chances.ndim == 2:
        return chances, visits
    of_state = np.where(visits > 0, visits, 1.0)[:, None]
    return np.where(visits[:, None] > 0, by_action / of_state, chances.mean(axis=0)), visits


def stop_rows(
    part: Table,
    name: str,
    chances: Float[np.ndarray, "state action"],
    visits: Float[np.ndarray, " state"],
) -> list[Row]:
    """Return P(STOP) in the cell before the conflict by the vehicles' places.

    Args:
        part: Reachable part of the 7x7 world.
        name: Name of the policy.
        chances: Its action probabilities.
        visits: Its visits of each state.

    Returns:
        A row for each pair of places: `weighted` by the policy's visits, empty without;
        `unweighted` over all reachable states.
    """
    states = part.states
    rows: list[Row] = []
    for y_1, y_2 in itertools.product(range(-1, 7), repeat=2):
        chosen = (states[:, 0] == BEFORE) & (states[:, 2] == y_1) & (states[:, 4] == y_2)
        if chosen.any():
            weight = float(visits[chosen].sum())
            stop = chances[chosen, STOP]
            weighted = float(visits[chosen] @ stop) / weight if weight > 1e-9 else ""
            label = {"policy": name, "y_1": y_1, "y_2": y_2, "visits": weight}
            rows.append(label | {"weighted": weighted, "unweighted": float(stop.mean())})
    return rows
