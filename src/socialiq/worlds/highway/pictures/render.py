"""Pictures of roads: one decision with its rewards, a film, and a filmstrip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from socialiq.errors import UserError
from socialiq.storage import write_atomically
from socialiq.types import RewardPair
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH
from socialiq.worlds.highway.pictures import encoding, shapes
from socialiq.worlds.highway.settings import SOCIAL_SIGNALS
from socialiq.worlds.pictures import EGO, OTHER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 100
_INCHES = 6.0  # width of a picture


class Scene(NamedTuple):
    """Content of one picture.

    Attributes:
        vehicles: The vehicles present, records of the road.
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


class Frame(NamedTuple):
    """Visible part of the world, m; y grows to the south."""

    west: float
    east: float
    north: float
    south: float

    @property
    def ratio(self) -> float:
        """Height per width."""
        return (self.south - self.north) / (self.east - self.west)


@runtime_checkable
class View(Protocol):
    """Road as pictures show it.

    Attributes:
        marks: What the legend explains besides that of every road: "gives way", "obstacle".
        corner: Place in m of the legend's first mark where the road leaves space for it; None puts
            the legend above the picture.
    """

    marks: tuple[str, ...]
    corner: tuple[float, float] | None

    def ground(self, axes: Any) -> None:
        """Draw the empty road."""
        ...

    def frame(self, scene: Scene, strip: bool = False) -> Frame:
        """Return what is visible of a scene, in a filmstrip if `strip`; of one size in all."""
        ...

    def way(self, axes: Any, scene: Scene) -> None:
        """Draw the ego's influence zone and the rest of its way."""
        ...


def draw(axes: Any, scene: Scene, view: View, strip: bool = False) -> None:
    """Draw the road and everything on it, without title, legend and rewards.

    Args:
        axes: Matplotlib axes.
        scene: What to draw.
        view: The road.
        strip: Whether the picture is one of a filmstrip.
    """
    axes.set_axis_off()
    view.ground(axes)
    _look(axes, view.frame(scene, strip))
    _traffic(axes, scene, view)


def _look(axes: Any, frame: Frame) -> None:
    limits = {"xlim": (frame.west, frame.east), "ylim": (frame.south, frame.north)}
    axes.set(**limits, aspect="equal")


def _traffic(axes: Any, scene: Scene, view: View) -> None:
    view.way(axes, scene)
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
    if "yielding" in (record.dtype.names or ()) and record["yielding"]:
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


_BELOW, _ABOVE, _LEGEND = 0.2375, 0.0325, 0.085  # rewards, caption, legend: of the width
_WIDE = 0.98  # of the width: the road


class _Sheet:
    """Figure that shows a sequence of scenes: the road, a legend, and the rewards below."""

    def __init__(self, scenes: Sequence[Scene], view: View, inches: float) -> None:
        from matplotlib.figure import Figure

        self.view, high = view, _WIDE * view.frame(scenes[0]).ratio
        legend = 0.0 if view.corner else _LEGEND
        pairs = round(inches * (_BELOW + high + legend + _ABOVE) * _DPI / 2)  # films: even rows
        self.rise = pairs * 2 / _DPI / inches
        self.figure = Figure(figsize=(inches, inches * self.rise), dpi=_DPI)
        self.road = self._axes(0.01, _BELOW, _WIDE, high)
        self.road.set_axis_off()
        view.ground(self.road)
        _look(self.road, view.frame(scenes[0]))
        if view.corner:
            _legend(self.road, _column(view.corner), view.marks, 8 * inches / 6)
        else:
            strip = self._axes(0.01, _BELOW + high, _WIDE, legend)
            strip.set(xlim=(0.0, 100 * _WIDE), ylim=(100 * legend, 0.0))
            strip.set_axis_off()
            _legend(strip, _GRID, view.marks, 8 * inches / 6)
        self.kept = set(self.road.get_children())
        # Not the axes' titles: matplotlib repositions those, slowly, at every draw.
        size, top = 10 * inches / 6, 1 - 0.02375 / self.rise
        self.caption = self.figure.text(0.01, top, "", fontsize=size)
        self.time = self.figure.text(0.99, top, "", fontsize=size, ha="right")
        self._add_panels(scenes)

    def _axes(self, left: float, below: float, wide: float, high: float) -> Any:
        """Add axes; all lengths in widths of the figure."""
        return self.figure.add_axes((left, below / self.rise, wide, high / self.rise))

    def _add_panels(self, scenes: Sequence[Scene]) -> None:
        names = dict.fromkeys(name for scene in scenes for name in scene.signals)
        env = [name for name in names if name not in SOCIAL_SIGNALS]
        social = [name for name in names if name in SOCIAL_SIGNALS]
        values = [abs(float(value)) for scene in scenes for value in scene.signals.values()]
        size = max(len(env), len(social), 1), max([0.1, *values])
        places = [self._axes(left, 0.0125, 0.3, 0.175) for left in (0.14, 0.68)]
        total = 0.195 / self.rise
        self.env = _Panel(self.figure, places[0], total, size, env, EGO)
        self.social = _Panel(self.figure, places[1], total, size, social, OTHER)

    def show(self, scene: Scene) -> None:
        """Show another scene."""
        for artist in self.road.get_children():
            if artist not in self.kept:
                artist.remove()
        _look(self.road, self.view.frame(scene))
        _traffic(self.road, scene, self.view)
        self.caption.set_text(scene.caption)
        self.time.set_text(f"t = {scene.time:.1f} s")
        self.env.show("r_env", float(scene.rewards.env), scene.signals)
        self.social.show("r_social", float(scene.rewards.social), scene.signals)


