"""Sites, chains of recordings and vehicles of a set of recordings; what several show counts once.

A *site* is a piece of road, whatever it is called and in whatever frame it is drawn. A *chain* is
a set of recordings that are connected by vehicles: its recordings are not independent. Two
recordings have a vehicle in common if they have moments in common (`alignment`), or if they show
one site and the numbers and sizes of their vehicles agree beyond chance, as in consecutive windows.
"""

import itertools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar, get_args

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq_recordings.identity import alignment
from socialiq_recordings.identity.alignment import Motion, Shape
from socialiq_recordings.recording import Recording

SAME_SITE = 0.8
"""Share of a shape that must lie on another. Of the six maps of the twelve scenarios of NGSIM the
smaller ones share at least 0.98 with those of their site, at most 0.57 with others."""

SAME_SIZE = 1e-3  # m
CHANCE = 0.05
"""Largest probability that numbers and sizes agree by chance where they count as agreeing."""

_MOST_SIZES = 1000  # vehicles of a recording whose sizes say how often two are alike
_SMALL = 50_000  # states of two recordings whose moments are compared although their sites differ


@dataclass(frozen=True)
class Overlap:
    """Two recordings with vehicles in common."""

    first: int  # index of the one
    second: int  # index of the other
    seconds: float  # duration in common; 0 if only numbers and sizes agree
    lag: float  # s; time of the second at frame 0 of the first; NaN without a duration
    vehicles: tuple[tuple[int, int], ...]  # track numbers, of the first and of the second


@dataclass(frozen=True, eq=False)
class Identified:
    """Sites, chains and vehicles of some recordings."""

    names: tuple[str, ...]  # name of each recording
    site: tuple[str, ...]  # name of each recording's site: that of the first recording there
    chain: tuple[str, ...]  # name of each recording's chain: that of its first recording
    overlaps: tuple[Overlap, ...]  # all pairs with vehicles in common
    vehicle: tuple[np.ndarray, ...]  # number of each track's vehicle, over all recordings

    @property
    def n_vehicles(self) -> int:
        """Number of different vehicles."""
        return len(np.unique(np.concatenate(self.vehicle)))

    def rows(self) -> list[dict[str, object]]:
        """Return a table row for each pair of recordings with vehicles in common."""
        return [
            {
                "first": self.names[overlap.first],
                "second": self.names[overlap.second],
                "seconds": round(overlap.seconds, 2),
                "lag": round(overlap.lag, 2) if overlap.seconds else "",
                "vehicles": len(overlap.vehicles),
            }
            for overlap in self.overlaps
        ]


def identify(recordings: Sequence[Recording]) -> Identified:
    """Return the sites, chains and vehicles of recordings, each with its own frame and clock."""
    names = tuple(recording.tracks.recording for recording in recordings)
    sites = _sites(recordings, names)
    motions = [Motion(recording.tracks) for recording in recordings]
    overlaps = []
    for first, second in itertools.combinations(range(len(recordings)), 2):
        same_site = _root(sites, first) == _root(sites, second)
        states = motions[first].tracks.n_states + motions[second].tracks.n_states
        common = None
        if same_site or states <= _SMALL:
            common = alignment.in_common(motions[first], motions[second])
        if common is not None:
            pairs = tuple((int(a), int(b)) for a, b in common.vehicles)
            overlaps.append(Overlap(first, second, common.seconds, common.lag, pairs))
        elif same_site:
            pairs = _persisting(recordings[first], recordings[second])
            if pairs:
                overlaps.append(Overlap(first, second, 0.0, float("nan"), pairs))
    chains = list(range(len(recordings)))
    first = np.cumsum([0, *(recording.tracks.n_tracks for recording in recordings)]).tolist()
    vehicles = list(range(first[-1]))
    for overlap in overlaps:
        _join(sites, overlap.first, overlap.second)
        _join(chains, overlap.first, overlap.second)
        for track, other_track in overlap.vehicles:
            _join(vehicles, first[overlap.first] + track, first[overlap.second] + other_track)
    numbers = np.array([_root(vehicles, number) for number in range(len(vehicles))], np.int64)
    # A site has the name of its map, or where that names several sites, of its first recording.
    roots = [_root(sites, number) for number in range(len(names))]
    maps = {root: site_of(names[root]) for root in roots}
    twice = {name for name in maps.values() if list(maps.values()).count(name) > 1}
    return Identified(
        names,
        tuple(names[root] if maps[root] in twice else maps[root] for root in roots),
        tuple(names[_root(chains, number)] for number in range(len(names))),
        tuple(overlaps),
        tuple(np.split(numbers, first[1:-1])) if len(names) else (),
    )


