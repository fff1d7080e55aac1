"""Figures that a STUDY.toml declares: panels of lines, points, bars or a heat map, from tables.

A `[[figure]]` is a row of panels: one for each column in `y`, times one for each value of the
column `panels`. In a panel, `lines` gives a colour to each value of a column, `styles` a line
style, and `each` a separate line. `layers` draw several tables into the same panels.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from socialiq.errors import one_of
from socialiq.foreign import drawing
from socialiq.plotting import style
from socialiq.plotting.style import PALETTE
from socialiq.results_folder import Results, as_text, where
from socialiq.types import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLES = ("-", "--", ":", "-.")
_MARKS = "osD^vP*X"
_FEW = 4  # entries of a legend that leave room for the lines of a small panel


class _Panel(NamedTuple):
    """A panel: its column of y, and its value of the column `panels` if there is one."""

    y: str
    values: dict[str, Any]


def draw(specification: Mapping[str, Any], results: Results) -> Figure | None:
    """Draw a `[[figure]]` of a STUDY.toml; None where its tables have no rows.

    Args:
        specification: `table`, `where`, `split` (columns of the parts of a name), `kind`, `x`, `y`
            (a column, or several), `lines`, `styles`, `each`, `panels`, `error` (columns of a lower
            and an upper end), `text` (column written next to points), `join` (a column of several),
            `layers` (tables of these keys, drawn one over another), `xlabel`, `ylabel`, `ylabels`,
            `rotation` (of the labels at x, degrees), `xscale`, `yscale`, `xlim`, `ylim`, `hline`,
            `vline`, `diagonal`, `legend` (false for none, or "below"), `words` (texts in place of
            the values of a column), `title`, `size` (of a panel, in inches), `columns` (panels side
            by side).
        results: Results whose tables are drawn.
    """
    layers = [{**specification, **layer} for layer in specification.get("layers", [{}])]
    rows = next(filter(None, (_rows(layer, results) for layer in layers)), None)
    if rows is None:
        return None
    known = [name for layer in layers for row in _rows(layer, results)[:1] for name in row]
    for name in _listed(specification["y"]):
        one_of("column", name, list(dict.fromkeys(known)))
    names = _listed(specification.get("panels"))
    values = dict.fromkeys(tuple(row[name] for name in names) for row in rows)
    panels = [
        _Panel(column, dict(zip(names, of_panel, strict=True)))
        for column in _listed(specification["y"])
        for of_panel in values
    ]
    side_by_side = min(specification.get("columns", len(panels)), len(panels))
    width, height = specification.get("size", (4.4, 4.0))
    down = math.ceil(len(panels) / side_by_side)
    picture = style.figure(width * side_by_side, height * down)
    grid = picture.subplots(down, side_by_side, squeeze=False).ravel()
    for axes, panel in itertools.zip_longest(grid, panels):
        if panel is None:
            axes.axis("off")
            continue
        for layer in layers:
            _layer(axes, layer, panel, _rows(layer, results))
        _finish(axes, specification, panel)
    legends = [set(axes.get_legend_handles_labels()[1]) for axes in grid]
    labels = set[str]().union(*legends)
    legend = specification.get("legend", True)
    crowded = len(panels) > 1 and (len(labels) > _FEW or labels != legends[0])
    below = bool(labels and legend and (crowded or legend == "below"))
    if labels and legend and not below:
        grid[0].legend(frameon=False, fontsize=8)
    style.head(picture, specification.get("title", ""), below)
    return picture


def colors_of(names: Sequence[Any]) -> dict[Any, Any]:
    """Return a colour for each name: the thesis' modes have theirs, many numbers a scale."""
    if set(names) <= set(style.COLORS):
        return {name: style.COLORS[name] for name in names}
    numbers = all(isinstance(name, int | float) for name in names)
    if len(names) > len(PALETTE) or (numbers and len(names) > 3):
        scale = drawing("matplotlib").colormaps["viridis"](np.linspace(0, 0.95, len(names)))
        return dict(zip(names, scale, strict=True))
    return dict(zip(names, PALETTE, strict=False))


def _listed(names: str | Sequence[str] | None) -> Sequence[str]:
    return [names] if isinstance(names, str) else names or []


def _rows(layer: Mapping[str, Any], results: Results) -> list[Row]:
    """Return the rows of a layer's table, with columns from parts of a name or from several."""

    def number(text: str) -> float | str:
        try:
            return float(text)
        except ValueError:
            return text

    rows = results.tables.get(layer["table"], [])
    for column, names in layer.get("split", {}).items():
        keys = names.split("/")
        split_rows = [(row, str(row[column]).split("/")) for row in rows]
        rows = [
            row | dict(zip(keys, map(number, values), strict=True))
            for row, values in split_rows
            if len(values) == len(keys)
        ]
    for name, columns in layer.get("join", {}).items():
        rows = [row | {name: ", ".join(as_text(row[column]) for column in columns)} for row in rows]
    rows = where(rows, layer.get("where", {}))
    for name, words in layer.get("words", {}).items():
        rows = [row | {name: words.get(as_text(row[name]), row[name])} for row in rows]
    return rows


def _values(rows: Sequence[Row], name: str | None) -> list[Any]:
    """Return the distinct values of a column in order of appearance; [None] without a column."""
    return list(dict.fromkeys(row[name] for row in rows)) if name else [None]


