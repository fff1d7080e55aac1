"""Recordings that `data` commands are given: the options of their ego swap, and what they share."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from socialiq.cli.output import print_table, say
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq_recordings import files
from socialiq_recordings.episodes import ego_swap
from socialiq_recordings.episodes.config import LEVELS, EpisodeConfig
from socialiq_recordings.identity.duplicates import Duplicates, identify_distinct, swap_identified
from socialiq_recordings.identity.identify import Identified
from socialiq_recordings.readers.maps import map_of
from socialiq_recordings.recording import Recording
from socialiq_recordings.simulated_source import signs_of_simulation


@dataclass(frozen=True)
class Choices:
    """Options of the conversion of recordings to episodes."""

    policy_rate: int = 1
    """Decisions per second; divides the recording's rate."""
    speeds: tuple[float, ...] = (0.0, 4.5, 9.0)
    """Target speeds that actions step through, m/s; the last is v_max of the rewards."""
    loss: Literal["between_decisions", "summed"] = "between_decisions"
    """A neighbour's loss of speed: from decision to decision, or every fall between frames."""
    near: float = 3.0
    """Seconds that two vehicles may be apart at a conflict to meet there."""
    actions: Literal["meta-actions", "accelerations"] = "meta-actions"
    """Discretisation of decisions: slower, idle, faster; or levels of acceleration."""
    levels: tuple[float, ...] = LEVELS
    """Levels of acceleration, m/s², ascending."""
    influence: Literal["observed", "reasoned"] = "observed"
    """Losses of speed charged to the ego: every neighbour's, or those with a reason."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    duplicates: Duplicates = "drop"
    """Vehicles whose moments are in several recordings: count each once, keep all, or refuse."""

    def config(self) -> EpisodeConfig:
        """Return the options for the library."""
        return EpisodeConfig(
            policy_rate=self.policy_rate,
            target_speeds=self.speeds,
            loss=self.loss,
            near=self.near,
            actions=self.actions,
            levels=self.levels,
            influence=self.influence,
        )


class Swap(NamedTuple):
    """Recordings of some files and their ego swap.

    Attributes:
        recordings: Tracks and roads.
        identified: Their sites, chains and vehicles.
        swapped: Episodes of each.
    """

    recordings: list[Recording]
    identified: Identified
    swapped: list[ego_swap.Swapped]


def swap_all(paths: tuple[Path, ...], choices: Choices, quiet: bool) -> Swap:
    """Return the recordings of some files and their ego swap; say first what they have in common.

    Raises:
        UserError: If there is none, or one can't be read or swapped; the line names it.
    """
    config = choices.config()  # a bad option before the slow work
    recordings, identified = load_identified(paths, choices.road, choices.duplicates, quiet)
    swapped = swap_identified(recordings, identified, config, choices.duplicates)
    return Swap(recordings, identified, swapped)


def load_identified(
    paths: tuple[Path, ...], road: Path | None, duplicates: Duplicates, quiet: bool
) -> tuple[list[Recording], Identified]:
    """Return the recordings of some files and what they have in common, which is said first.

    It goes to the standard error, as everything that is said before a result.

    Args:
        paths: Files of `socialiq data import`.
        road: Map of recordings without one.
        duplicates: Whether moments in common are refused.
        quiet: Whether nothing is said of them.

    Raises:
        UserError: If there is none, one can't be read, or moments in common are refused.
    """
    recordings = load_all(paths, road)
    identified = identify_distinct(recordings, duplicates)
    if quiet:
        return recordings, identified
    with contextlib.redirect_stdout(sys.stderr):
        show_overlaps(identified)
    for one in recordings:
        signs = signs_of_simulation(one.tracks)
        if signs:
            name = one_line(one.tracks.recording, 60)
            say(f"{name} is simulated, not human: {one_line(signs[0])}")
    return recordings, identified


def load_all(paths: tuple[Path, ...], road: Path | None = None) -> list[Recording]:
    """Return the recordings of some files, on a map if one is named.

    Raises:
        UserError: If there is none, or one can't be read; the line names it.
    """
    if not paths:
        raise UserError("no recording: name at least one file of `socialiq data import`")
    found = [files.load(path) for path in paths]
    if road is None:
        return found
    return [Recording(one.tracks, map_of(road, one.tracks.source)) for one in found]


def show_overlaps(identified: Identified) -> None:
    """Print the pairs of recordings with vehicles in common; nothing if there are none."""
    rows = [
        row | {"first": one_line(str(row["first"])), "second": one_line(str(row["second"]))}
        for row in identified.rows()
    ]
    if rows:
        print_table(rows, "Recordings with vehicles in common (lag: of the second's clock, s)")
        sys.stdout.flush()


def sources_of(swapped: list[ego_swap.Swapped]) -> list[dict[str, Any]]:
    """Return provenance by recording."""
    return [{"recording": one.recording, "source": one.source} for one in swapped]
