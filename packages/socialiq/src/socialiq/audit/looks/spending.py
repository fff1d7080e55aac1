"""Error spending: the share of the error of a verdict that each look may use."""

from __future__ import annotations

from typing import NamedTuple

from socialiq.errors import UserError

SMALLEST_ERROR = 1e-4
"""Smallest error of a look: at most 200,000 resamples give its quantile (`verdict.judge`)."""


class Spent(NamedTuple):
    """Error of one look.

    Attributes:
        look: Number of the look in its log, from 1.
        error: Largest chance of a wrong pass at this look, and of a wrong fail.
    """

    look: int
    error: float


def spend(error: float, look: int) -> Spent:
    """Return the error of a look: error / (k (k + 1)) at look k.

    1/(k (k + 1)) = 1/k - 1/(k + 1), so the shares of looks 1 to K add up to 1 - 1/(K + 1): never
    more than the whole, however many looks there are. Each look tests episodes whose seed came
    after all results before it, so it keeps its level whatever those were, and whatever decided
    that there is another look. By Boole's inequality the chance that any look of a log passes
    wrongly is therefore at most `error`. This is error spending (Lan and DeMets 1983) with a
    spending function for an unlimited number of looks.

    Args:
        error: Error of the whole log, 1 - confidence.
        look: Number of the look, from 1.
    """
    return Spent(look, error / (look * (look + 1)))


def check_spendable(spent: Spent) -> None:
    """Refuse a look whose error no number of resamples would resolve.

    Raises:
        UserError: If its error is too small.
    """
    if spent.error < SMALLEST_ERROR:
        raise UserError(
            f"look {spent.look} of this log could use an error of {spent.error:.2g} only, which is "
            f"too small to test with (at least {SMALLEST_ERROR:g}): agree with the auditor on a "
            "new log"
        )
