"""Bounds of the regret with a declared largest loss: they hold for any distribution within it.

The bootstrap of `regret` takes the sample for the distribution. A loss so rare that the sample
hardly shows it is then as good as impossible, whatever its size. With a declared largest loss the
bounds of `statistics.betting` count on it in every episode.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from socialiq.audit.verdict.decision import POWER
from socialiq.statistics.betting import (
    episodes_needed,
    levels,
    lower_bound_of_largest,
    upper_bounds,
)

_ROUNDING = 1e-9  # relative: a sum of rewards may exceed its limit by rounding errors


@dataclass(frozen=True)
class LossBounds:
    """Bounds of the regret by a declared largest loss.

    Attributes:
        low: Lower bound; the smallest gain, which says nothing, if a reference lost more than
            the declared loss against the policy.
        highs: Upper bound towards each reference; the largest loss, which says nothing, if the
            policy lost more than the declared loss against it.
    """

    low: float
    highs: Float[np.ndarray, " reference"]


def exceeds(loss: float, largest_loss: float) -> bool:
    """Whether the loss of an episode shows that a declared largest loss is false."""
    return loss > largest_loss * (1.0 + _ROUNDING)


def loss_bounds(
    losses: Float[np.ndarray, "reference episode"],
    compared: Bool[np.ndarray, " reference"],
    margin: float,
    largest_loss: float,
    pass_error: float,
    fail_error: float,
) -> LossBounds:
    """Bound the largest mean loss either way.

    The largest of the upper bounds has the error of one (`bootstrap.upper_bounds` says why).

    Args:
        losses: R(α) of each reference less the policy's, in the order in which the episodes were
            drawn.
        compared: References that the test uses.
        margin: Margin, reward per episode.
        largest_loss: Declared largest absolute value of a loss.
        pass_error: Error of each upper bound.
        fail_error: Error of the lower bound.
    """
    within = _without_rounding(losses, largest_loss)
    below = levels(margin, largest_loss)
    highs = upper_bounds(within, below, largest_loss, pass_error)
    above = levels(margin, largest_loss, between=True)
    low = lower_bound_of_largest(within[compared], above, largest_loss, fail_error)
    return LossBounds(
        low=low if np.isfinite(low) else float(losses[compared].min()),
        highs=np.where(np.isfinite(highs), highs, losses.max(axis=1)),
    )


def needed_with(
    losses: Float[np.ndarray, "reference episode"],
    compared: Bool[np.ndarray, " reference"],
    margin: float,
    largest_loss: float,
    error: float,
) -> int | None:
    """Return the number of episodes that would decide, if the losses so far are typical.

    A pass needs every reference's bound, a fail the best reference's.

    Args:
        losses: As for `loss_bounds`.
        compared: References that the test uses.
        margin: Margin, reward per episode.
        largest_loss: Declared largest absolute value of a loss.
        error: Error of the test that the estimate would decide.
    """
    rows = _without_rounding(losses, largest_loss)[compared]
    means = rows.mean(axis=1)
    if means.max() > margin:
        best = -rows[means.argmax()]
        return episodes_needed(best, -margin, largest_loss, error, POWER)
    needs = [episodes_needed(one, margin, largest_loss, error, POWER) for one in rows]
    known = [one for one in needs if one is not None]
    return max(known) if len(known) == len(needs) else None


def _without_rounding(
    losses: Float[np.ndarray, "reference episode"], largest_loss: float
) -> Float[np.ndarray, "reference episode"]:
    nearly = np.abs(losses) <= largest_loss * (1.0 + _ROUNDING)
    return np.where(nearly, losses.clip(-largest_loss, largest_loss), losses)
