"""Tracks and conflicts that several recordings show, each counted once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from socialiq_recordings.identity.identify import Identified
from socialiq_recordings.tracks import Tracks

Place = tuple[int, int]
"""Index of a recording and number of a track."""

Key = TypeVar("Key")


def same_moments(identified: Identified) -> dict[Place, set[Place]]:
    """Return for each track those of other recordings that show it at the same moments.

    Args:
        identified: Of all recordings.
    """
    same: dict[Place, set[Place]] = {}
    for one in identified.overlaps:
        for mine, theirs in one.vehicles if one.seconds else ():
            pair = (one.first, mine), (one.second, theirs)
            for a, b in (pair, pair[::-1]):
                same.setdefault(a, set()).add(b)
    return same


def once(sizes: Mapping[Key, float], same: Callable[[Key], Iterable[Key]]) -> set[Key]:
    """Return the largest of each group of equal things; the first of those of one size.

    Args:
        sizes: Size of each thing.
        same: Function that returns the things that equal one.
    """
    kept: set[Key] = set()
    for one in sorted(sizes, key=lambda key: -sizes[key]):
        if not kept.intersection(same(one)):
            kept.add(one)
    return kept


def tracks_kept(recorded: Sequence[Tracks], identified: Identified) -> set[Place]:
    """Return the tracks that no other recording shows for longer.

    Args:
        recorded: Tracks of each recording.
        identified: Of the same recordings.
    """
    same = same_moments(identified)
    sizes = {
        (place, track): float(count)
        for place, tracks in enumerate(recorded)
        for track, count in enumerate(np.diff(tracks.starts).tolist())
    }
    return once(sizes, lambda key: same.get(key, ()))


def tracks_once(recorded: Sequence[Tracks], identified: Identified) -> list[Tracks]:
    """Return the tracks of each recording without those that another shows for longer.

    Args:
        recorded: Tracks of each recording.
        identified: Of the same recordings.
    """
    kept = tracks_kept(recorded, identified)
    masks = [
        np.array([(place, track) in kept for track in range(tracks.n_tracks)])
        for place, tracks in enumerate(recorded)
    ]
    return [t.kept(mask) for t, mask in zip(recorded, masks, strict=True) if mask.any()]


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
        place, ego, other = key
        return [
            (there, one, two)
            for there, one in same.get((place, ego), ())
            for where, two in same.get((place, other), ())
            if where == there
        ]

    return once(sizes, equal)
