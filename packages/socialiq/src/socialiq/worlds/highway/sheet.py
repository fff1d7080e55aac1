"""Pictures and films of roads with a legend and, below the road, each decision's rewards."""

from __future__ import annotations

import io
import itertools
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import drawing
from socialiq.storage import write_atomically
from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.options import SOCIAL_SIGNALS
from socialiq.worlds.highway.render import DPI, Scene, View, look, traffic
from socialiq.worlds.pictures import EGO, OTHER, pixels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LAST_FRAME = 1500  # ms
_CANDIDATES = 1000  # number of colours considered for a palette
_APART = 12  # levels between colours considered


def _gif(figures: Iterator[Figure], frames_per_second: int) -> bytes:
    """Encode figures as a GIF that repeats and pauses on its last frame."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    frames = [Image.fromarray(pixels(figure)) for figure in figures]
    sample = [np.asarray(frame)[::2, ::2] for frame in frames[:: 1 + len(frames) // 24]]
    wide = np.stack(sample).reshape(-1, 3).astype(np.int32)
    levels, counts = np.unique(wide @ (1 << 16, 1 << 8, 1), return_counts=True)
    frequent = levels[np.argsort(-counts, kind="stable")[:_CANDIDATES]]
    colors = np.rint(255 * np.array([to_rgb(color) for color in shapes.COLORS])).astype(np.int32)
    for color in np.stack([frequent >> 16, frequent >> 8 & 255, frequent & 255], axis=-1):
        # Pillow quantises its colour lookup: of two similar colours it may take the wrong one.
        if len(colors) < 256 and abs(colors - color).max(axis=1).min() >= _APART:
            colors = np.concatenate([colors, color[None]])
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors.astype(np.uint8).tobytes())
    first, *later = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [1000 // frames_per_second] * len(later) + [_LAST_FRAME]
    film = io.BytesIO()
    first.save(film, "GIF", save_all=True, append_images=later, duration=durations, loop=0)
    return film.getvalue()


def _mp4(figures: Iterator[Figure], frames_per_second: int) -> bytes:
    """Encode figures, always the same one, changed, as an MP4; ffmpeg may be missing or fail."""
    from matplotlib.animation import FFMpegWriter

    if not FFMpegWriter.isAvailable():
        raise UserError("cannot write .mp4 without ffmpeg: choose a .gif, or install ffmpeg")
    figure = next(figures)
    writer = FFMpegWriter(frames_per_second)
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        try:
            with writer.saving(figure, str(film), figure.dpi):
                for _ in itertools.chain([figure], figures):
                    writer.grab_frame()
            return film.read_bytes()
        except (OSError, subprocess.CalledProcessError) as error:
            raise UserError("ffmpeg failed: choose a .gif, or repair ffmpeg") from error


_INCHES = 6.0  # width of a picture
_BELOW = 0.2375  # height of the rewards, as a share of the width
_ABOVE = 0.0325  # height of the caption, as a share of the width
_LEGEND = 0.085  # height of the legend, as a share of the width
_WIDE = 0.98  # of the width: the road


class _Sheet:
    """Figure that shows a sequence of scenes: the road, a legend, and the rewards below."""

    def __init__(self, scenes: Sequence[Scene], view: View, inches: float) -> None:
        self.view = view
        high = _WIDE * view.frame(scenes[0]).ratio
        legend = 0.0 if view.corner else _LEGEND
        pairs = round(inches * (_BELOW + high + legend + _ABOVE) * DPI / 2)  # films: even rows
        self.rise = pairs * 2 / DPI / inches
        self.figure = drawing().Figure(figsize=(inches, inches * self.rise), dpi=DPI)
        self.road = self.axes(0.01, _BELOW, _WIDE, high)
        view.ground(self.road)
        look(self.road, view.frame(scenes[0]))
        if view.corner:
            column = [(view.corner[0], view.corner[1] + 4.0 * row) for row in range(7)]
            _legend(self.road, column, view.marks, 8 * inches / 6)
        else:
            strip = self.axes(0.01, _BELOW + high, _WIDE, legend)
            strip.set(xlim=(0.0, 100 * _WIDE), ylim=(100 * legend, 0.0))
            grid = [(x, 2.2 + 4.2 * row) for row in range(2) for x in (3.5, 25.0, 50.0, 80.0)]
            _legend(strip, grid, view.marks, 8 * inches / 6)
        self.kept = set(self.road.get_children())
        # Not the axes' titles: matplotlib repositions those, slowly, at every draw.
        size = 10 * inches / 6
        top = 1 - 0.02375 / self.rise
        self.caption = self.figure.text(0.01, top, "", fontsize=size)
        self.time = self.figure.text(0.99, top, "", fontsize=size, ha="right")
        names = dict.fromkeys(name for scene in scenes for name in scene.signals)
        env = [name for name in names if name not in SOCIAL_SIGNALS]
        social = [name for name in names if name in SOCIAL_SIGNALS]
        values = [abs(float(value)) for scene in scenes for value in scene.signals.values()]
        size = max(len(env), len(social), 1), max([0.1, *values])
        self.bars = {}
        self.values = {}
        self.totals = []
        self._add_panel(0.14, env, EGO, *size)
        self._add_panel(0.68, social, OTHER, *size)

    def _add_panel(
        self, left: float, names: Sequence[str], color: str, rows: int, bound: float
    ) -> None:
        """Add bars of each signal's contribution to one reward, with the total above."""
        axes = self.axes(left, 0.0125, 0.3, 0.175)
        scale = self.figure.get_figwidth() / 6
        style = {"fontsize": 7.5 * scale, "va": "center", "ha": "right", "color": shapes.INK}
        axes.axvline(0, color=shapes.INK, linewidth=0.8)
        for row, name in enumerate(names):
            axes.text(-1.1 * bound, row, name.replace("_", " "), **style)
            (self.bars[name],) = axes.barh(row, 0.0, 0.7, color=color)
            self.values[name] = axes.text(1.9 * bound, row, "", **style)
        axes.set(xlim=(-bound, 1.9 * bound), ylim=(rows - 0.4, -0.6))
        bold = {"fontsize": 9 * scale, "color": color, "weight": "bold"}
        corner = axes.get_position().x0, 0.195 / self.rise
        self.totals.append(self.figure.text(*corner, "", **bold))

    def axes(self, left: float, below: float, wide: float, high: float) -> Any:
        """Add axes without a frame; all lengths are parts of the figure's width.

        Args:
            left: Distance from the figure's left edge.
            below: Distance from its lower edge.
            wide: Width.
            high: Height.
        """
        axes = self.figure.add_axes((left, below / self.rise, wide, high / self.rise))
        axes.set_axis_off()
        return axes

    def show(self, scene: Scene) -> None:
        """Show another scene."""
        for artist in self.road.get_children():
            if artist not in self.kept:
                artist.remove()
        look(self.road, self.view.frame(scene))
        traffic(self.road, scene, self.view)
        self.caption.set_text(scene.caption)
        self.time.set_text(f"t = {scene.time:.1f} s")
        rewards = zip(self.totals, ("r_env", "r_social"), scene.rewards, strict=True)
        for total, name, reward in rewards:
            total.set_text(f"{name} = {_signed(float(reward))}")
        for name, bar in self.bars.items():
            value = float(scene.signals.get(name, 0.0))
            bar.set_width(value)
            self.values[name].set(text=_signed(value), color=shapes.INK if value else shapes.FAINT)


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−") if value else "0"


