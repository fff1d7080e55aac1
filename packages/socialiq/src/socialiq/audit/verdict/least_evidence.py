"""Least number of independent units from which a recorded driver is judged."""

from __future__ import annotations

from socialiq.audit.verdict.decision import POWER

SHARE = 0.9
"""Share of a driver's units beyond the margin that the least evidence must be able to find."""

_MOST = 10_000


def least_units(error: float, share: float = SHARE, power: float = POWER) -> int:
    """Return the number of units with which a sign test finds a driver that is beyond the margin.

    The sign test assumes nothing about the distribution: if the driver's angle is within the
    margin, each unit is beyond one of its ends with a chance of at most 1/2 (as a median is). It
    finds the driver beyond that end if so many units are that fewer than error / 2 of such drivers
    have as many. The number returned is the smallest with which this happens with a chance of
    `power` to a driver with `share` of its units beyond. Fewer units decide nothing, however equal
    they are.

    Args:
        error: Error of both ends together.
        share: Chance that a unit of the driver to be found is beyond the end.
        power: Chance that it is found.
    """
    from scipy.stats import binom

    for units in range(1, _MOST):
        critical = int(binom.isf(error / 2, units, 0.5)) + 1  # P(X >= critical) <= error / 2
        if binom.sf(critical - 1, units, share) >= power:
            return units
    return _MOST
