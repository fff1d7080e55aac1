"""Encode films: a GIF with one palette, or an MP4 if ffmpeg is installed."""

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
from socialiq.worlds.pictures import pixels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LAST_FRAME = 1500  # ms
_CANDIDATES = 1000  # number of colours considered for a palette
_APART = 12  # levels between colours considered


def gif(figures: Iterator[Figure], frames_per_second: int, colors: Sequence[str]) -> bytes:
    """Encode figures as a GIF that repeats and pauses on its last frame.

    Args:
        figures: A figure for each frame; may be the same figure, changed.
        frames_per_second: Frame rate.
        colors: Colours to reproduce exactly, however rare.
    """
    from PIL import Image

    frames = [Image.fromarray(pixels(figure)) for figure in figures]
    palette = _palette(frames, colors)
    first, *later = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [1000 // frames_per_second] * len(later) + [_LAST_FRAME]
    film = io.BytesIO()
    first.save(film, "GIF", save_all=True, append_images=later, duration=durations, loop=0)
    return film.getvalue()


def _palette(frames: Sequence[Any], colors: Sequence[str]) -> Any:
    """Return the given colours, then the film's most frequent other colours."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    sample = [np.asarray(frame)[::2, ::2] for frame in frames[:: 1 + len(frames) // 24]]
    wide = np.stack(sample).reshape(-1, 3).astype(np.int32)
    levels, counts = np.unique(wide @ (1 << 16, 1 << 8, 1), return_counts=True)
    frequent = levels[np.argsort(-counts, kind="stable")[:_CANDIDATES]]
    chosen = np.rint(255 * np.array([to_rgb(color) for color in colors])).astype(np.int32)
    for color in np.stack([frequent >> 16, frequent >> 8 & 255, frequent & 255], axis=-1):
        # Pillow quantises its colour lookup: of two similar colours it may take the wrong one.
        if len(chosen) < 256 and abs(chosen - color).max(axis=1).min() >= _APART:
            chosen = np.concatenate([chosen, color[None]])
    palette = Image.new("P", (1, 1))
    palette.putpalette(chosen.astype(np.uint8).tobytes())
    return palette


def mp4(figures: Iterator[Figure], frames_per_second: int) -> bytes:
    """Encode figures as an MP4.

    Args:
        figures: A figure for each frame; always the same figure, changed.
        frames_per_second: Frame rate.

    Raises:
        UserError: If ffmpeg is missing or fails.
    """
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
