"""Transition rules of the 5x5 world: the ego goes or waits, the other drives unless blocked."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from socialiq.types import Ending
from socialiq.worlds.crossing5.options import Options

WAIT, GO = 0, 1
LAST = 4  # the far edge of the grid, where a road user has arrived
CONFLICT = 2  # both roads cross in cell (2, 2)
HORIZON = 20


class Move(NamedTuple):
    """Positions along the two roads before and after one simultaneous move."""

    ego: Any
    other: Any
    ego_after: Any
    other_after: Any


def move(ego: Any, other: Any, action: Any) -> Move:
    """Move both road users at once (thesis 5.1.1).

    The other holds for this step if its advance would put it into the conflict cell together with
    the ego's new position.
    """
    ego_after = jnp.minimum(ego + jnp.where(action == GO, 1, 0), LAST)
    wanted = jnp.minimum(other + 1, LAST)
    blocked = (wanted == CONFLICT) & (ego_after == CONFLICT)
    return Move(ego, other, ego_after, jnp.where(blocked, other, wanted))


def ending(moved: Move, options: Options) -> Any:
    """Return the kind of ending, 0 while the episode continues. The rules exclude collisions."""
    ego_there, other_there = moved.ego_after == LAST, moved.other_after == LAST
    over = {
        "ego_arrival": ego_there,
        "both_arrived": ego_there & other_there,
        "time_limit": jnp.zeros_like(ego_there),
    }[options.ends_on]
    return jnp.where(over, int(Ending.ARRIVAL), int(Ending.NONE))
