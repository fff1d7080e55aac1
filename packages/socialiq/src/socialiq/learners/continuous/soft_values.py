"""Equations of soft actor-critic (Haarnoja et al. 2018), one function each.

Of a policy π = squashed Gaussian and twin critics Q_1, Q_2; the score R(α) is the reward.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.actor import Actor, TwinCritics, draw

Scalar = Float[Array, ""]


class Drawn(NamedTuple):
    """Actions that a policy draws in each state.

    Attributes:
        action: Several for each state.
        log_density: log π of each.
    """

    action: Float[Array, "draw batch size"]
    log_density: Float[Array, "draw batch"]


def draw_actions(
    actor: Actor, seen: Float[Array, "batch input"], key: PRNGKeyArray, count: int
) -> Drawn:
    """Draw so many actions in each state, with gradients to the actor."""
    mean, log_std = jax.vmap(actor)(seen)
    noise = jax.random.normal(key, (count, *mean.shape))
    of_rows = jax.vmap(draw)
    return Drawn(*jax.vmap(of_rows, in_axes=(0, None, None))(noise, mean, log_std))


def drawn_values(
    critics: TwinCritics, seen: Float[Array, "batch input"], drawn: Drawn
) -> Float[Array, "draw batch 2"]:
    """Q_1 and Q_2 of drawn actions."""
    return jax.vmap(jax.vmap(critics), in_axes=(None, 0))(seen, drawn.action)


def soft_value(
    q: Float[Array, "draw batch"], drawn: Drawn, temperature: Scalar | float
) -> Float[Array, " batch"]:
    """V(s) = E_π[Q(s, a) - τ log π(a|s)], the mean over the drawn actions.

    At π = exp(Q/τ) / ∫ exp(Q/τ) it is τ log ∫ exp(Q/τ) da, Eq 2.5 with an integral for the sum.
    """
    return jnp.mean(q - temperature * drawn.log_density, axis=0)


def critic_loss(q: Float[Array, "batch 2"], target: Float[Array, " batch"]) -> Scalar:
    """Σ_i E[(Q_i(s, a) - y)²] / 2."""
    return jnp.mean(jnp.sum(jnp.square(q - target[:, None]), axis=-1)) / 2.0


def actor_loss(q: Float[Array, "draw batch"], drawn: Drawn, temperature: Scalar | float) -> Scalar:
    """E[τ log π(a|s) - Q(s, a)] of drawn actions, whose gradient runs through the action."""
    return -jnp.mean(soft_value(q, drawn, temperature))


def temperature_loss(log_temperature: Scalar, drawn: Drawn, entropy: Any) -> Scalar:
    """-log τ E[log π + H]: τ rises while the policy's entropy is below H, and falls above it."""
    gap = jax.lax.stop_gradient(jnp.mean(drawn.log_density) + entropy)
    return -log_temperature * gap
