"""The crossing of the intersection's pictures: its road, and the ego's way across."""

import math
from typing import Any

import numpy as np

from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.network import LANE_WIDTH
from socialiq.worlds.highway.render import Frame, Scene
from socialiq.worlds.highway.shapes import Pose
from socialiq.worlds.intersection.core.geometry import LANES, ROAD, ROUTES, STRAIGHT
from socialiq.worlds.intersection.options import EXIT_DISTANCE

REACH = 50.0
"""Visible metres to the west and east of the centre."""

JUNCTION = float(LANES["y"][STRAIGHT])  # half its width, m
_CORNER = JUNCTION - LANE_WIDTH  # radius of its kerbs, m
_SOUTHWARDS = 0.16  # the view looks this part of its reach further south: there the ego starts
_NARROW = 0.76  # of the reach, to the west and east in a filmstrip


class Crossing:
    """The crossing as a view; the ego's way and zone are those of its destination.

    It may have crosswalks and bicycle lanes.
    """

    marks: tuple[str, ...] = ("gives way",)
    corner: tuple[float, float] | None = (18.0, -39.0)

    def __init__(self, walks: bool = False, rides: bool = False) -> None:
        self._walks = walks
        self._rides = rides

    def ground(self, axes: Any) -> None:
        """Draw the empty crossing: asphalt, centre lines, stop lines and give-way marks."""
        from matplotlib.collections import LineCollection, PolyCollection
        from matplotlib.patches import Polygon, Rectangle

        reach = 2 * REACH
        axes.add_artist(Rectangle((-reach, -reach), 2 * reach, 2 * reach, color=shapes.GRASS))
        # One quarter of the kerb: in along an arm, round the corner, out along the next.
        bend = np.linspace(math.pi, 1.5 * math.pi, 12)
        x = [LANE_WIDTH, *(JUNCTION + _CORNER * np.cos(bend)), reach]
        y = [reach, *(JUNCTION + _CORNER * np.sin(bend)), LANE_WIDTH]
        quarter = list(zip(x, y, strict=True))
        corners = [Pose(0.0, 0.0, math.pi / 2 * corner) for corner in range(4)]
        kerb = np.concatenate([corner.to_world(quarter)[::-1] for corner in corners])
        asphalt = {"facecolor": shapes.ASPHALT, "edgecolor": shapes.PAINT, "linewidth": 1.2}
        axes.add_artist(Polygon(kerb, joinstyle="round", **asphalt))
        arms = [Pose(0.0, 0.0, math.pi / 2 * arm + math.pi / 2) for arm in range(4)]
        centre = [arm.to_world([(JUNCTION, 0.0), (reach, 0.0)]) for arm in arms]
        if self._walks:
            shapes.ways_of_people(axes, ROAD.crossings.ways, self._rides)
        dashed = LineCollection(centre, linewidths=1.2, linestyles=(0, (6, 4)))
        stop = [arm.to_world([(JUNCTION, 0.0), (JUNCTION, -LANE_WIDTH)]) for arm in arms]
        # Triangles before the stop line point at the drivers who must give way.
        base = JUNCTION + 0.6
        tip = JUNCTION + 2.0
        width = LANE_WIDTH / 4
        teeth = [
            arm.to_world([(base, left - 0.1), (base, left - width + 0.1), (tip, left - width / 2)])
            for arm in arms[::2]
            for left in (-width * number for number in range(4))
        ]
        for marking in (dashed, LineCollection(stop, linewidths=[2.0, 1.0]), PolyCollection(teeth)):
            marking.set(color=shapes.PAINT, zorder=2)
            axes.add_artist(marking)

    def frame(self, scene: Scene, strip: bool = False) -> Frame:  # noqa: ARG002  it never moves
        """Return the visible part of the world, which never moves.

        Args:
            scene: Not used.
            strip: Whether the picture belongs to a filmstrip, which is narrower.
        """
        south = (1 + _SOUTHWARDS) * REACH
        wide = REACH * (_NARROW if strip else 1.0)
        return Frame(-wide, wide, south - 2 * REACH, south)

    def way(self, axes: Any, scene: Scene) -> None:
        """Draw the ego's influence zone and the rest of its route.

        Args:
            axes: Axes to draw in.
            scene: Scene with the ego.
        """
        ego = scene.vehicles[scene.ego]
        approach, across, leave = (LANES[n] for n in ROUTES[ego["origin"], ego["destination"], :3])
        start = float(approach["length"]) - shapes.ZONE_APPROACH
        shapes.band(axes, np.concatenate([shapes.way(approach, start), shapes.way(across)]))
        line = shapes.way(approach), shapes.way(across), shapes.way(leave, end=EXIT_DISTANCE)
        shapes.route(axes, np.concatenate(line), float(ego["x"]), float(ego["y"]))
