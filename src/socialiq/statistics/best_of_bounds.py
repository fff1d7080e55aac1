"""Bounds of the largest of several means that were measured on the same episodes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.statistics.bootstrap import Studentised

_FIRST_STEP = 0.1  # share of the error spent on telling which references can matter
_HALVINGS = 40


def upper(found: Studentised, error: float) -> Float[np.ndarray, " reference"]:
    """One-sided upper bound of each mean by bootstrap-t.

    Their maximum bounds the largest mean at the same error, whatever the number of references
    and without a correction: that largest mean is one of these means, so it exceeds the maximum
    only if it exceeds its own bound. Seen as tests, "every reference is within the margin" is
    shown only if it is shown of each: an intersection-union test (Berger 1982), which is exact
    where one reference stands out and conservative where several tie.

    Args:
        found: Means with their bootstrap.
        error: Of each bound, one-sided.
    """
    low = np.quantile(found.resampled, error, axis=0)
    return found.mean - low * found.error


def exceeds(found: Studentised, limit: float, error: float) -> bool:
    """Whether the largest mean is shown to lie above a limit.

    Here one reference is enough, and the one that looks best was chosen by the data, so the
    error must be shared out. Bonferroni would divide it by the number of references, though most
    are correlated and many hopeless. Instead the critical value is the quantile of the largest of
    the bootstrapped t, in which each reference is lowered by how far its own mean must lie below
    the limit (Romano, Shaikh & Wolf 2014, two-step method; a tenth of the error goes to that
    first step). With one reference it is Student's one-sided test, but for that tenth.

    Args:
        found: Means with their bootstrap; all standard errors positive.
        limit: The largest value allowed.
        error: One-sided, of the whole.
    """
    highest = _highest(found, error)
    first = 0.0 if len(found.mean) == 1 else _FIRST_STEP
    if (highest < limit).all():
        return False
    lowered = np.minimum(highest - limit, 0.0) / found.error if first else np.zeros(1)
    largest = (found.resampled + lowered).max(axis=1)
    critical = max(0.0, float(np.quantile(largest, 1.0 - (1.0 - first) * error)))
    return bool(((found.mean - limit) / found.error).max() > critical)


def lower(found: Studentised, error: float) -> float:
    """One-sided lower bound of the largest mean: where `exceeds` changes, by bisection.

    Args:
        found: Means with their bootstrap; all standard errors positive.
        error: One-sided, of the whole.
    """
    high = float(found.mean.max())
    low = high - 50.0 * float(found.error.max())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if exceeds(found, middle, error) else (low, middle)
    return low


def _highest(found: Studentised, error: float) -> Float[np.ndarray, " reference"]:
    """What the means do not exceed, all at once, at a tenth of the error."""
    smallest = found.resampled.min(axis=1)
    return found.mean - float(np.quantile(smallest, _FIRST_STEP * error)) * found.error
