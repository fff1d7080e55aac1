"""HTML and Markdown, made from the content of `report.json` and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from socialiq.audit.report import dial_picture, tradeoff
from socialiq.audit.report.words import FILTERS
from socialiq.worlds.registry import WORLDS

_PLACE = ("socialiq.audit.report", "templates")
_MARKED = str.maketrans({one: f"\\{one}" for one in "\\`*_[]<>|&#"})


def html(report: Mapping[str, Any]) -> str:
    """One self-contained page: no script, nothing fetched; all text of strangers is escaped."""
    return (
        _web()
        .get_template("report.html.j2")
        .render(
            report=report,
            means=tradeoff.means(report),
            single=tradeoff.episodes(report),
            dial=dial_picture.dial(report),
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
    """A place that people have to fill, and that nobody overlooks."""
    return Ready(f"> **[ blank ]** to be filled by {who}")


def _plain(value: Any) -> Any:
    """A value that is filled into Markdown: one line, no markup."""
    if not isinstance(value, str) or isinstance(value, Ready):
        return value
    return _one_line(value).translate(_MARKED)


def _one_line(text: str) -> str:
    return "".join(one if one.isprintable() else " " for one in text)
