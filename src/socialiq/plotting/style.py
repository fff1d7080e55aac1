"""Common style of all figures: colours of the policies, fonts, PNG output."""

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
    """An empty figure, in inches."""
    return Figure(figsize=(width, height), layout="constrained", dpi=110)


def plain(axes: Any) -> None:
    """Take away the frame's top and right, and lay a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e8e8e8", linewidth=0.8)
    axes.set_axisbelow(True)


def png(figures: Mapping[str, Figure]) -> dict[str, bytes]:
    """Rasterise figures to PNG files, without a date so that equal figures are equal bytes."""
    files = {}
    for name, drawn in figures.items():
        buffer = io.BytesIO()
        FigureCanvasAgg(drawn).print_png(buffer, metadata={"Software": None})
        files[name] = buffer.getvalue()
    return files
