"""Pictures of gridworlds: one state, or a filmstrip of an episode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from socialiq.worlds.grid_world import GridWorld

if TYPE_CHECKING:
    from matplotlib.figure import Figure

State = Sequence[int]


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
