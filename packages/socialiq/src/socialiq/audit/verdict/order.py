"""Test whether a policy's episodes depend on their order, as those of a policy with a memory may.

The episodes are drawn by chance after the commitment, so that without a memory any order of them
is as likely as any other. Bounds of a mean are wrong where a policy drives well at first only: they
may decide before the rest counts.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.special import kolmogorov

from socialiq.audit.evidence.outcomes import Evidence

ORDER_ERROR = 0.001
"""Largest chance that a policy without a memory is found to depend on the order. It can't pass
then, so that the error of a wrong pass has no share of it."""


def order_dependence(evidence: Evidence) -> str:
    """Return that the policy's rewards depend on the order of the episodes; "" if none is found.

    Of each reward it is the largest sum of the first episodes' deviations from the mean, relative
    to the references' mean of the same episodes (CUSUM; Brown, Durbin and Evans 1975).
    """
    means = np.mean([reference.totals for reference in evidence.references], axis=0)
    chances = [order_chance(values) for values in (evidence.policy.totals - means).T]
    if min(chances) * len(chances) >= ORDER_ERROR:
        return ""
    return (
        "The policy's rewards depend on the order of the episodes, so it has a memory of earlier "
        "ones, and its mean says nothing about later ones."
    )


def order_chance(values: Float[np.ndarray, " episode"]) -> float:
    """Return the chance of a larger path than that of the values, if any order is as likely.

    The path of n values, divided by their deviation and √n, is close to a Brownian bridge, whose
    maximum has Kolmogorov's distribution; of few values it is smaller.
    """
    deviation = float(values.std())
    if deviation == 0.0:
        return 1.0
    path = np.cumsum(values - values.mean()) / (deviation * np.sqrt(len(values)))
    return float(kolmogorov(np.abs(path).max()))
