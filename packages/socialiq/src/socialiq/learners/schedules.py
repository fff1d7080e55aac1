"""Learning rates that fall over a run."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array


def linear(first: Any, last: Any, done: Array, updates: int) -> Array:
    """Return the rate of the update after `done` others; that of the last update is `last`."""
    return first + (done + 1) / updates * (last - first)


def cosine(first: Any, final_share: Any, done: Array, updates: int) -> Array:
    """Return the rate after so many updates; at the end it is a share of the first."""
    fallen = 0.5 * (1.0 + jnp.cos(jnp.pi * done / updates))
    return first * (final_share + (1.0 - final_share) * fallen)
