"""Sites, chains of recordings and vehicles of a set of recordings.

A *site* is a piece of road, whatever it is called and in whatever frame it is drawn. A *chain* is
a set of recordings that are connected by vehicles: its recordings are not independent. Two
recordings have a vehicle in common if they have moments in common (`common_motion`), or if they
show one site and the numbers and sizes of their vehicles agree beyond chance, as in consecutive
windows.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from socialiq_recordings.identity.alignment import Shape, shape_of, shared
from socialiq_recordings.identity.common_motion import Motion, in_common
from socialiq_recordings.recording import Recording

SAME_SITE = 0.8
"""Share of the smaller shape that must lie on the other. Among the six maps of the twelve scenarios
of NGSIM the three sites' own pairs share at least 0.98, others at most 0.57."""

SAME_SIZE = 1e-3  # m
CHANCE = 0.05
"""Largest probability that numbers and sizes agree by chance where they count as agreeing."""

_MOST_SIZES = 1000  # vehicles of a recording whose sizes say how often two are alike
_SMALL = 50_000  # states of two recordings whose moments are compared although their sites differ


@dataclass(frozen=True)
class Overlap:
    """Two recordings with vehicles in common.

    Attributes:
        first: Index of the one.
        second: Index of the other.
        seconds: Duration in common; 0 if only numbers and sizes agree.
        lag: s; time of the second at frame 0 of the first; NaN without a duration.
        vehicles: Track numbers of the same vehicles, of the first and of the second.
    """

    first: int
    second: int
    seconds: float
    lag: float
    vehicles: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Identified:
    """Sites, chains and vehicles of some recordings.

    Attributes:
        names: Name of each recording.
        site: Name of each recording's site: that of the first recording there.
        chain: Name of each recording's chain: that of its first recording.
        overlaps: All pairs with vehicles in common.
        vehicle: Number of each track's vehicle, over all recordings.
    """

    names: tuple[str, ...]
    site: tuple[str, ...]
    chain: tuple[str, ...]
    overlaps: tuple[Overlap, ...]
    vehicle: tuple[np.ndarray, ...]

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
    """Return the sites, chains and vehicles of some recordings.

    Args:
        recordings: Recordings of any source, each with its own frame, clock and numbers.
    """
    names = tuple(recording.tracks.recording for recording in recordings)
    sites = _sites(recordings, names)
    overlaps = _overlaps(recordings, sites)
    for overlap in overlaps:
        _join(sites, overlap.first, overlap.second)
    chains = list(range(len(recordings)))
    first = np.cumsum([0, *(recording.tracks.n_tracks for recording in recordings)])
    vehicles = list(range(int(first[-1])))
    for overlap in overlaps:
        _join(chains, overlap.first, overlap.second)
        for track, other_track in overlap.vehicles:
            _join(
                vehicles,
                int(first[overlap.first]) + track,
                int(first[overlap.second]) + other_track,
            )
    numbers = np.array([_root(vehicles, number) for number in range(len(vehicles))], np.int64)
    return Identified(
        names,
        _site_names([_root(sites, number) for number in range(len(names))], names),
        tuple(names[_root(chains, number)] for number in range(len(names))),
        overlaps,
        tuple(np.split(numbers, first[1:-1])) if len(names) else (),
    )


def site_of(recording: str) -> str:
    """Return the site of a recording: the map of a CommonRoad benchmark's name, else the name.

    Scenarios of one map may come from one recording and show the same vehicles seconds later. A
    name is a hint only: `recordings.identity` compares the roads.

    Args:
        recording: Name of the recording.
    """
    benchmark = re.match(r"(?:C-)?([A-Z]{3}_[A-Za-z0-9]+-[0-9]+)_", recording)
    return benchmark[1] if benchmark else recording


def _sites(recordings: Sequence[Recording], names: tuple[str, ...]) -> list[int]:
    """Return a forest of recordings at one site."""
    sites, shapes = list(range(len(recordings))), _Shapes()
    for second in range(len(recordings)):
        for first in range(second):
            if _root(sites, first) == _root(sites, second):
                continue
            # A CommonRoad map has a name of its own; other names say nothing of the place.
            same_map = site_of(names[first]) == site_of(names[second]) != names[first]
            if same_map or shapes.shared(recordings[first], recordings[second]) >= SAME_SITE:
                _join(sites, first, second)
    return sites


class _Shapes:
    """Shapes, computed once for recordings of one road."""

    def __init__(self) -> None:
        self._shapes: dict[bytes, Shape] = {}
        self._keys: dict[int, bytes] = {}
        self._shared: dict[tuple[bytes, bytes], float] = {}

    def shared(self, one: Recording, other: Recording) -> float:
        pair = (self._key(one), self._key(other))
        if pair[0] == pair[1]:
            return 1.0
        pair = (min(pair), max(pair))
        if pair not in self._shared:
            self._shared[pair] = shared(self._shapes[pair[0]], self._shapes[pair[1]])
        return self._shared[pair]

    def _key(self, recording: Recording) -> bytes:
        if id(recording) not in self._keys:
            shape = shape_of(recording)
            key = shape.points.tobytes() + bytes([shape.of_road])
            self._keys[id(recording)] = key
            self._shapes[key] = shape
        return self._keys[id(recording)]


def _overlaps(recordings: Sequence[Recording], sites: list[int]) -> tuple[Overlap, ...]:
    motions = [Motion(recording.tracks) for recording in recordings]
    overlaps = []
    for first, second in itertools.combinations(range(len(recordings)), 2):
        same_site = _root(sites, first) == _root(sites, second)
        states = motions[first].tracks.n_states + motions[second].tracks.n_states
        if not same_site and states > _SMALL:
            continue
        common = in_common(motions[first], motions[second])
        if common is not None:
            pairs = tuple((int(a), int(b)) for a, b in common.vehicles)
            overlaps.append(Overlap(first, second, common.seconds, common.lag, pairs))
        elif same_site:
            pairs = _persisting(recordings[first], recordings[second])
            if pairs:
                overlaps.append(Overlap(first, second, 0.0, float("nan"), pairs))
    return tuple(overlaps)


def _persisting(one: Recording, other: Recording) -> tuple[tuple[int, int], ...]:
    """Return tracks of equal number and size, if they are more than chance would give.

    Under chance a common number has the same class and size with the share that all pairs of the
    two recordings have, so the count of agreements is binomial.
    """
    tracks, other_tracks = one.tracks, other.tracks
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
    if not same.any() or binom.sf(same.sum() - 1, len(a), every.mean()) > CHANCE:
        return ()
    return tuple(zip(a[same].tolist(), b[same].tolist(), strict=True))


def _site_names(roots: list[int], names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the name of each recording's site, one for each: that of its map, or its first's."""
    maps = {root: site_of(names[root]) for root in roots}
    twice = {name for name in maps.values() if list(maps.values()).count(name) > 1}
    return tuple(names[root] if maps[root] in twice else maps[root] for root in roots)


def _root(forest: list[int], node: int) -> int:
    while forest[node] != node:
        forest[node] = forest[forest[node]]
        node = forest[node]
    return node


def _join(forest: list[int], one: int, other: int) -> None:
    """Join two trees; the smaller number is the root."""
    low, high = sorted((_root(forest, one), _root(forest, other)))
    forest[high] = low