def site_of(recording: str) -> str:
    """Return the site by a recording's name: the map of a CommonRoad benchmark's, else the name.

    Scenarios of one map may come from one recording and show the same vehicles seconds later. A
    name is a hint only: `identify` compares the roads.
    """
    benchmark = re.match(r"(?:C-)?([A-Z]{3}_[A-Za-z0-9]+-[0-9]+)_", recording)
    return benchmark[1] if benchmark else recording


def _sites(recordings: Sequence[Recording], names: tuple[str, ...]) -> list[int]:
    """Return a forest of recordings at one site; each pair of shapes is compared once.

    Two maps that lie on each other are one site, whatever else lies on them. A map that lies in a
    larger one belongs to that site, too; but one that lies in maps of several sites would fit
    anywhere, since no place is in two: it joins none of them.
    """
    sites = list(range(len(recordings)))
    shapes = dict[bytes, Shape]()
    keys = list[bytes]()
    shares: dict[tuple[bytes, bytes], tuple[float, float]] = {}
    for recording in recordings:
        shape = alignment.shape_of(recording)
        keys.append(shape.points.tobytes() + bytes([shape.of_road]))
        shapes[keys[-1]] = shape
    inside: list[tuple[int, int]] = []  # a recording whose map lies in that of another
    for second, first in ((b, a) for b in range(len(recordings)) for a in range(b)):
        if _root(sites, first) == _root(sites, second):
            continue
        # A CommonRoad map has a name of its own; other names say nothing of the place.
        same = site_of(names[first]) == site_of(names[second]) != names[first]
        low, high = sorted((keys[first], keys[second]))
        if not same and low != high and (low, high) not in shares:
            pair = shapes[low], shapes[high]
            shares[low, high] = alignment.shared(*pair)
            is_site = max(shares[low, high]) >= SAME_SITE
            if is_site and alignment.fits_by_chance(*pair, SAME_SITE):
                shares[low, high] = 0.0, 0.0
        of_low, of_high = (1.0, 1.0) if same or low == high else shares[low, high]
        if min(of_low, of_high) >= SAME_SITE:
            _join(sites, first, second)
        elif max(of_low, of_high) >= SAME_SITE:
            is_inside = (of_low >= SAME_SITE) == (keys[first] == low)
            inside.append((first, second) if is_inside else (second, first))
    # The largest first, so that what a map lies in has its site.
    for root in sorted({_root(sites, n) for n, _ in inside}, key=lambda n: -len(keys[n])):
        larger = {_root(sites, n) for small, n in inside if _root(sites, small) == root} - {root}
        if len(larger) == 1:
            _join(sites, root, larger.pop())
    return sites


