"""The temporal-difference loss of deep Q-learning, one function per term."""

from __future__ import annotations

import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int

from socialiq.types import Ending

Scalar = Float[Array, ""]


def next_value(
    target_network: Float[Array, "batch action"], fast: Float[Array, "batch action"], double: bool
) -> Float[Array, " batch"]:
    """max_a Q(s', a) by the target network; "double" lets the network itself choose a.

    Args:
        target_network: Q(s', ·) of the target network (Mnih et al. 2015).
        fast: Q(s', ·) of the network (van Hasselt et al. 2016).
        double: Who chooses.
    """
    chosen = jnp.argmax(fast if double else target_network, axis=-1)
    return jnp.take_along_axis(target_network, chosen[:, None], axis=-1)[:, 0]


def bootstrapped_target(
    reward: Float[Array, " batch"],
    value: Float[Array, " batch"],
    ending: Int[Array, " batch"],
    discount: Scalar | float,
    through_timeouts: bool,
) -> Float[Array, " batch"]:
    """Y = R(α) + γ (1 - d) max_a Q(s', a).

    Args:
        reward: R(α) of each transition (Eq 4.3).
        value: Of the state reached.
        ending: Values of `types.Ending`.
        discount: γ.
        through_timeouts: Whether d = 0 at a timeout, which is the clock's doing, not a state.
    """
    goes_on = ending == int(Ending.NONE)
    if through_timeouts:
        goes_on |= ending == int(Ending.TIMEOUT)
    return reward + discount * jnp.where(goes_on, value, 0.0)


def td_loss(
    q: Float[Array, "batch action"], action: Int[Array, " batch"], target: Float[Array, " batch"]
) -> Scalar:
    """The mean Huber loss of Q(s, a) against the target (Mnih et al. 2015)."""
    taken = jnp.take_along_axis(q, action[:, None], axis=-1)[:, 0]
    return jnp.mean(optax.huber_loss(taken, target))
