"""Pictures of the intersection: one decision with its rewards, a film, and a filmstrip."""

from __future__ import annotations

import io
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.storage import write_atomically
from socialiq.types import RewardPair
from socialiq.worlds import drawing
from socialiq.worlds.intersection import shapes
from socialiq.worlds.pictures import pixels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REACH = 50.0
SOCIAL = ("yielding", "disruption", "neighbour_collision")
"""Signals that are part of r_social; all others are part of r_env."""

_SOUTHWARDS = 0.16  # the view looks this part of its reach further south: there the ego starts
_DPI = 100
_LAST_FRAME = 1500  # ms
_COLORS = 200
_LABEL: dict[str, Any] = {
    "ha": "center",
    "va": "center",
    "color": shapes.INK,
    "bbox": {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 0.6},
}


class Scene(NamedTuple):
    """What one picture shows.

    Attributes:
        vehicles: The vehicles present, records of `state.VEHICLE`.
        ego: Which of them is the ego.
        braking: Which of them brake because of the ego, bool, as long as `vehicles`.
        signals: Weighted contributions to the rewards of the decision so far, by name.
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
        reach: Metres in sight to the west and east of the centre; a little less to the north,
            a little more to the south, where the ego comes from.
    """
    _ground(axes, reach)
    _traffic(axes, scene, reach)


def _ground(axes: Any, reach: float) -> None:
    south = (1 + _SOUTHWARDS) * reach
    axes.set(xlim=(-reach, reach), ylim=(south, south - 2 * reach), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    shapes.road(axes, 2 * reach)


def _traffic(axes: Any, scene: Scene, reach: float) -> None:
    ego = scene.vehicles[scene.ego]
    lanes = shapes.legs(int(ego["origin"]), int(ego["destination"]))
    shapes.zone(axes, lanes)
    shapes.route(axes, lanes, float(ego["x"]), float(ego["y"]))
    for slot, record in enumerate(scene.vehicles):
        _vehicle(axes, record, slot == scene.ego, bool(scene.braking[slot]), reach)


def _vehicle(axes: Any, record: np.void, is_ego: bool, brakes: bool, reach: float) -> None:
    pose = shapes.Pose(float(record["x"]), float(record["y"]), float(record["heading"]))
    if record["crashed"]:
        shapes.burst(axes, pose)
    shapes.vehicle(axes, pose, drawing.EGO if is_ego else drawing.OTHER)
    if brakes:
        shapes.brake_lights(axes, pose)
    if record["yielding"]:
        shapes.give_way(axes, *shapes.beside(pose, -1.8, 0.6, (1.7, 1.5)))
    _speed(axes, pose, float(record["speed"]), is_ego, reach)


def _speed(axes: Any, pose: shapes.Pose, speed: float, is_ego: bool, reach: float) -> None:
    """Write a car's speed on its right; the ego's with the unit."""
    text = f"{speed:.1f} m/s" if is_ego else f"{speed:.1f}"
    per_metre = _per_metre(axes, reach)
    size = max(5.5, 1.9 * per_metre)
    tall = size / per_metre
    x, y = shapes.beside(pose, 1.2, 1.4, (0.31 * tall * len(text), 0.5 * tall))
    axes.text(x, y, text, fontsize=size, clip_on=True, zorder=9, **_LABEL)


def _per_metre(axes: Any, reach: float) -> float:
    """Points on paper per metre of the world."""
    place = axes.get_position(original=True)
    inches = axes.figure.get_size_inches() * (place.width, place.height)
    return 72 * float(inches.min()) / (2 * reach)


class _Sheet:
    """A figure that shows one scene after the other: the road, a legend, the rewards under it."""

    def __init__(self, scenes: Sequence[Scene], inches: float) -> None:
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(inches, 1.25 * inches), dpi=_DPI)
        self.names = tuple(dict.fromkeys(name for scene in scenes for name in scene.signals))
        values = [abs(value) for scene in scenes for value in scene.signals.values()]
        self.bound = max([0.1, *values])
        self.scale = inches / 6
        self.road = self.figure.add_axes((0.01, 0.19, 0.98, 0.784))
        self.panels = [self.figure.add_axes((left, 0.01, 0.33, 0.14)) for left in (0.16, 0.65)]
        _ground(self.road, REACH)
        _legend(self.road, 8 * self.scale)
        self.kept = set(self.road.get_children())

    def show(self, scene: Scene) -> None:
        """Replace what is shown."""
        for artist in self.road.get_children():
            if artist not in self.kept:
                artist.remove()
        _traffic(self.road, scene, REACH)
        size = 10 * self.scale
        self.road.set_title(scene.caption, fontsize=size, loc="left", pad=4)
        self.road.set_title(f"t = {scene.time:.1f} s", fontsize=size, loc="right", pad=4)
        self._show_rewards(scene)

    def _show_rewards(self, scene: Scene) -> None:
        social = [name for name in self.names if name in SOCIAL]
        env = [name for name in self.names if name not in SOCIAL]
        rows = max(len(env), len(social), 1)
        for axes, names, color, total, label in (
            (self.panels[0], env, drawing.EGO, scene.rewards.env, "r_env"),
            (self.panels[1], social, drawing.OTHER, scene.rewards.social, "r_social"),
        ):
            axes.clear()
            values = [float(scene.signals.get(name, 0.0)) for name in names]
            self._bars(axes, names, values, color)
            axes.set_ylim(rows - 0.4, -0.6)
            title = f"{label} = {_signed(float(total))}"
            axes.set_title(
                title, fontsize=9 * self.scale, color=color, weight="bold", loc="left", pad=1
            )

    def _bars(self, axes: Any, names: Sequence[str], values: Sequence[float], color: str) -> None:
        size = 7.5 * self.scale
        rows = range(len(names))
        axes.barh(rows, values, height=0.7, color=color)
        axes.axvline(0, color=shapes.INK, linewidth=0.8)
        axes.set(xlim=(-self.bound, 1.9 * self.bound), xticks=[])
        axes.set_yticks(rows, [name.replace("_", " ") for name in names], fontsize=size)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        for row, value in zip(rows, values, strict=True):
            shade = shapes.INK if value else "#999999"
            at = 1.85 * self.bound
            axes.text(at, row, _signed(value), fontsize=size, ha="right", va="center", color=shade)


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−") if value else "0"