def _layer(axes: Any, layer: Mapping[str, Any], panel: _Panel, rows: list[Row]) -> None:
    """Draw the rows of a layer that belong to a panel."""
    kind = layer.get("kind", "lines")
    y = layer["y"] if "layers" in layer and isinstance(layer["y"], str) else panel.y
    colors = colors_of(_values(rows, layer.get("lines")))  # the same in every panel
    rows = [
        row for row in where(rows, panel.values) if row.get(y, "") != "" and row[layer["x"]] != ""
    ]
    if kind == "heatmap":
        _heatmap(axes, layer, rows, y)
        return
    if kind == "bars":
        _bars(axes, layer, rows, y, colors)
        return
    for (position, (name, color)), (number, other) in itertools.product(
        enumerate(colors.items()), enumerate(_values(rows, layer.get("styles")))
    ):
        chosen = {layer[key]: v for key, v in (("lines", name), ("styles", other)) if v is not None}
        series = where(rows, chosen)
        words = [as_text(word) for word in (name, other) if word is not None]
        label = " ".join(filter(None, (layer.get("label"), ", ".join(words))))
        look = {"color": layer.get("color", color), "label": label or None}
        look["marker"] = _MARKS[position % 8] if kind == "points" else "."
        look["linestyle"] = "none" if kind == "points" else STYLES[number % 4]
        if layer.get("legend") is False:
            look["label"] = None
        if kind == "points" and number:
            look["markerfacecolor"] = "none"
        for value in _values(series, layer.get("each")) if series else ():
            line = series if value is None else where(series, {layer["each"]: value})
            _series(axes, layer, line, y, kind, look)
            look["label"] = None


def _series(
    axes: Any, layer: Mapping[str, Any], rows: list[Row], y: str, kind: str, look: dict[str, Any]
) -> None:
    """Draw a line, points, or means over equal x with a band from the least to the largest."""
    if kind == "band":
        places, mean, low, high = style.spread(rows, layer["x"], y)
        axes.fill_between(places, low, high, color=look["color"], alpha=0.15, linewidth=0)
        axes.plot(places, mean, **look)
        return
    x = [row[layer["x"]] for row in rows]
    values = [row[y] for row in rows]
    if "error" in layer:
        low, high = ([row[name] for row in rows] for name in layer["error"])
        ends = np.abs(np.array([low, high], float) - np.array(values, float))
        axes.errorbar(x, values, ends, fmt="none", ecolor=look["color"], alpha=0.5, capsize=2)
    axes.plot(x, values, alpha=layer.get("alpha", 0.8 if kind == "points" else 1.0), **look)
    for place in zip(rows, x, values, strict=True) if "text" in layer else ():
        text = as_text(place[0][layer["text"]])
        axes.annotate(text, place[1:], (4, 4), textcoords="offset points", fontsize=7)


def _bars(
    axes: Any, layer: Mapping[str, Any], rows: list[Row], y: str, colors: Mapping[Any, Any]
) -> None:
    """Draw bars at the means of equal x, side by side for the values of `lines`, a dot a row."""
    places = _values(rows, layer["x"])
    width = 0.8 / len(colors)
    for number, (name, color) in enumerate(colors.items()):
        series = rows if name is None else where(rows, {layer["lines"]: name})
        for position in _values(series, layer["x"]):
            here = where(series, {layer["x"]: position})
            values = [row[y] for row in here]
            at = places.index(position) - 0.4 + (number + 0.5) * width
            label = layer.get("label") if name is None else as_text(name)
            label = label if position == series[0][layer["x"]] else None
            axes.bar([at], [np.mean(values)], 0.9 * width, color=color, label=label, alpha=0.7)
            if len(values) > 1:
                axes.plot([at] * len(values), values, ".", color="black", markersize=3)
            elif "error" in layer:
                ends = [here[0][end] for end in layer["error"]]
                axes.plot([at, at], ends, color="black", linewidth=1)
    axes.set_xticks(range(len(places)), list(map(str, places)))


def _heatmap(axes: Any, layer: Mapping[str, Any], rows: list[Row], value: str) -> None:
    """Draw a column as colour over two others, `x` and `by`; white where there is no row."""
    if not rows:
        return
    across = sorted(_values(rows, layer["x"]))
    down = sorted(_values(rows, layer["by"]))
    picture = np.full((len(down), len(across)), np.nan)
    for row in rows:
        picture[down.index(row[layer["by"]]), across.index(row[layer["x"]])] = row[value]
    low, high = layer.get("limits", (None, None))
    image = axes.imshow(picture, origin="lower", aspect="auto", vmin=low, vmax=high, cmap="viridis")
    axes.set_xticks(range(len(across)), [f"{position:g}" for position in across])
    axes.set_yticks(range(len(down)), [f"{position:g}" for position in down])
    axes.grid(visible=False)
    axes.figure.colorbar(image, ax=axes, shrink=0.7, label=layer.get("zlabel", ""))


def _finish(axes: Any, specification: Mapping[str, Any], panel: _Panel) -> None:
    """Give a panel its lines, labels, limits and title."""
    light = {"color": "#999999", "linewidth": 0.8, "linestyle": ":"}
    for name, line in (("hline", axes.axhline), ("vline", axes.axvline)):
        if name in specification:
            line(specification[name], **light)
    if specification.get("diagonal"):
        axes.axline((0.0, 0.0), slope=1.0, **light)
    if rotation := specification.get("rotation"):
        for label in axes.get_xticklabels():
            label.set(rotation=rotation, ha="right", rotation_mode="anchor")
    title = ", ".join(
        value if isinstance(value, str) else f"{name.replace('_', ' ')} {as_text(value)}"
        for name, value in panel.values.items()
    )
    labels = specification.get("ylabels", {})
    style.finish(
        axes,
        title,
        xlabel=specification.get("xlabel", specification["x"]),
        ylabel=labels.get(panel.y, specification.get("ylabel", panel.y.replace("_", " "))),
        **{
            name: specification[name]
            for name in ("xscale", "yscale", "xlim", "ylim")
            if name in specification
        },
    )
