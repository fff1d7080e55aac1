"""Rewards of the 5x5 world as named signals (thesis 5.1.1)."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from socialiq.worlds.crossing5.options import Options
from socialiq.worlds.crossing5.rules import LAST, Move

ENV_WEIGHTS = {"step": -1.0, "arrival": 10.0}
SOCIAL_WEIGHTS = {"other_step": -1.0, "other_arrival": 10.0}


def signals(moved: Move, options: Options) -> dict[str, Any]:
    """Return the signals of a move, each 0 or 1: under way and arrived, for ego and other.

    `step` stops once the ego has arrived. This matters only if the episode continues after that.
    """
    under_way, other_under_way = moved.ego < LAST, moved.other < LAST
    arrival = under_way & (moved.ego_after == LAST)
    other_arrival = other_under_way & (moved.other_after == LAST)
    if options.arrival == "override":
        under_way, other_under_way = under_way & ~arrival, other_under_way & ~other_arrival
    if options.social_cost == "always":
        other_under_way = jnp.ones_like(other_under_way)
    flags = {
        "step": under_way,
        "arrival": arrival,
        "other_step": other_under_way,
        "other_arrival": other_arrival,
    }
    return {name: jnp.asarray(flag, jnp.float32) for name, flag in flags.items()}
