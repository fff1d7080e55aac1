"""Recordings that are used together: names, and moments that several of them show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq_recordings.identity.identify import Identified, identify
from socialiq_recordings.recording import Recording

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
    check_names([one.tracks.recording for one in recordings])
    identified = identify(recordings)
    if duplicates == "refuse":
        refuse_overlaps(identified)
    return identified


def check_names(names: Sequence[str]) -> None:
    """Raise an error if two recordings have one name."""
    twice = next((name for place, name in enumerate(names) if name in names[:place]), None)
    if twice is not None:
        raise UserError(f"two recordings are named '{one_line(twice)}': give each only once")


def refuse_overlaps(identified: Identified) -> None:
    """Raise an error if recordings have moments in common; the line names them."""
    found = [one for one in identified.overlaps if one.seconds]
    if not found:
        return
    names = [one_line(name, 60) for name in identified.names]
    pairs = [
        f"{names[one.first]} and {names[one.second]} ({one.seconds:.1f} s, {len(one.vehicles)} "
        "vehicles)"
        for one in found[:_NAMED]
    ]
    more = f" and {len(found) - _NAMED} more pairs" if len(found) > _NAMED else ""
    raise UserError(
        f"the same moments are in {', '.join(pairs)}{more}: leave recordings out, or choose "
        "--duplicates drop"
    )
