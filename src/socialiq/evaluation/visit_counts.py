"""Demonstrations counted by time, state and action of an enumerated world."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.worlds.enumerate import Table


def tally(
    data: Demonstrations, table: Table, values: Float[np.ndarray, " transition"] | None = None
) -> Float[np.ndarray, "time state action"]:
    """How often each action was taken at each time in each state, or sums of values there.

    Args:
        data: Demonstrations in the table's world, with or without its clock.
        table: The world or its reachable part.
        values: What to sum instead of ones.

    Raises:
        UserError: If a state is none of the table's, or an episode outlasts the horizon.
    """
    features = len(table.world.features)
    places = {state.tobytes(): number for number, state in enumerate(table.states)}
    states = data.observation[:, :features].astype(table.states.dtype)
    rows = np.array([places.get(state.tobytes(), -1) for state in states])
    if (rows < 0).any() or data.step.max() >= table.world.horizon:
        raise UserError(f"the demonstrations are not of {table.world.description}")
    found = np.zeros((table.world.horizon, table.mdp.n_states, table.mdp.n_actions))
    np.add.at(found, (data.step, rows, data.action), 1.0 if values is None else values)
    return found
