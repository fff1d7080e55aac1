"""Ego swap of several recordings, with each vehicle that several of them show counted once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal, get_args

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.ego_swap import DUPLICATE, Swapped, swap
from socialiq_recordings.identity.identify import Identified, identify
from socialiq_recordings.identity.once import once, same_moments
from socialiq_recordings.recording import Recording

Duplicates = Literal["drop", "keep", "refuse"]
"""Treatment of vehicles whose moments are in several recordings: the longest episode of each is
kept, or all are, or the recordings are refused."""

_NAMED = 3  # pairs that a refusal names


def swap_distinct(
    recordings: Sequence[Recording],
    config: EpisodeConfig | None = None,
    duplicates: Duplicates = "drop",
    tell: Callable[[Identified], None] | None = None,
) -> list[Swapped]:
    """Return the ego swap of recordings whose sites, chains and vehicles are identified.

    Args:
        recordings: Tracks and roads.
        config: Options; by default those of `EpisodeConfig`.
        duplicates: Treatment of vehicles whose moments are in several recordings.
        tell: Called with what was identified, before the slow work.

    Raises:
        UserError: If two recordings have one name, moments are in common and `duplicates` is
            "refuse", or a recording can't be swapped; the line names it.
    """
    identified = identify_distinct(recordings, duplicates)
    if tell is not None:
        tell(identified)
    return swap_identified(recordings, identified, config, duplicates)


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


def swap_identified(
    recordings: Sequence[Recording],
    identified: Identified,
    config: EpisodeConfig | None = None,
    duplicates: Duplicates = "drop",
) -> list[Swapped]:
    """Return `swap_distinct` of recordings that are identified already.

    Args:
        recordings: Tracks and roads.
        identified: Of the same recordings.
        config: Options; by default those of `EpisodeConfig`.
        duplicates: Treatment of vehicles whose moments are in several recordings.

    Raises:
        UserError: If a recording can't be swapped; the line names it.
    """
    swapped = []
    for one in recordings:
        try:
            swapped.append(swap(one, config))
        except UserError as error:
            raise UserError(f"{one_line(one.tracks.recording)}: {error}") from error
    return labelled(recordings, swapped, identified, duplicates)


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


def labelled(
    recordings: Sequence[Recording],
    swapped: Sequence[Swapped],
    identified: Identified,
    duplicates: Duplicates = "drop",
) -> list[Swapped]:
    """Return the episodes with their sites, chains and vehicles, and without duplicates."""
    dropped = _dropped(recordings, swapped, identified) if duplicates == "drop" else set()
    found = []
    for place, (one, recording) in enumerate(zip(swapped, recordings, strict=True)):
        track = {int(number): at for at, number in enumerate(recording.tracks.identity)}
        kept = [
            at for at, number in enumerate(one.identity) if (place, track[number]) not in dropped
        ]
        gone = len(one.identity) - len(kept)
        found.append(
            dataclasses.replace(
                one,
                identity=tuple(one.identity[at] for at in kept),
                episodes=tuple(one.episodes[at] for at in kept),
                left_out=one.left_out | ({DUPLICATE: gone} if gone else {}),
                site=identified.site[place],
                chain=identified.chain[place],
                vehicle=tuple(
                    int(identified.vehicle[place][track[one.identity[at]]]) for at in kept
                ),
            )
        )
    return found


def _dropped(
    recordings: Sequence[Recording], swapped: Sequence[Swapped], identified: Identified
) -> set[tuple[int, int]]:
    """Return recording and track of the episodes whose vehicle has a longer one elsewhere."""
    length: dict[tuple[int, int], float] = {}
    for place, (one, recording) in enumerate(zip(swapped, recordings, strict=True)):
        track = {int(number): at for at, number in enumerate(recording.tracks.identity)}
        for number, episode in zip(one.identity, one.episodes, strict=True):
            length[place, track[number]] = float(len(episode.action))
    same = same_moments(identified)
    return set(length) - once(length, lambda place: same.get(place, ()))
