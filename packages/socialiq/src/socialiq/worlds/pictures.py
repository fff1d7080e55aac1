"""Pictures of gridworlds: one state, a filmstrip of an episode, and their shapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from socialiq.worlds.grid_world import GridWorld

if TYPE_CHECKING:
    from matplotlib.figure import Figure

State = Sequence[int]
EGO = "#2166ac"
OTHER = "#e08214"
ROAD = "#e6e6e6"
CONFLICT = "#c9c9c9"

Heading = Literal["east", "north"]


def picture(world: GridWorld, state: State, inches: float = 3.0) -> Figure:
    """Draw one state.

    Args:
        world: The world.
        state: The state's features.
        inches: Width and height of the figure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(inches, inches), layout="constrained")
    world.draw(figure.add_subplot(), world, tuple(state))
    return figure


def filmstrip(
    world: GridWorld, states: Sequence[State], captions: Sequence[str] | None = None
) -> Figure:
    """Draw an episode as a row of pictures, at most eight to a line.

    Args:
        world: The world.
        states: The states in order.
        captions: A title for each picture; by default t = 0, 1, ...
    """
    from matplotlib.figure import Figure

    columns = min(8, len(states))
    rows = -(-len(states) // columns)
    figure = Figure(figsize=(1.7 * columns, 1.95 * rows), layout="constrained")
    titles = captions or [f"t = {time}" for time in range(len(states))]
    for number, (state, title) in enumerate(zip(states, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.set_title(title, fontsize=9)
        world.draw(axes, world, tuple(state))
    return figure


def pixels(figure: Figure) -> np.ndarray:
    """Rasterise a figure to RGB, uint8 (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def draw_crossing(axes: Any, size: int, road: int) -> None:
    """Draw an empty size x size grid with a west-east and a south-north road through `road`."""
    from matplotlib.patches import Rectangle

    axes.set(xlim=(-0.5, size - 0.5), ylim=(-0.5, size - 0.5), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.add_patch(Rectangle((-0.5, road - 0.5), size, 1, color=ROAD, zorder=0))
    axes.add_patch(Rectangle((road - 0.5, -0.5), 1, size, color=ROAD, zorder=0))
    axes.add_patch(Rectangle((road - 0.5, road - 0.5), 1, 1, color=CONFLICT, zorder=0))
    for line in range(1, size):
        axes.axhline(line - 0.5, color="white", linewidth=1, zorder=1)
        axes.axvline(line - 0.5, color="white", linewidth=1, zorder=1)


def draw_vehicle(
    axes: Any, x: int, y: int, heading: Heading, color: str, speed: int | None = None
) -> None:
    """Draw a road user at the centre of cell (x, y).

    Args:
        axes: Matplotlib axes.
        x: Column of the cell.
        y: Row of the cell, upwards.
        heading: Driving direction.
        color: Fill colour.
        speed: Speed level, drawn as that many chevrons; a bar for 0, nothing for None.
    """
    from matplotlib.patches import FancyBboxPatch

    length, width = (0.74, 0.44) if heading == "east" else (0.44, 0.74)
    body = FancyBboxPatch(
        (x - length / 2, y - width / 2),
        length,
        width,
        boxstyle="round,pad=0,rounding_size=0.12",
        facecolor=color,
        edgecolor="white",
        linewidth=1.0,
        zorder=3,
    )
    axes.add_patch(body)
    for shift in _chevrons(speed):
        _chevron(axes, x, y, heading, shift)
    if speed == 0:
        _bar(axes, x, y, heading)


def _chevrons(speed: int | None) -> tuple[float, ...]:
    return {None: (), 0: (), 1: (0.05,), 2: (-0.1, 0.12)}[speed]


def _chevron(axes: Any, x: int, y: int, heading: Heading, shift: float) -> None:
    along, across = (shift - 0.09, shift + 0.06, shift - 0.09), (-0.12, 0.0, 0.12)
    if heading == "east":
        points = [x + a for a in along], [y + c for c in across]
    else:
        points = [x + c for c in across], [y + a for a in along]
    axes.plot(*points, color="white", linewidth=1.8, zorder=4)


def _bar(axes: Any, x: int, y: int, heading: Heading) -> None:
    points = ([x + 0.24] * 2, [y - 0.14, y + 0.14])
    if heading == "north":
        points = ([x - 0.14, x + 0.14], [y + 0.24] * 2)
    axes.plot(*points, color="white", linewidth=2.4, zorder=4)
