"""The concave functions φ of IQ-Learn's statistical divergences, and their slopes φ'.

IQ-Learn maximises E_E[φ(r̂)], where φ(x) = -f*(-x) for the convex conjugate f* of the generator f
of an f-divergence (Garg et al., NeurIPS 2021, section 4 and appendix). Three of the φ are defined
on a half line only. Below `floor` they are continued by their tangent, which keeps them concave
and every slope finite; a reward above the floor never notices.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp


class Divergence(NamedTuple):
    """One divergence.

    Attributes:
        phi: φ, on rewards above the floor.
        slope: φ', on rewards above the floor.
        floor: Where the tangent takes over; None if φ is defined everywhere.
    """

    phi: Callable[[Any], Any]
    slope: Callable[[Any], Any]
    floor: float | None


DIVERGENCES: dict[str, Divergence] = {
    # χ²: the linear part; its quadratic part is term 3 of Eq 2.7.
    "chi2": Divergence(lambda x: x, jnp.ones_like, None),
    "kl": Divergence(lambda x: -jnp.exp(-x - 1), lambda x: jnp.exp(-x - 1), -10.0),
    "reverse_kl": Divergence(lambda x: 1 + jnp.log(x), lambda x: 1 / x, 0.1),
    "hellinger": Divergence(lambda x: x / (1 + x), lambda x: 1 / (1 + x) ** 2, -0.9),
    "js": Divergence(lambda x: jnp.log(2 - jnp.exp(-x)), lambda x: 1 / (2 * jnp.exp(x) - 1), -0.6),
}


def phi(name: str | Divergence, reward: Any) -> Any:
    """φ(r̂), continued by its tangent below the floor."""
    divergence = DIVERGENCES[name] if isinstance(name, str) else name
    if divergence.floor is None:
        return divergence.phi(reward)
    inside = jnp.maximum(reward, divergence.floor)
    return divergence.phi(inside) + divergence.slope(inside) * (reward - inside)


def phi_slope(name: str | Divergence, reward: Any) -> Any:
    """φ'(r̂): the weight of an expert transition in term 1 of Eq 2.7."""
    divergence = DIVERGENCES[name] if isinstance(name, str) else name
    if divergence.floor is None:
        return divergence.slope(reward)
    return divergence.slope(jnp.maximum(reward, divergence.floor))
