"""Rewards of the 7x7 world as named signals (thesis 4.1 and 5.1.2)."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from socialiq.types import Ending
from socialiq.worlds.crossing7.options import Options
from socialiq.worlds.crossing7.rules import CONFLICT, FAST, STOP, Move, Vehicle

ENV_WEIGHTS = {"speed": 0.4, "step": -0.3, "arrival": 2.0, "collision": -5.0}
SOCIAL_WEIGHTS = {"yielding": 0.2, "disruption": -1.0, "neighbour_collision": -5.0}
FULL_STOP = 1.5  # speed levels that a forced complete stop counts for


def yielding(moved: Move, options: Options) -> Any:
    """Return (1 - v/v_max) times the approaching vehicles while the ego is in the influence zone.

    The zone is that of thesis 5.1.2. A vehicle approaches if it is on the road south of the
    conflict cell before the step.
    """
    holds_back = (moved.ego == CONFLICT - 1) & (moved.ego_after < CONFLICT)
    if options.yield_zone == "with_conflict":
        near = (moved.ego == CONFLICT - 1) | (moved.ego == CONFLICT)
        holds_back = near & (moved.ego_after <= CONFLICT)
    approaching = sum(
        jnp.where((vehicle.y >= 0) & (vehicle.y < CONFLICT), 1.0, 0.0) for vehicle in moved.vehicles
    )
    slowness = 1.0 - moved.action / FAST
    if options.slow_yield == "full":
        slowness = jnp.where(moved.action < FAST, 1.0, 0.0)
    return jnp.where(holds_back, slowness * approaching, 0.0)


def levels_lost(before: Vehicle, after: Vehicle, options: Options) -> Any:
    """Return the speed levels a vehicle was forced to lose; a full stop counts as FULL_STOP."""
    levels = jnp.maximum(before.v - after.v, 0).astype(jnp.float32)
    stopped = (levels > 0) & (after.v == STOP)
    charge = FULL_STOP if options.full_stop == "flat" else jnp.maximum(levels, FULL_STOP)
    return jnp.where(stopped, charge, levels)


def signals(moved: Move, ending: Any, options: Options) -> dict[str, Any]:
    """Return all signals. With `arrival="override"` speed and step are 0 at a terminal step."""
    arrived = ending == Ending.ARRIVAL
    struck = ending == Ending.COLLISION
    counts = ~struck if options.arrival == "added" else ~(struck | arrived)
    running = jnp.asarray(counts, jnp.float32)
    pairs = zip(moved.vehicles, moved.vehicles_after, strict=True)
    return {
        "speed": running * moved.action / FAST,
        "step": running,
        "arrival": jnp.asarray(arrived, jnp.float32),
        "collision": jnp.asarray(struck, jnp.float32),
        "yielding": yielding(moved, options),
        "disruption": sum(levels_lost(before, after, options) for before, after in pairs),
        "neighbour_collision": jnp.asarray(struck, jnp.float32),
    }
