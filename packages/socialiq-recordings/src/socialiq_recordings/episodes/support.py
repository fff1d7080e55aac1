"""Rate of decisions that recorded accelerations support, and what discretisations leave out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64

from socialiq.types import Row
from socialiq.worlds.intersection.state import IDLE
from socialiq_recordings.episodes import actions, decisions
from socialiq_recordings.episodes.annotate import Driven
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.decisions import MOVING
from socialiq_recordings.tracks import Tracks

DURATIONS = (0.1, 0.2, 0.4, 0.5, 1.0, 2.0)
"""s; durations of a decision that are tried, where they are whole numbers of frames."""

LEAST_RELIABILITY = 0.8
"""Share of the variance of accelerations that must not be error (Nunnally 1978, chapter 7)."""

CHANGE = 1.0
"""m/s; smallest change of speed between two decisions that counts as one."""

STRONGEST = 5.0
"""m/s²; harder accelerations are mostly errors of positions (compare Punzo, Borzacchiello and
Ciuffo 2011, Transportation Research C 19)."""


def reliability(
    one: Float64[np.ndarray, " decision"], other: Float64[np.ndarray, " decision"]
) -> float:
    """Return the share of variance that two measurements of one quantity have in common.

    1 - var(one - other) / (var(one) + var(other)): the intraclass correlation of two measurements
    without a difference of their means (Fisher 1925, section 38). Errors that both have in common
    don't show, so that it is an upper bound. NaN if neither varies.
    """
    total = float(np.var(one) + np.var(other)) if len(one) else 0.0
    return 1.0 - float(np.var(one - other)) / total if total > 0 else float("nan")


def rates(recorded: Sequence[Tracks], durations: Sequence[float] = DURATIONS) -> list[Row]:
    """Return how well accelerations are measured, by duration of a decision.

    Accelerations are measured twice: from the stated speeds, and from the positions alone. Only
    decisions count in which the vehicle is faster than `MOVING` at one end.

    Args:
        recorded: Tracks of each recording.
        durations: s; those that are no whole number of frames in any recording are left out.

    Returns:
        For each duration: decisions, standard deviations in m/s², reliability, and the share of
        accelerations beyond `STRONGEST`.
    """
    rows: list[Row] = []
    for seconds in durations:
        pairs = [_measured(tracks, seconds) for tracks in recorded]
        stated, positions = (np.concatenate(column) for column in zip(*pairs, strict=True))
        if len(stated):
            rows.append(
                {
                    "seconds": seconds,
                    "decisions": len(stated),
                    "sd_of_speeds": float(stated.std()),
                    "sd_of_positions": float(positions.std()),
                    "reliability": reliability(stated, positions),
                    "beyond_5": float((np.abs(stated) > STRONGEST).mean()),
                }
            )
    return rows


def supported(rows: Sequence[Row]) -> float | None:
    """Return the shortest duration whose accelerations are reliable enough, s; None if none is.

    Args:
        rows: Of `rates`.
    """
    for row in rows:
        if row["reliability"] >= LEAST_RELIABILITY:
            return float(row["seconds"])
    return None


def _measured(
    tracks: Tracks, seconds: float
) -> tuple[Float64[np.ndarray, " decision"], Float64[np.ndarray, " decision"]]:
    frames = round(seconds / tracks.dt)
    stated, positions = [np.zeros(0)], [np.zeros(0)]
    if frames < 1 or abs(frames * tracks.dt - seconds) > 1e-6:
        return stated[0], positions[0]
    speed, _ = tracks.along_and_across()
    starts = tracks.starts
    for first, last in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        rows = np.arange(first + 1, last - 1, frames)  # both neighbours of each are there
        if len(rows) < 2:
            continue
        moved = _moved(tracks, rows)
        faster = np.maximum(speed[rows][:-1], speed[rows][1:]) >= MOVING
        stated.append((np.diff(speed[rows]) / seconds)[faster])
        positions.append((np.diff(moved) / seconds)[faster])
    return np.concatenate(stated), np.concatenate(positions)


def _moved(tracks: Tracks, rows: np.ndarray) -> Float64[np.ndarray, " state"]:
    """Return speeds along the heading by central differences of the positions, m/s."""
    dx, dy = (tracks.x[rows + 1] - tracks.x[rows - 1], tracks.y[rows + 1] - tracks.y[rows - 1])
    heading = tracks.heading[rows]
    return (dx * np.cos(heading) + dy * np.sin(heading)) / (2 * tracks.dt)


def left_out(driven: Sequence[Driven], dts: Sequence[float], config: EpisodeConfig) -> list[Row]:
    """Return what each discretisation of the same decisions leaves out.

    Args:
        driven: Episodes.
        dts: s between frames of each episode's recording.
        config: The options under which they were made.

    Returns:
        For the meta-actions and the levels of acceleration: decisions, those that change the
        speed by `CHANGE` or more, the share of these that are labelled as no change, the share of
        the summed squares of all changes that the labels leave, and the residual's root mean
        square.
    """
    seconds = 1 / config.policy_rate
    change = np.concatenate([np.diff(one.speed) for one in driven])
    meta = [
        actions.inferred(one.speed, config.options_at(dt))
        for one, dt in zip(driven, dts, strict=True)
    ]
    levels = [decisions.levels_of(one.speed, config.levels, seconds) for one in driven]
    zero = int(np.argmin(np.abs(config.levels)))
    return [
        _left_out(name, change, np.concatenate([one.action for one in found]) == none, found)
        for name, none, found in (("meta-actions", IDLE, meta), ("accelerations", zero, levels))
    ]


def _left_out(
    name: str,
    change: Float64[np.ndarray, " decision"],
    none: Bool[np.ndarray, " decision"],
    found: Sequence[actions.Inferred] | Sequence[decisions.Levels],
) -> Row:
    residual = np.concatenate([one.residual for one in found])
    large = np.abs(change) >= CHANGE
    return {
        "actions": name,
        "decisions": len(change),
        "changes": int(large.sum()),
        "labelled_none": float(none[large].mean()) if large.any() else float("nan"),
        "brakings_labelled_none": _share(none, change <= -CHANGE),
        "squares_left": float((residual**2).sum() / (change**2).sum()),
        "residual_rms": float(np.sqrt((residual**2).mean())),
    }


def _share(chosen: Bool[np.ndarray, " decision"], of: Bool[np.ndarray, " decision"]) -> float:
    return float(chosen[of].mean()) if of.any() else float("nan")
