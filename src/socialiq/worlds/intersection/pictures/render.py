"""Pictures of the intersection: one decision with its rewards, a film, and a filmstrip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.storage import write_atomically
from socialiq.types import RewardPair
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH
from socialiq.worlds.highway.settings import SOCIAL_SIGNALS
from socialiq.worlds.intersection.core.geometry import ROUTES
from socialiq.worlds.intersection.pictures import encoding, shapes
from socialiq.worlds.pictures import EGO, OTHER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REACH = 50.0

_SOUTHWARDS = 0.16  # the view looks this part of its reach further south: there the ego starts
_DPI = 100
_INCHES = 6.0  # width of a picture


class Scene(NamedTuple):
    """Content of one picture.

    Attributes:
        vehicles: The vehicles present, records of `state.VEHICLE`.
        ego: Index of the ego.
        braking: Whether each vehicle brakes because of the ego, bool, (vehicles,).
        signals: Weighted contributions to the rewards of the decision so far, by name; those of
            `SOCIAL_SIGNALS` belong to r_social, all others to r_env.
        rewards: The rewards of the decision so far.
        time: s since the reset.
        caption: A title.
    """

    vehicles: np.ndarray
    ego: int
    braking: np.ndarray
    signals: Mapping[str, float]
    rewards: RewardPair
    time: float
    caption: str


def draw(axes: Any, scene: Scene, reach: float = REACH) -> None:
    """Draw the road and everything on it, without title, legend and rewards.

    Args:
        axes: Matplotlib axes.
        scene: What to draw.
        reach: Visible metres to the west and east of the centre; slightly fewer to the north,
            slightly more to the south, where the ego starts.
    """
    _ground(axes, reach)
    _traffic(axes, scene)


def _ground(axes: Any, reach: float) -> None:
    south = (1 + _SOUTHWARDS) * reach
    axes.set(xlim=(-reach, reach), ylim=(south, south - 2 * reach), aspect="equal")
    axes.set_axis_off()
    shapes.road(axes, 2 * reach)


def _traffic(axes: Any, scene: Scene) -> None:
    ego = scene.vehicles[scene.ego]
    lanes = ROUTES[ego["origin"], ego["destination"]].tolist()
    shapes.zone(axes, lanes)
    shapes.route(axes, lanes, float(ego["x"]), float(ego["y"]))
    for slot, record in enumerate(scene.vehicles):
        if _in_sight(axes, record):
            _vehicle(axes, record, slot == scene.ego, bool(scene.braking[slot]))


def _in_sight(axes: Any, record: np.void) -> bool:
    (west, east), (south, north), margin = axes.get_xlim(), axes.get_ylim(), VEHICLE_LENGTH / 2
    across = west - margin < record["x"] < east + margin
    return bool(across and north - margin < record["y"] < south + margin)


def _vehicle(axes: Any, record: np.void, is_ego: bool, brakes: bool) -> None:
    pose = shapes.Pose(float(record["x"]), float(record["y"]), float(record["heading"]))
    if record["crashed"]:
        shapes.burst(axes, pose)
    shapes.vehicle(axes, pose, EGO if is_ego else OTHER)
    if brakes:
        shapes.brake_lights(axes, pose)
    if record["yielding"]:
        shapes.give_way(axes, *shapes.beside(pose, -2.2, 0.8, (1.7, 1.5)))
    speed = float(record["speed"])
    _label(axes, pose, f"{speed:.1f} m/s" if is_ego else f"{speed:.1f}")


def _label(axes: Any, pose: shapes.Pose, text: str) -> None:
    """Write a label to the right of a car, about as tall as the car is wide."""
    per_metre = _per_metre(axes)
    size = max(5.5, 1.9 * per_metre)
    tall = size / per_metre
    x, y = shapes.beside(pose, 1.2, 1.4, (0.31 * tall * len(text), 0.5 * tall))
    look = {"fontsize": size, "color": shapes.INK, "ha": "center", "va": "center"}
    axes.text(x, y, text, clip_on=True, zorder=9, **look)


def _per_metre(axes: Any) -> float:
    """Return points on paper per metre of the world."""
    place = axes.get_position(original=True)
    paper = axes.figure.get_size_inches() * (place.width, place.height)
    metres = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    return 72 * float((paper / metres).min())


class _Sheet:
    """Figure that shows a sequence of scenes: the road, a legend, and the rewards below."""

    def __init__(self, scenes: Sequence[Scene], inches: float) -> None:
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(inches, 1.25 * inches), dpi=_DPI)
        self.road = self.figure.add_axes((0.01, 0.19, 0.98, 0.784))
        _ground(self.road, REACH)
        _legend(self.road, 8 * inches / 6)
        self.kept = set(self.road.get_children())
        # Not the axes' titles: matplotlib repositions those, slowly, at every draw.
        size = 10 * inches / 6
        self.caption = self.figure.text(0.01, 0.981, "", fontsize=size)
        self.time = self.figure.text(0.99, 0.981, "", fontsize=size, ha="right")
        self._add_panels(scenes)

    def _add_panels(self, scenes: Sequence[Scene]) -> None:
        names = dict.fromkeys(name for scene in scenes for name in scene.signals)
        env = [name for name in names if name not in SOCIAL_SIGNALS]
        social = [name for name in names if name in SOCIAL_SIGNALS]
        values = [abs(float(value)) for scene in scenes for value in scene.signals.values()]
        size = max(len(env), len(social), 1), max([0.1, *values])
        self.env = _Panel(self.figure, 0.14, size, env, EGO)
        self.social = _Panel(self.figure, 0.68, size, social, OTHER)

    def show(self, scene: Scene) -> None:
        """Show another scene."""
        for artist in self.road.get_children():
            if artist not in self.kept:
                artist.remove()
        _traffic(self.road, scene)
        self.caption.set_text(scene.caption)
        self.time.set_text(f"t = {scene.time:.1f} s")
        self.env.show("r_env", float(scene.rewards.env), scene.signals)
        self.social.show("r_social", float(scene.rewards.social), scene.signals)


class _Panel:
    """Bars of each signal's contribution to one reward, with the total above."""

    def __init__(
        self,
        figure: Figure,
        left: float,
        size: tuple[int, float],
        names: Sequence[str],
        color: str,
    ) -> None:
        rows, bound = size
        limits = {"xlim": (-bound, 1.9 * bound), "ylim": (rows - 0.4, -0.6)}
        axes = figure.add_axes((left, 0.01, 0.3, 0.14))
        axes.set_axis_off()
        scale = figure.get_figwidth() / 6
        look = {"fontsize": 7.5 * scale, "va": "center", "ha": "right", "color": shapes.INK}
        self.bars, self.values = {}, {}
        axes.axvline(0, color=shapes.INK, linewidth=0.8)
        for row, name in enumerate(names):
            axes.text(-1.1 * bound, row, name.replace("_", " "), **look)
            (self.bars[name],) = axes.barh(row, 0.0, 0.7, color=color)
            self.values[name] = axes.text(1.9 * bound, row, "", **look)
        axes.set(**limits)
        bold = {"fontsize": 9 * scale, "color": color, "weight": "bold"}
        self.total = figure.text(left, 0.156, "", **bold)

    def show(self, reward: str, total: float, signals: Mapping[str, float]) -> None:
        """Set the bars and their numbers."""
        self.total.set_text(f"{reward} = {_signed(total)}")
        for name, bar in self.bars.items():
            value = float(signals.get(name, 0.0))
            bar.set_width(value)
            self.values[name].set(text=_signed(value), color=shapes.INK if value else shapes.FAINT)


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−") if value else "0"