class _Panel:
    """Bars of each signal's contribution to one reward, with the total above."""

    def __init__(
        self,
        figure: Figure,
        axes: Any,
        above: float,
        size: tuple[int, float],
        names: Sequence[str],
        color: str,
    ) -> None:
        rows, bound = size
        limits = {"xlim": (-bound, 1.9 * bound), "ylim": (rows - 0.4, -0.6)}
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
        self.total = figure.text(axes.get_position().x0, above, "", **bold)

    def show(self, reward: str, total: float, signals: Mapping[str, float]) -> None:
        """Set the bars and their numbers."""
        self.total.set_text(f"{reward} = {_signed(total)}")
        for name, bar in self.bars.items():
            value = float(signals.get(name, 0.0))
            bar.set_width(value)
            self.values[name].set(text=_signed(value), color=shapes.INK if value else shapes.FAINT)


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−") if value else "0"


def _column(corner: tuple[float, float]) -> list[tuple[float, float]]:
    return [(corner[0], corner[1] + 4.0 * row) for row in range(7)]


_GRID = [(x, 2.2 + 4.2 * row) for row in range(2) for x in (3.5, 25.0, 50.0, 80.0)]


def _legend(
    axes: Any, places: Sequence[tuple[float, float]], marks: tuple[str, ...], size: float
) -> None:
    """Draw the legend, each mark as it appears on the road, at as many places as are needed."""
    drawn = {
        "ego": lambda pose: shapes.vehicle(axes, pose, EGO),
        "other driver": lambda pose: shapes.vehicle(axes, pose, OTHER),
        "gives way": lambda pose: shapes.give_way(axes, pose.x, pose.y - 0.4),
        "brakes for the ego": lambda pose: _braking(axes, pose),
        "has crashed": lambda pose: shapes.burst(axes, pose, 0.4),
        "obstacle": lambda pose: shapes.obstacle(axes, pose),
        "ego's influence": lambda pose: shapes.swatch(axes, pose.x, pose.y),
        "ego's route": lambda pose: shapes.dots(axes, pose.place([(-2.5, 0.0), (2.5, 0.0)])),
    }
    of_some = {"gives way", "obstacle"} - set(marks)
    wanted = [words for words in drawn if words not in of_some]
    for (x, y), words in zip(places, wanted, strict=False):
        drawn[words](shapes.Pose(x, y, 0.0))
        axes.text(x + 5.5, y, words, fontsize=size, va="center", color=shapes.INK)


def _braking(axes: Any, pose: shapes.Pose) -> None:
    shapes.vehicle(axes, pose, OTHER)
    shapes.brake_lights(axes, pose)


def picture(scene: Scene, view: View, inches: float = _INCHES) -> Figure:
    """Draw one scene with a legend, and below it each signal's contribution to the two rewards.

    Args:
        scene: What to draw.
        view: The road.
        inches: Width of the figure.
    """
    sheet = _Sheet([scene], view, inches)
    sheet.show(scene)
    return sheet.figure


def filmstrip(scenes: Sequence[Scene], view: View, captions: Sequence[str] | None = None) -> Figure:
    """Draw scenes as a row of pictures without rewards, five to a line, or one if they are wide.

    Args:
        scenes: The scenes in order.
        view: The road.
        captions: A title for each picture; by default its time.
    """
    from matplotlib.figure import Figure

    ratio = view.frame(scenes[0], strip=True).ratio
    wide, most = (3.0, 5) if ratio > _LOW else (7.5, 1)
    columns = min(most, len(scenes))
    rows, high = -(-len(scenes) // columns), round(wide * ratio + 0.2, 2)
    figure = Figure(figsize=(wide * columns, high * rows), layout="constrained", dpi=_DPI)
    titles = captions or [f"t = {scene.time:.1f} s" for scene in scenes]
    for number, (scene, title) in enumerate(zip(scenes, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.set_title(title, fontsize=10)
        draw(axes, scene, view, strip=True)
    return figure


_LOW = 0.6  # height per width below which a picture has a line of its own


def _shown(scenes: Sequence[Scene], view: View) -> Iterator[Figure]:
    """Yield one figure repeatedly, each time with the next scene, as drawn by `picture`."""
    sheet = _Sheet(scenes, view, _INCHES)
    for scene in scenes:
        sheet.show(scene)
        yield sheet.figure


def save(path: Path, scenes: Sequence[Scene], view: View, frames_per_second: int = 10) -> None:
    """Write a film, whole or not at all.

    Args:
        path: The file: .gif, or .mp4 if ffmpeg is installed.
        scenes: The scenes in order, one frame each.
        view: The road.
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
        content = encoding.gif(_shown(scenes, view), frames_per_second, shapes.COLORS)
    else:
        content = encoding.mp4(_shown(scenes, view), frames_per_second)
    write_atomically(path, content)
