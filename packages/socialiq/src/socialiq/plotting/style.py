"""Style of all figures: colours, titles, legends, lines of rows, and angles on a ring."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from socialiq.foreign import drawing
from socialiq.types import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Safe for the common kinds of colour blindness; marks differ too.
COLORS = {
    "baseline": "#6e6e6e",
    "egoistic": "#c23b22",
    "prosocial": "#2166ac",
    "altruistic": "#1b7837",
}
PALETTE = ("#2166ac", "#c23b22", "#1b7837", "#e08214", "#762a83", "#888888", "#1f9e89", "#d6604d")
SMALLEST = 7.0  # points of text on a page
PAGE = 7.6  # inches of width of a page of the documentation, which shrinks wider figures
MARKS = {"baseline": "s", "egoistic": "^", "prosocial": "o", "altruistic": "D"}


def figure(width: float, height: float) -> Figure:
    """Return an empty figure.

    Args:
        width: Width in inches.
        height: Height in inches.

    Raises:
        UserError: If matplotlib is not installed.
    """
    return drawing().Figure(figsize=(width, height), layout="constrained", dpi=110)


def smallest_font(drawing: Figure) -> float:
    """Return the font size that is `SMALLEST` once a figure is as wide as the page."""
    return SMALLEST * max(1.0, drawing.get_figwidth() / PAGE)


def plain(axes: Any) -> None:
    """Remove the frame's top and right, and draw a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e8e8e8", linewidth=0.8)
    axes.set_axisbelow(True)


def finish(axes: Any, title: str = "", legend: int | None = None, **properties: Any) -> None:
    """Give a panel its title, its labels and the common style.

    Args:
        axes: The panel.
        title: Its title, in a small font.
        legend: Font size of a legend without a frame; none by default.
        **properties: Properties of the panel, such as `xlabel` and `ylim`.
    """
    axes.set(**properties)
    axes.set_title(title, fontsize=10)
    if legend is not None:
        axes.legend(frameon=False, fontsize=legend)
    plain(axes)