def _legend(axes: Any, size: float) -> None:
    """Explain the marks in the north-eastern corner, each drawn as it is on the road."""
    rows = [shapes.Pose(18.0, -39.0 + 4.0 * row, 0.0) for row in range(7)]
    ego, other, yields, brakes, crashed, zone, way = rows
    words = ("ego", "other driver", "gives way", "brakes for the ego", "has crashed")
    for row, text in zip(rows, (*words, "ego's influence", "ego's route"), strict=True):
        axes.text(23.5, row.y, text, fontsize=size, va="center", color=shapes.INK)
    shapes.vehicle(axes, ego, drawing.EGO)
    shapes.vehicle(axes, other, drawing.OTHER)
    shapes.give_way(axes, yields.x, yields.y - 0.4)
    shapes.vehicle(axes, brakes, drawing.OTHER)
    shapes.brake_lights(axes, brakes)
    shapes.burst(axes, crashed, 0.4)
    shapes.swatch(axes, zone.x, zone.y)
    shapes.dots(axes, way.place([(-2.5, 0.0), (2.5, 0.0)]))


def picture(scene: Scene, inches: float = 6.0) -> Figure:
    """Draw one scene with a legend, and under it what each signal adds to the two rewards.

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
        reach: Metres in sight, as for `draw`.
    """
    from matplotlib.figure import Figure

    columns = min(5, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = Figure(figsize=(3.0 * columns, 3.25 * rows), layout="constrained", dpi=_DPI)
    titles = captions or [f"t = {scene.time:.1f} s" for scene in scenes]
    for number, (scene, title) in enumerate(zip(scenes, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.set_title(title, fontsize=10)
        draw(axes, scene, reach)
    return figure


def animation(scenes: Sequence[Scene], inches: float = 6.0) -> Iterator[np.ndarray]:
    """Draw scenes as the frames of a film, each as `picture` does.

    Args:
        scenes: The scenes in order, one frame each.
        inches: Width of a frame at 100 pixels to the inch.

    Yields:
        RGB, uint8 (height, width, 3).
    """
    sheet = _Sheet(scenes, inches)
    for scene in scenes:
        sheet.show(scene)
        yield pixels(sheet.figure)


def save(path: Path, scenes: Sequence[Scene], frames_per_second: int = 10) -> None:
    """Write a film, whole or not at all.

    Args:
        path: The file: .gif, or .mp4 if ffmpeg is installed.
        scenes: The scenes in order, one frame each.
        frames_per_second: 1 to 50.

    Raises:
        UserError: If there is nothing to show, the suffix is another, ffmpeg is missing or fails,
            the rate is out of range, or the file can't be written.
    """
    encoders = {".gif": _gif, ".mp4": _mp4}
    if path.suffix not in encoders:
        raise UserError(f"cannot write films as '{path.suffix}': choose a .gif or .mp4")
    if not scenes:
        raise UserError("a film needs at least one scene: record an episode first")
    if not 1 <= frames_per_second <= 50:
        raise UserError(f"frames_per_second must lie between 1 and 50, got {frames_per_second}")
    if not path.parent.is_dir():
        raise UserError(f"cannot write {path}: no folder {path.parent}; make it first")
    write_atomically(path, encoders[path.suffix](scenes, frames_per_second))


def _gif(scenes: Sequence[Scene], frames_per_second: int) -> bytes:
    from PIL import Image

    frames = [Image.fromarray(frame) for frame in animation(scenes)]
    palette = _palette(frames)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [1000 // frames_per_second] * len(others) + [_LAST_FRAME]
    film = io.BytesIO()
    first.save(film, "GIF", save_all=True, append_images=others, duration=durations, loop=0)
    return film.getvalue()


def _palette(frames: Sequence[Any]) -> Any:
    """The named colours, which may be rare, and then the most frequent ones of the film."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    named = np.rint(255 * np.array([to_rgb(color) for color in shapes.COLORS])).astype(np.uint8)
    sample = [np.asarray(frame)[::2, ::2] for frame in frames[:: 1 + len(frames) // 24]]
    colors, counts = np.unique(_packed(np.stack(sample)), return_counts=True)
    frequent = colors[np.argsort(-counts, kind="stable")[:_COLORS]]
    unpacked = np.stack([frequent >> 16, frequent >> 8 & 255, frequent & 255], axis=-1)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.concatenate([named, unpacked.astype(np.uint8)]).tobytes())
    return palette


def _packed(pixels: np.ndarray) -> np.ndarray:
    wide = pixels.astype(np.int32)
    return (wide[..., 0] << 16 | wide[..., 1] << 8 | wide[..., 2]).ravel()


def _mp4(scenes: Sequence[Scene], frames_per_second: int) -> bytes:
    from matplotlib.animation import FFMpegWriter

    if not FFMpegWriter.isAvailable():
        raise UserError("cannot write .mp4 without ffmpeg: choose a .gif, or install ffmpeg")
    sheet = _Sheet(scenes, 6.0)
    writer = FFMpegWriter(frames_per_second)
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        try:
            with writer.saving(sheet.figure, str(film), _DPI):
                for scene in scenes:
                    sheet.show(scene)
                    writer.grab_frame()
            return film.read_bytes()
        except (OSError, subprocess.CalledProcessError) as error:
            raise UserError(f"ffmpeg failed ({error}): choose a .gif, or mend ffmpeg") from error