def _legend(axes: Any, size: float) -> None:
    """Draw the legend in the north-eastern corner, each mark as it appears on the road."""
    rows = [shapes.Pose(18.0, -39.0 + 4.0 * row, 0.0) for row in range(7)]
    ego, other, yields, brakes, crashed, zone, way = rows
    words = ("ego", "other driver", "gives way", "brakes for the ego", "has crashed")
    for row, text in zip(rows, (*words, "ego's influence", "ego's route"), strict=True):
        axes.text(23.5, row.y, text, fontsize=size, va="center", color=shapes.INK)
    shapes.vehicle(axes, ego, EGO)
    shapes.vehicle(axes, other, OTHER)
    shapes.give_way(axes, yields.x, yields.y - 0.4)
    shapes.vehicle(axes, brakes, OTHER)
    shapes.brake_lights(axes, brakes)
    shapes.burst(axes, crashed, 0.4)
    shapes.swatch(axes, zone.x, zone.y)
    shapes.dots(axes, way.place([(-2.5, 0.0), (2.5, 0.0)]))


def picture(scene: Scene, inches: float = _INCHES) -> Figure:
    """Draw one scene with a legend, and below it each signal's contribution to the two rewards.

    Args:
        scene: What to draw.
        inches: Width of the figure; its height is a quarter more.
    """
    sheet = _Sheet([scene], inches)
    sheet.show(scene)
    return sheet.figure


def filmstrip(
    scenes: Sequence[Scene], captions: Sequence[str] | None = None, reach: float = REACH
) -> Figure:
    """Draw scenes as a row of pictures without rewards, at most five to a line.

    Args:
        scenes: The scenes in order.
        captions: A title for each picture; by default its time.
        reach: Visible metres, as for `draw`, but a quarter less to the west and east.
    """
    from matplotlib.figure import Figure

    columns = min(5, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = Figure(figsize=(3.0 * columns, 4.15 * rows), layout="constrained", dpi=_DPI)
    titles = captions or [f"t = {scene.time:.1f} s" for scene in scenes]
    for number, (scene, title) in enumerate(zip(scenes, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.set_title(title, fontsize=10)
        _ground(axes, reach)
        axes.set_xlim(-0.76 * reach, 0.76 * reach)
        _traffic(axes, scene)
    return figure


def _shown(scenes: Sequence[Scene]) -> Iterator[Figure]:
    """Yield one figure repeatedly, each time with the next scene, as drawn by `picture`."""
    sheet = _Sheet(scenes, _INCHES)
    for scene in scenes:
        sheet.show(scene)
        yield sheet.figure


def save(path: Path, scenes: Sequence[Scene], frames_per_second: int = 10) -> None:
    """Write a film, whole or not at all.

    Args:
        path: The file: .gif, or .mp4 if ffmpeg is installed.
        scenes: The scenes in order, one frame each.
        frames_per_second: 1 to 50.

    Raises:
        UserError: If there is no scene, the suffix is not supported, ffmpeg is missing or fails,
            the rate is out of range, or the file can't be written.
    """
    if path.suffix not in (".gif", ".mp4"):
        raise UserError(f"cannot write films as '{path.suffix}': choose a .gif or .mp4")
    if not scenes:
        raise UserError("a film needs at least one scene: record an episode first")
    if not 1 <= frames_per_second <= 50:
        raise UserError(f"frames_per_second must lie between 1 and 50, got {frames_per_second}")
    if not path.parent.is_dir():
        raise UserError(f"cannot write {path}: no folder {path.parent}; make it first")
    if path.suffix == ".gif":
        content = encoding.gif(_shown(scenes), frames_per_second, shapes.COLORS)
    else:
        content = encoding.mp4(_shown(scenes), frames_per_second)
    write_atomically(path, content)
