"""Recordings that are used together: names, and what several of them show, counted once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Literal, TypeVar, get_args

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq_recordings.identity.identify import Identified, identify
from socialiq_recordings.recording import Recording, Tracks

Place = tuple[int, int]
"""Index of a recording and number of a track."""

Key = TypeVar("Key")


def same_moments(identified: Identified) -> dict[Place, set[Place]]:
    """Return for each track those of other recordings that show it at the same moments.

    Args:
        identified: Of all recordings.
    """
    same: dict[Place, set[Place]] = {}
    for overlap in identified.overlaps:
        for track, other_track in overlap.vehicles if overlap.seconds else ():
            pair = (overlap.first, track), (overlap.second, other_track)
            for a, b in (pair, pair[::-1]):
                same.setdefault(a, set()).add(b)
    return same


def once(sizes: Mapping[Key, float], same: Callable[[Key], Iterable[Key]]) -> set[Key]:
    """Return the largest of each group of equal things; the first of those of one size.

    Args:
        sizes: Size of each thing.
        same: Function that returns the things that equal one.
    """
    largest: set[Key] = set()
    for item in sorted(sizes, key=lambda key: -sizes[key]):
        if not largest.intersection(same(item)):
            largest.add(item)
    return largest


def tracks_kept(recorded: Sequence[Tracks], identified: Identified) -> set[Place]:
    """Return the tracks that no other recording shows for longer.

    Args:
        recorded: Tracks of each recording.
        identified: Of the same recordings.
    """
    same = same_moments(identified)
    sizes = {
        (recording, track): float(count)
        for recording, tracks in enumerate(recorded)
        for track, count in enumerate(np.diff(tracks.starts).tolist())
    }
    return once(sizes, lambda key: same.get(key, ()))


def pairs_once(
    sizes: Mapping[tuple[int, int, int], float], identified: Identified
) -> set[tuple[int, int, int]]:
    """Return the pairs of tracks that are kept: of two that show one conflict, the longer.

    Args:
        sizes: Duration of each conflict, by recording, ego and other.
        identified: Of all recordings.
    """
    same = same_moments(identified)

    def equal(key: tuple[int, int, int]) -> list[tuple[int, int, int]]:
        recording, ego, partner = key
        return [
            (there, ego_there, two)
            for there, ego_there in same.get((recording, ego), ())
            for where, two in same.get((recording, partner), ())
            if where == there
        ]

    return once(sizes, equal)


Duplicates = Literal["drop", "keep", "refuse"]
"""Treatment of vehicles whose moments are in several recordings: the longest track of each is
kept, or all are, or the recordings are refused."""

_NAMED = 3  # pairs that a refusal names


def identify_distinct(
    recordings: Sequence[Recording], duplicates: Duplicates = "drop"
) -> Identified:
    """Return sites, chains and vehicles of recordings.

    Args:
        recordings: Tracks and roads.
        duplicates: Treatment of vehicles whose moments are in several recordings.

    Raises:
        UserError: If two recordings have one name, or moments are in common and `duplicates` is
            "refuse".
    """
    one_of("duplicates", duplicates, get_args(Duplicates))
    check_names([recording.tracks.recording for recording in recordings])
    identified = identify(recordings)
    if duplicates == "refuse":
        refuse_overlaps(identified)
    return identified


def check_names(names: Sequence[str]) -> None:
    """Raise an error if two recordings have one name."""
    twice = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if twice is not None:
        raise UserError(f"two recordings are named '{one_line(twice)}': give each only once")


def refuse_overlaps(identified: Identified) -> None:
    """Raise an error if recordings have moments in common; the line names them."""
    overlapping = [overlap for overlap in identified.overlaps if overlap.seconds]
    if not overlapping:
        return
    names = [one_line(name, 60) for name in identified.names]
    pairs = [
        f"{names[one.first]} and {names[one.second]} ({one.seconds:.1f} s, {len(one.vehicles)} "
        "vehicles)"
        for one in overlapping[:_NAMED]
    ]
    remainder = f" and {len(overlapping) - _NAMED} more pairs" if len(overlapping) > _NAMED else ""
    raise UserError(
        f"the same moments are in {', '.join(pairs)}{remainder}: leave recordings out, or choose "
        "--duplicates drop"
    )
