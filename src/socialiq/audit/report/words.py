"""Numbers and angles in words, the same in every view of a report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Real = int | float
"""A number as JSON gives it: a whole one may come as an int."""

CRITERIA = {
    "at_fault": "drives into somebody",
    "struck": "is driven into by somebody",
    "arrival": "arrives",
    "timeout": "runs out of time",
}
VERDICTS = {
    "pass": "Behaves as declared",
    "fail": "Does not behave as declared",
    "inconclusive": "Not decided",
}


def number(value: Real | None) -> str:
    """Three significant digits, no more than three decimals; a true minus."""
    if value is None:
        return "–"
    text = f"{round(value, 3):.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return (text if float(text.replace(",", "")) else "0").replace("-", "−")


def percent(share: Real | None) -> str:
    """A share as a percentage to one decimal."""
    return "–" if share is None else f"{100 * share:.1f} %".replace("-", "−")


def measured(value: Real | None, share: bool) -> str:
    """A value or a change of it: as a percentage if it is a share."""
    return percent(value) if share else number(value)


def degrees(angle: Real | None) -> str:
    """An angle to one decimal, without a decimal that is 0."""
    return "–" if angle is None else f"{round(angle, 1) + 0.0:g}°".replace("-", "−")


def arc(low: Real, high: Real) -> str:
    """An arc of angles, from its low end in (-180, 180] to at most 360 degrees further."""
    if high - low >= 360.0:
        return "every angle"
    first = -((180.0 - low) % 360.0 - 180.0)
    return f"{degrees(first)} to {degrees(first + high - low)}"


def arcs(found: Sequence[dict[str, Real]]) -> str:
    """Arcs in one line."""
    return ", ".join(arc(one["low"], one["high"]) for one in found) or "none"


def meaning(angle: Real) -> str:
    """What an angle asks of a driver."""
    own, others = "its own progress", "the ease of the others"
    exact = {
        0.0: f"only {own} counts",
        45.0: f"{own} and {others} count alike",
        90.0: f"only {others} counts",
        180.0: f"losing {own} is all that counts",
        270.0: "hindering the others is all that counts",
    }
    if angle in exact:
        return exact[angle]
    if angle < 90.0:
        more, less = (own, others) if angle < 45.0 else (others, own)
        return f"{more} counts more than {less}"
    if angle < 180.0:
        return f"{others} counts, and {own} counts against it"
    if angle < 270.0:
        return f"both {own} and {others} count against it"
    return f"{own} counts, and {others} counts against it"


def options(found: dict[str, Any]) -> str:
    """Options of a world in one line."""
    return ", ".join(f"{name} = {value}" for name, value in found.items()) or "defaults"


def headline(decision: str) -> str:
    """A verdict in a few words."""
    return VERDICTS[decision]


def criterion(name: str) -> str:
    """What happens in an episode that counts for a criterion."""
    return CRITERIA[name]


FILTERS = {
    one.__name__: one
    for one in (number, percent, measured, degrees, arcs, meaning, options, headline, criterion)
}
