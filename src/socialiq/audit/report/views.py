"""HTML and Markdown, made from the content of `report.json` and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from socialiq.audit.evidence.outcomes import CRITERIA
from socialiq.audit.report import pictures
from socialiq.worlds.registry import WORLDS

Real = int | float
"""A number as JSON gives it: a whole one may come as an int."""


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
    """Meaning of an angle for a driver."""
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
    """Event of an episode that counts for a criterion."""
    return CRITERIA[name]


FILTERS = {
    one.__name__: one
    for one in (number, percent, measured, degrees, arcs, meaning, options, headline, criterion)
}

_PLACE = ("socialiq.audit.report", "templates")

_MARKED = str.maketrans({one: f"\\{one}" for one in "\\`*_[]<>|&#"})


def html(report: Mapping[str, Any]) -> str:
    """One self-contained page: no script, nothing fetched; all text from outside is escaped."""
    return (
        _web()
        .get_template("report.html.j2")
        .render(
            report=report,
            means=pictures.means(report),
            single=pictures.episodes(report),
            dial=pictures.dial(report),
        )
    )


def markdown(report: Mapping[str, Any], template: str = "report.md.j2", **more: Any) -> str:
    """A page of Markdown; every value that is filled in is escaped.

    Args:
        report: Content of `report.json`.
        template: Which page.
        more: What else it is filled with.
    """
    return _text().get_template(template).render(report=report, **more)


@cache
def _web() -> Environment:
    return _environment(autoescape=True)


@cache
def _text() -> Environment:
    made = _environment(autoescape=False, finalize=_plain)
    made.globals["blank"] = _blank
    return made


def _environment(**settings: Any) -> Environment:
    made = Environment(
        loader=PackageLoader(*_PLACE),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        **settings,
    )
    made.filters.update(FILTERS, code=_code)
    made.globals["told"] = told
    return made


def told(report: Mapping[str, Any], criterion: str) -> bool:
    """Whether the world tells what a criterion asks; others' environments don't know who struck."""
    return criterion != "struck" or report["declaration"]["scenario"]["world"] in WORLDS


class Ready(str):
    """Text that needs no more escaping."""


def _code(text: str) -> Ready:
    """An indented block of code, in which Markdown reads no markup."""
    return Ready(f"    {_one_line(text)}")


def _blank(who: str) -> Ready:
    """A marked place that people have to fill."""
    return Ready(f"> **[ blank ]** to be filled by {who}")


def _plain(value: Any) -> Any:
    """A value that is filled into Markdown: one line, no markup."""
    if not isinstance(value, str) or isinstance(value, Ready):
        return value
    return _one_line(value).translate(_MARKED)


def _one_line(text: str) -> str:
    return "".join(one if one.isprintable() else " " for one in text)
