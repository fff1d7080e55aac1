"""The squashed Gaussian: a = tanh(u) with u ~ N(mean, std²), a density on (-1, 1)^size.

Of Haarnoja et al. 2018 (soft actor-critic), appendix C. All functions take one row, sums run over
the numbers of an action.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Row = Float[Array, " size"]
Scalar = Float[Array, ""]

EDGE = 1e-3
"""Distance from a bound to which given actions are moved: at the bound itself the density is 0 or
infinite. Demonstrators that press a control to its end have many such actions."""


def squash_log_slope(u: Row) -> Row:
    """Return log(1 - tanh(u)²), the log-derivative of tanh, in a form that doesn't round to log 0.

    1 - tanh(u)² = 4 / (e^u + e^-u)², so its logarithm is 2 (log 2 - u - log(1 + e^-2u)).
    """
    return 2.0 * (math.log(2.0) - u - jax.nn.softplus(-2.0 * u))


def log_density_before(u: Row, mean: Row, log_std: Row) -> Scalar:
    """Return log π(tanh(u)) = Σ log N(u; mean, std²) - Σ log(1 - tanh(u)²) (their Eq 21)."""
    standardised = (u - mean) * jnp.exp(-log_std)
    gaussian = -0.5 * jnp.square(standardised) - log_std - 0.5 * math.log(2.0 * math.pi)
    return jnp.sum(gaussian - squash_log_slope(u))


def log_density(action: Row, mean: Row, log_std: Row) -> Scalar:
    """Return log π(a) of a given action, which is moved to at least `EDGE` from the bounds."""
    inside = jnp.clip(action, -1.0 + EDGE, 1.0 - EDGE)
    return log_density_before(jnp.arctanh(inside), mean, log_std)


def draw(noise: Row, mean: Row, log_std: Row) -> tuple[Row, Scalar]:
    """Return the action tanh(mean + std noise) and its log-density, both with gradients.

    Args:
        noise: Standard normal numbers.
        mean: Of u.
        log_std: Logarithm of the standard deviation of u.
    """
    u = mean + jnp.exp(log_std) * noise
    return jnp.tanh(u), log_density_before(u, mean, log_std)