def _legend(
    axes: Any, places: Sequence[tuple[float, float]], marks: tuple[str, ...], size: float
) -> None:
    """Draw the legend, each mark as it appears on the road, at as many places as are needed."""

    def draw_influence(pose: shapes.Pose) -> None:
        line = pose.to_world([(-2.5, 0.0), (2.5, 0.0)])
        shapes.band(axes, line, width=3.0, facecolor=shapes.ASPHALT, zorder=1)
        shapes.band(axes, line, width=3.0)

    def draw_braking(pose: shapes.Pose) -> None:
        shapes.vehicle(axes, pose, OTHER)
        shapes.brake_lights(axes, pose)

    marks_of = {
        "ego": lambda pose: shapes.vehicle(axes, pose, EGO),
        "other driver": lambda pose: shapes.vehicle(axes, pose, OTHER),
        "gives way": lambda pose: shapes.give_way(axes, pose.x, pose.y - 0.4),
        "brakes for the ego": draw_braking,
        "has crashed": lambda pose: shapes.burst(axes, pose, 0.4),
        "obstacle": lambda pose: shapes.obstacle(axes, pose),
        "ego's influence": draw_influence,
        "ego's route": lambda pose: shapes.dots(axes, pose.to_world([(-2.5, 0.0), (2.5, 0.0)])),
    }
    of_some = {"gives way", "obstacle"} - set(marks)
    words_of = [words for words in marks_of if words not in of_some]
    for (x, y), words in zip(places, words_of, strict=False):
        marks_of[words](shapes.Pose(x, y, 0.0))
        axes.text(x + 5.5, y, words, fontsize=size, va="center", color=shapes.INK)


def picture(scene: Scene, view: View, inches: float = _INCHES) -> Figure:
    """Draw one scene with a legend, and below it each signal's contribution to the two rewards.

    Args:
        scene: Scene to draw.
        view: Road of the scene.
        inches: Width of the figure; its height follows from the view.
    """
    sheet = _Sheet([scene], view, inches)
    sheet.show(scene)
    return sheet.figure


def _shown(scenes: Sequence[Scene], view: View) -> Iterator[Figure]:
    """Yield one figure repeatedly, each time with the next scene, as drawn by `picture`."""
    sheet = _Sheet(scenes, view, _INCHES)
    for scene in scenes:
        sheet.show(scene)
        yield sheet.figure


def save(path: Path, scenes: Sequence[Scene], view: View, frames_per_second: int = 10) -> None:
    """Write a film, whole or not at all.

    Args:
        path: File, a .gif, or a .mp4 if ffmpeg is installed.
        scenes: Frames of the film; at least one.
        view: Road of the scenes.
        frames_per_second: From 1 to 50.

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
        content = _gif(_shown(scenes, view), frames_per_second)
    else:
        content = _mp4(_shown(scenes, view), frames_per_second)
    write_atomically(path, content)