def _persisting(recording: Recording, other_recording: Recording) -> tuple[tuple[int, int], ...]:
    """Return tracks of equal number and size, if they are more than a binomial chance gives."""
    tracks = recording.tracks
    other_tracks = other_recording.tracks
    _, a, b = np.intersect1d(tracks.identity, other_tracks.identity, return_indices=True)
    if not len(a):
        return ()
    users, other_users = (
        np.column_stack([t.length, t.width, t.road_user.astype(np.float64)])
        for t in (tracks, other_tracks)
    )
    same = (np.abs(users[a] - other_users[b]) <= SAME_SIZE).all(axis=1)
    sampled, other_users = (
        sizes[:: 1 + len(sizes) // _MOST_SIZES] for sizes in (users, other_users)
    )
    every = (np.abs(sampled[:, None] - other_users[None]) <= SAME_SIZE).all(axis=2)
    from scipy.special import bdtrc  # slow to import

    if not same.any() or bdtrc(same.sum() - 1, len(a), every.mean()) > CHANCE:
        return ()
    return tuple(zip(a[same].tolist(), b[same].tolist(), strict=True))


def _root(forest: list[int], node: int) -> int:
    while forest[node] != node:
        forest[node] = forest[forest[node]]
        node = forest[node]
    return node


def _join(forest: list[int], first: int, second: int) -> None:
    """Join two trees; the smaller number is the root."""
    low, high = sorted((_root(forest, first), _root(forest, second)))
    forest[high] = low


Place = tuple[int, int]  # index of a recording and number of a track
Key = TypeVar("Key")


def same_moments(identified: Identified) -> dict[Place, set[Place]]:
    """Return for each track those of other recordings that show it at the same moments."""
    same: dict[Place, set[Place]] = {}
    for overlap in identified.overlaps:
        for track, other_track in overlap.vehicles if overlap.seconds else ():
            pair = (overlap.first, track), (overlap.second, other_track)
            for a, b in (pair, pair[::-1]):
                same.setdefault(a, set()).add(b)
    return same


def once(sizes: Mapping[Key, float], same: Callable[[Key], Iterable[Key]]) -> set[Key]:
    """Return the largest of each group of equal keys; of keys of one size the first.

    Args:
        sizes: Size of each key.
        same: Function that returns the keys that are equal to a key.
    """
    largest: set[Key] = set()
    for item in sorted(sizes, key=lambda key: -sizes[key]):
        if not largest.intersection(same(item)):
            largest.add(item)
    return largest


def pairs_once(
    sizes: Mapping[tuple[int, int, int], float], identified: Identified
) -> set[tuple[int, int, int]]:
    """Return the pairs of tracks that are kept: of two that show one conflict, the longer.

    Args:
        sizes: Duration of each pair. A key is the index of a recording and the numbers of the ego's
            track and of its partner's.
        identified: Vehicles that the recordings show at the same moments.

    Returns:
        The keys that are kept.
    """
    same = same_moments(identified)

    def equal(key: tuple[int, int, int]) -> list[tuple[int, int, int]]:
        recording, ego, partner = key
        return [
            (number, ego_track, partner_track)
            for number, ego_track in same.get((recording, ego), ())
            for recording_of, partner_track in same.get((recording, partner), ())
            if recording_of == number
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
        recordings: Recordings, each with its own frame and clock.
        duplicates: Treatment of moments that several recordings show; only "refuse" has an effect
            here.

    Raises:
        UserError: If two recordings have one name, or moments are in common and `duplicates` is
            "refuse".
    """
    one_of("duplicates", duplicates, get_args(Duplicates))
    check_names([recording.tracks.recording for recording in recordings])
    identified = identify(recordings)
    overlapping = [overlap for overlap in identified.overlaps if overlap.seconds]
    if duplicates != "refuse" or not overlapping:
        return identified
    names = [one_line(name, 60) for name in identified.names]
    pairs = [
        f"{names[overlap.first]} and {names[overlap.second]} ({overlap.seconds:.1f} s, "
        f"{len(overlap.vehicles)} vehicles)"
        for overlap in overlapping[:_NAMED]
    ]
    remainder = f" and {len(overlapping) - _NAMED} more pairs" if len(overlapping) > _NAMED else ""
    raise UserError(
        f"the same moments are in {', '.join(pairs)}{remainder}: leave recordings out, or choose "
        "--duplicates drop"
    )


def check_names(names: Sequence[str]) -> None:
    """Raise an error if two recordings have one name."""
    twice = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if twice is not None:
        raise UserError(f"two recordings are named '{one_line(twice)}': give each only once")