def head(drawing: Figure, title: str, legend: bool = False) -> None:
    """Give a figure a title over all panels, and on request a legend of all panels below them.

    Args:
        drawing: The figure; a legend makes it higher.
        title: Title, which is broken into lines of the figure's width.
        legend: Whether to draw the legend; panels with one label share an entry.
    """
    size = max(10.0, smallest_font(drawing))
    letters = int(drawing.get_figwidth() * 72 / (0.52 * size))
    drawing.suptitle(textwrap.fill(title, letters), fontsize=size)
    if not legend:
        return
    pairs = [zip(*axes.get_legend_handles_labels(), strict=True) for axes in drawing.axes]
    entries = {label: handle for pair in pairs for handle, label in pair}
    columns = max(1, letters // (max(map(len, entries)) + 7))
    drawing.set_figheight(drawing.get_figheight() + 1.5 * size / 72 * -(-len(entries) // columns))
    place: Any = {"loc": "outside lower center", "ncols": columns, "frameon": False}
    drawing.legend(list(entries.values()), list(entries), **place)


def png(figures: Mapping[str, Figure]) -> dict[str, bytes]:
    """Rasterise figures, text legible on a page, to PNG files; equal figures are equal bytes."""
    canvas = drawing("matplotlib.backends.backend_agg").FigureCanvasAgg
    text_type = drawing("matplotlib.text").Text
    files = {}
    for name, figure in figures.items():
        texts: Any = figure.findobj(text_type) if figure.get_layout_engine() else ()
        for text in texts:
            text.set_fontsize(max(text.get_fontsize(), smallest_font(figure)))
        buffer = io.BytesIO()
        canvas(figure).print_png(buffer, metadata={"Software": None})
        files[name] = buffer.getvalue()
    return files


def line(axes: Any, rows: Sequence[Row], x: str, y: str, **style: Any) -> None:
    """Draw one column of the rows against another, in the order of the rows.

    Args:
        axes: Where to draw.
        rows: Rows of a table.
        x: Column of the horizontal axis.
        y: Column of the vertical axis.
        **style: Options of the line.
    """
    axes.plot([row[x] for row in rows], [row[y] for row in rows], **style)


def spread(rows: Sequence[Row], x: str, y: str) -> tuple[np.ndarray, ...]:
    """Return mean and range of a column over rows of equal `x`.

    Args:
        rows: Rows of a table.
        x: Column whose distinct values group the rows.
        y: Column that is summarised.

    Returns:
        Four arrays of one length: the distinct values of `x`, rising, and at each the mean, least
        and largest value of `y`.
    """
    places = sorted({row[x] for row in rows})
    values = [[row[y] for row in rows if row[x] == number] for number in places]
    return (
        np.array(places),
        np.array([np.mean(group) for group in values]),
        np.array([min(group) for group in values]),
        np.array([max(group) for group in values]),
    )


def band(axes: Any, rows: Sequence[Row], x: str, y: str, factor: float = 1.0, **style: Any) -> None:
    """Draw mean and range of a column over rows of equal `x`, for instance over training seeds.

    Args:
        axes: Where to draw.
        rows: Rows of a table.
        x: Column of the horizontal axis.
        y: Column of the vertical axis.
        factor: Multiplier of `y`; 100 turns shares into percent.
        **style: Options of the line; the band has its colour.
    """
    places, mean, low, high = spread(rows, x, y)
    light = {"color": style["color"], "alpha": 0.15, "linewidth": 0}
    axes.fill_between(places, factor * low, factor * high, **light)
    axes.plot(places, factor * mean, **({"markersize": 4} | style))


_OUTSIDE = 1.14  # radius of the thesis' marks
_ARC = 0.95  # radius of the first arc
_ARC_STEP = 0.015  # difference of the radii of two neighbouring arcs


class Mark(NamedTuple):
    """A policy on the ring; angles in degrees.

    Attributes:
        name: Key of its colour and mark; another name has a colour of `PALETTE`.
        angle: Our angle.
        label: Text of its legend entry.
        thesis: The thesis' angle, if it prints one.
        spread: Ends of an arc, counterclockwise.
    """

    name: str
    angle: float
    label: str
    thesis: float | None = None
    spread: tuple[float, float] | None = None


def ring(marks: Sequence[Mark], title: str) -> Figure:
    """Draw angles on a ring: ours as filled marks, spreads as arcs inside, the thesis' outside.

    Args:
        marks: Policies to draw; the arc of each later one has a smaller radius.
        title: Title of the figure.

    Raises:
        UserError: If matplotlib is not installed.
    """
    selected = figure(6.4, 6.0)
    axes = selected.add_subplot()
    axes.plot(*_arc(0.0, 360.0, 1.0), color="#cccccc", linewidth=1.2)
    for degrees in range(0, 360, 45):
        x = np.cos(np.radians(degrees))
        y = np.sin(np.radians(degrees))
        axes.text(0.82 * x, 0.82 * y, f"{degrees}°", ha="center", va="center", color="#888888")
    for number, mark in enumerate(marks):
        color = COLORS.get(mark.name, PALETTE[number % len(PALETTE)])
        style: dict[str, Any] = {
            "marker": MARKS.get(mark.name, "o"),
            "markeredgecolor": color,
            "linestyle": "none",
        }
        if mark.spread is not None:
            arc = _arc(*mark.spread, _ARC - number * _ARC_STEP)
            axes.plot(*arc, color=color, linewidth=2.2, solid_capstyle="round")
        # Another mark may cover the baseline's, which is larger so that both are visible.
        style["markersize"] = 15 if mark.name == "baseline" else 10
        position = _arc(mark.angle, mark.angle, 1.0, 1)
        axes.plot(*position, markerfacecolor=color, label=mark.label, **style)
        if mark.thesis is not None:
            position = _arc(mark.thesis, mark.thesis, _OUTSIDE, 1)
            axes.plot(*position, **{**style, "markersize": 8, "markerfacecolor": "none"})
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.35, 1.35), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    axes.set_xlabel("r_env →")
    axes.set_ylabel("r_social →")
    axes.legend(loc="center", frameon=False, fontsize=8)
    axes.set_title(title, fontsize=10)
    return selected


def _arc(
    low: float, high: float, radius: float, points: int = 361
) -> tuple[np.ndarray, np.ndarray]:
    around = np.radians(np.linspace(low, high, points))
    return radius * np.cos(around), radius * np.sin(around)
