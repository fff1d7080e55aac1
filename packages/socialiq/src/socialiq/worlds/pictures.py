"""Pictures of gridworlds: one state, a filmstrip of an episode, and their shapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from socialiq.foreign import drawing
from socialiq.worlds.grid_world import GridWorld, Place

if TYPE_CHECKING:
    from matplotlib.figure import Figure

State = Sequence[int]
EGO = "#2166ac"
OTHER = "#e08214"
ROAD = "#e6e6e6"
CONFLICT = "#c9c9c9"


def picture(world: GridWorld, state: State, inches: float = 3.0) -> Figure:
    """Draw one state, in a square figure.

    Args:
        world: World of the state.
        state: Values of its features.
        inches: Width and height of the figure.
    """
    figure = drawing().Figure(figsize=(inches, inches), layout="constrained")
    _draw(figure.add_subplot(), world, state)
    return figure


def filmstrip(
    world: GridWorld, states: Sequence[State], captions: Sequence[str] | None = None
) -> Figure:
    """Draw an episode as a row of pictures, four to a line.

    Args:
        world: World of the states.
        states: States in order, values of their features; at least one.
        captions: Title of each picture; by default t = 0, 1, ...
    """
    columns = min(4, len(states))
    rows = -(-len(states) // columns)
    figure = drawing().Figure(figsize=(1.7 * columns, 1.95 * rows), layout="constrained")
    titles = captions or [f"t = {time}" for time in range(len(states))]
    for number, (state, title) in enumerate(zip(states, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.set_title(title, fontsize=9)
        _draw(axes, world, state)
    return figure


def pixels(figure: Figure) -> np.ndarray:
    """Rasterise a figure to RGB, uint8 (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw(axes: Any, world: GridWorld, state: State) -> None:
    """Draw the grid with both roads, the ego (blue) and other users (orange; round on foot)."""
    from matplotlib.patches import Circle, Rectangle

    size = world.size
    road = world.size // 2
    axes.set(xlim=(-0.5, size - 0.5), ylim=(-0.5, size - 0.5), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.add_patch(Rectangle((-0.5, road - 0.5), size, 1, color=ROAD, zorder=0))
    axes.add_patch(Rectangle((road - 0.5, -0.5), 1, size, color=ROAD, zorder=0))
    axes.add_patch(Rectangle((road - 0.5, road - 0.5), 1, 1, color=CONFLICT, zorder=0))
    for line in range(1, size):
        axes.axhline(line - 0.5, color="white", linewidth=1, zorder=1)
        axes.axvline(line - 0.5, color="white", linewidth=1, zorder=1)
    if world.crosswalk is not None:
        for stripe in np.arange(-0.4, 0.4, 0.25):
            corner = world.crosswalk - 0.35, road + stripe
            axes.add_patch(Rectangle(corner, 0.7, 0.12, color="white", zorder=1))
    ego, *others = world.places(state)
    for user in (*others, ego):
        if user.on_foot:
            axes.add_patch(Circle((user.x, user.y), 0.2, facecolor=OTHER, edgecolor="white"))
        else:
            _draw_vehicle(axes, user, EGO if user is ego else OTHER)


def _draw_vehicle(axes: Any, user: Place, color: str) -> None:
    """Draw a road user; its speed is as many chevrons, speed 0 a bar across its front."""
    from matplotlib.patches import FancyBboxPatch

    x = user.x
    y = user.y
    is_eastbound = user.heading == 0
    length, width = (0.74, 0.44) if is_eastbound else (0.44, 0.74)
    look = {"facecolor": color, "edgecolor": "white", "linewidth": 1.0, "zorder": 3}
    corner = x - length / 2, y - width / 2
    rounded = "round,pad=0,rounding_size=0.12"
    axes.add_patch(FancyBboxPatch(corner, length, width, boxstyle=rounded, **look))
    for shift in {1: (0.05,), 2: (-0.1, 0.12)}.get(user.speed or 0, ()):
        along = shift - 0.09, shift + 0.06, shift - 0.09
        across = -0.12, 0.0, 0.12
        points = [x + a for a in along], [y + c for c in across]
        if not is_eastbound:
            points = [x + c for c in across], [y + a for a in along]
        axes.plot(*points, color="white", linewidth=1.8, zorder=4)
    if user.speed == 0:
        points = [x + 0.24] * 2, [y - 0.14, y + 0.14]
        if not is_eastbound:
            points = [x - 0.14, x + 0.14], [y + 0.24] * 2
        axes.plot(*points, color="white", linewidth=2.4, zorder=4)
