"""Common style of all figures: colours of the policies, titles, legends, PNG output."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

# Safe for the common kinds of colour blindness; marks differ too.
COLORS = {
    "baseline": "#6e6e6e",
    "egoistic": "#c23b22",
    "prosocial": "#2166ac",
    "altruistic": "#1b7837",
}
MARKS = {"baseline": "s", "egoistic": "^", "prosocial": "o", "altruistic": "D"}


def figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches."""
    return Figure(figsize=(width, height), layout="constrained", dpi=110)


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


def head(drawn: Figure, title: str, legend_of: Any = None, columns: int = 3) -> None:
    """Give a figure a title over all panels, and below them the legend of one panel."""
    drawn.suptitle(title, fontsize=10)
    if legend_of is not None:
        handles, labels = legend_of.get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower center", ncols=columns)


def png(figures: Mapping[str, Figure]) -> dict[str, bytes]:
    """Rasterise figures to PNG files, without a date so that equal figures are equal bytes."""
    files = {}
    for name, figure in figures.items():
        buffer = io.BytesIO()
        FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
        files[name] = buffer.getvalue()
    return files
