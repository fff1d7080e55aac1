"""CartPole-v1 as a world that compiled programs can step, for learners that act in it.

Equations of motion of Barto, Sutton and Anderson (1983) with Gymnasium's constants, Euler steps and
limits; a test compares it with Gymnasium's environment step by step. Policies are evaluated there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from socialiq.types import Ending, RewardPair, Step

GRAVITY, CART, POLE, HALF_LENGTH = 9.8, 1.0, 0.1, 0.5
"""m/s², kg, kg, m."""
FORCE, SECONDS = 10.0, 0.02
TRACK, LEAN = 2.4, 0.2094395
"""Largest |x| in m and |θ| in radians (12 degrees) of an episode that goes on."""
STEPS = 500


class Episode(NamedTuple):
    """State (x, x', θ, θ') and number of steps taken."""

    state: Float[Array, " state"]
    steps: Int[Array, ""]


def moved(state: Float[Array, " state"], action: Int[Array, ""]) -> Float[Array, " state"]:
    """Return the state after one Euler step under a push to the left (0) or right (1)."""
    _, x_speed, angle, turning = state
    force = jnp.where(action == 1, FORCE, -FORCE)
    total = CART + POLE
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    pushed = (force + POLE * HALF_LENGTH * jnp.square(turning) * sine) / total
    inertia = HALF_LENGTH * (4.0 / 3.0 - POLE * jnp.square(cosine) / total)
    turn_rate = (GRAVITY * sine - cosine * pushed) / inertia
    x_rate = pushed - POLE * HALF_LENGTH * turn_rate * cosine / total
    return state + SECONDS * jnp.stack([x_speed, x_rate, turning, turn_rate])


class CartPole:
    """CartPole-v1 with the interface of `types.Simulator`; r_env is 1 a step, r_social 0."""

    n_actions = 2
    n_features = 4
    description = "CartPole-v1, compiled"

    def reset(self, key: PRNGKeyArray) -> tuple[Episode, Float[Array, " state"]]:
        """Start an episode near the upright state."""
        state = jax.random.uniform(key, (4,), minval=-0.05, maxval=0.05)
        return Episode(state, jnp.zeros((), jnp.int32)), state

    def advance(
        self,
        key: Any,  # noqa: ARG002
        episode: Episode,
        action: Int[Array, ""],
    ) -> tuple[Episode, Step]:
        """Take one step; falling and leaving the track end in `OTHER`, the clock in `TIMEOUT`."""
        state, steps = moved(episode.state, action), episode.steps + 1
        lost = (jnp.abs(state[0]) > TRACK) | (jnp.abs(state[2]) > LEAN)
        late = jnp.where(steps >= STEPS, int(Ending.TIMEOUT), int(Ending.NONE))
        ending = jnp.where(lost, int(Ending.OTHER), late).astype(jnp.int32)
        return Episode(state, steps), Step(state, RewardPair(jnp.ones(()), jnp.zeros(())), ending)
