"""Verdicts on claims of one number: what counts as the same number.

A printed number without a spread is the same as ours within half a unit of its last digit, within
one unit where the thesis says "about". A printed "mean +- standard deviation" is a mean of single
episodes or of evaluation seeds, and the standard deviation of these is no tolerance: a difference
of means is compared with standard errors. So a wide spread of episodes can't hide a difference,
and a mean of ours that is known too badly to be compared is not called reproduced.
"""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from socialiq.errors import UserError, one_of

SPREADS = {"episodes": 0, "seeds": 5}
"""Printed standard deviations: the number of means they are over, 0 where the thesis has none."""
ERRORS = 2.0
"""Standard errors that a difference of means may have: about 95 % of them have no more."""
NEGLIGIBLE = 0.2
"""Difference of means, in standard deviations of episodes, that appendix A.2 calls negligible."""
NEARLY = 0.05
"""Tolerance where the thesis says "nearly"."""

_PRINTED = re.compile(r"[+-]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


class Printed(NamedTuple):
    """A number as the thesis prints it.

    Attributes:
        value: The number.
        digit: One unit of its last printed digit.
        spread: Printed standard deviation; None without.
        over: What the spread is over: `SPREADS`; "" without.
    """

    value: float
    digit: float
    spread: float | None = None
    over: str = ""


class Ours(NamedTuple):
    """Our number: a mean, the standard deviation of what it is the mean of, and their number."""

    value: float
    spread: float = 0.0
    number: float = 1.0

    @property
    def error(self) -> float:
        """Return the standard error of the mean; infinite over less than one."""
        return self.spread / math.sqrt(self.number) if self.number >= 1 else math.inf


def printed(claim: dict[str, Any]) -> Printed:
    """Return the number of a claim of the ledger, with the accuracy of its digits.

    Raises:
        UserError: If a claim names a tolerance wider than the digits allow: a spread of episodes
            or seeds, which hardly any value of ours could fail.
    """
    value, spread, over = claim["value"], claim.get("spread"), claim.get("spread_of", "")
    digit = _digit(claim["thesis"], value)
    if spread is None:
        allowed = digit if "about" in claim["statement"] else digit / 2
        allowed = NEARLY if "nearly" in claim["thesis"] else allowed
        if claim["tolerance"] > allowed * (1 + 1e-9):
            raise UserError(
                f"{claim['id']}: tolerance {claim['tolerance']:g} for a number printed to "
                f"{digit:g}: give half a unit of its last digit, one after 'about'; a printed +- "
                "is no tolerance but a `spread`"
            )
        return Printed(value, digit)
    one_of(f"{claim['id']}: spread_of", over, tuple(SPREADS))
    if "tolerance" in claim:
        raise UserError(f"{claim['id']}: a spread of {over} is no tolerance: leave `tolerance` out")
    return Printed(value, digit, spread, over)


def tolerance(thesis: Printed, ours: Ours) -> float:
    """Return the difference of two means that their standard errors and rounding explain."""
    count = SPREADS[thesis.over]
    error = (thesis.spread or 0.0) / math.sqrt(count) if count else 0.0
    return thesis.digit / 2 + ERRORS * math.hypot(error, ours.error)


def verdict(thesis: Printed, ours: Ours) -> str:
    """Return the verdict on a printed mean with a spread.

    reproduced: the means differ by no more than their standard errors explain, and ours is known at
    least as well as the printed spread.
    partly: ours is known less well, so that nothing is decided; or single episodes hardly show
    the difference (`NEGLIGIBLE`), though the means do.
    not: otherwise.
    """
    assert thesis.spread is not None
    gap = abs(ours.value - thesis.value)
    if gap <= tolerance(thesis, ours):
        is_precise = ERRORS * ours.error <= max(thesis.spread, thesis.digit / 2)
        return "reproduced" if is_precise else "partly"
    negligible = thesis.over == "episodes" and gap < NEGLIGIBLE * thesis.spread
    return "partly" if negligible else "not"


def _digit(text: str, value: float) -> float:
    """Return one unit of the last digit with which a text prints a value; 1 if it doesn't."""
    for match in _PRINTED.finditer(text):
        plain = match.group().replace(",", "")
        digits, _, exponent = plain.partition("e")
        if float(plain) in (value, 100 * value):
            scale = value / float(plain) if value else 1.0
            return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])) * scale
    return 1.0  # a count, of things that the thesis lists
