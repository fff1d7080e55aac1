"""Road network of a recording: lanelets, right of way, and the junctions of lanelets in conflict.

The frame is that of the tracks: metres, x to the east, y to the north. Conflicts need Shapely
(extra `maps`), which only this module and `conflicts.encounters` use.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float64

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq_recordings import DISTRIBUTION

LEAST = 0.1  # m; a lanelet that is shorter, or narrower throughout, is an error of its points
STEP = 2.0  # m between the points of a line that is compared with others
LONGEST = 1e5  # m of a lanelet's bound; no map's is as long, and its points would fill the memory


class Refused(NamedTuple):
    """Road user, row or element of a road that was left out: its name in the file, the reason."""

    identity: str
    reason: str
    road_user: str = ""  # its class, if it is a road user of a known one


class Sign(enum.IntEnum):
    """Right-of-way sign of a lanelet; NONE if the file has none."""

    NONE = 0
    PRIORITY = 1
    YIELD = 2
    STOP = 3
    LIGHT = 4


class Colour(enum.IntEnum):
    """Colour of a traffic light; INACTIVE if it is off or flashes."""

    GREEN = 0
    YELLOW = 1
    RED = 2
    RED_YELLOW = 3
    INACTIVE = 4


class Cycle(NamedTuple):
    """Cycle of a traffic light: colour and number of frames of each phase, frame of the first."""

    phases: tuple[tuple[Colour, int], ...]
    offset: int = 0

    def at(self, frame: int) -> Colour:
        """Return the colour at a frame; the cycle repeats before and after."""
        left = (frame - self.offset) % sum(length for _, length in self.phases)
        for colour, length in self.phases:
            if left < length:
                return colour
            left -= length
        raise AssertionError  # what is left is below the sum of all lengths

    def closed(self, frame: int) -> bool:
        """Whether the light tells drivers to stop: yellow, red, or both."""
        return self.at(frame) in (Colour.YELLOW, Colour.RED, Colour.RED_YELLOW)


@dataclass(frozen=True, eq=False)
class Lanelet:
    """Section of a lane, driven from the first points of its bounds to the last.

    Raises:
        UserError: If a bound has fewer than two points, the numbers differ, or a coordinate
            isn't finite.
    """

    identity: int  # number of the lanelet in the file
    left: Float64[np.ndarray, "point 2"]  # left bound, in driving direction
    right: Float64[np.ndarray, "point 2"]  # right bound, with the same number of points
    successors: tuple[int, ...] = ()  # lanelets that it leads to
    predecessors: tuple[int, ...] = ()  # lanelets that lead to it
    adjacent_left: tuple[int, bool] | None = None  # beside it, and whether in the same direction
    adjacent_right: tuple[int, bool] | None = None
    speed_limit: float = float("inf")  # m/s; infinity if unknown
    sign: Sign = Sign.NONE  # right of way
    stop_line: Float64[np.ndarray, "2 2"] | None = None  # two points, if the file has a stop line
    cycle: Cycle | None = None  # of the light at its end, if the file has states of it

    # Run-time type checkers leave the constructor to `__post_init__`, whose lines say what to do.
    __no_type_check__: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the bounds."""
        left = np.asarray(self.left)
        right = np.asarray(self.right)
        if left.ndim != 2 or left.shape != right.shape or len(left) < 2 or left.shape[1] != 2:
            raise UserError(
                f"lanelet {self.identity}: its bounds have {len(left)} and {len(right)} points: "
                "give both as many, two or more, each (x, y)"
            )
        if not (np.isfinite(left).all() and np.isfinite(right).all()):
            raise UserError(f"lanelet {self.identity}: a point of its bounds is not finite")
        if any(length_of(line) > LONGEST for line in (left, right)):
            raise UserError(
                f"lanelet {self.identity}: a bound is longer than {LONGEST / 1000:g} km: correct "
                "its points"
            )

    @property
    def centre(self) -> Float64[np.ndarray, "point 2"]:
        """Centre line: the midpoints of the bounds."""
        return (self.left + self.right) / 2


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """Lanelets of a road, by their numbers, in the order of the file."""

    lanelets: dict[int, Lanelet] = field(default_factory=dict)
    faults: tuple[Refused, ...] = ()  # elements of the map that could not be read


def length_of(line: Float64[np.ndarray, "corner 2"]) -> float:
    """Return the length of a line, m."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


class Elements:
    """Elements of a map as a reader gathers them; one that can't be read is left out and named."""

    UNREADABLE = (KeyError, ValueError, TypeError, OverflowError, UserError)

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lanelets = dict[int, Lanelet]()
        self._faults = list[Refused]()
        self._bad_lanelets = list[Refused]()

    def leave_out(self, name: str, error: object) -> Refused:
        """Name an element that can't be read.

        Args:
            name: Name of the element in the file.
            error: Reason for which it is left out.

        Returns:
            The name with the reason.
        """
        text = f"no {error}" if isinstance(error, KeyError) else one_line(str(error))
        prefix = name.replace("lane segment", "lanelet")  # which a lanelet's own errors name
        self._faults.append(Refused(name, text.removeprefix(f"{prefix}: ")))
        return self._faults[-1]

    def add(self, name: str, read: Callable[[], Lanelet]) -> None:
        """Add the lanelet that a function returns; one that can't be read is left out and named.

        Args:
            name: Name of the lanelet in the file.
            read: Function that reads it.
        """
        try:
            lanelet = read()
            width = float(np.hypot(*(lanelet.left - lanelet.right).T).max())
            for side, metres in (("long", length_of(lanelet.centre)), ("wide", width)):
                if metres < LEAST:
                    raise ValueError(f"it is {metres:.2g} m {side}: correct its points")
            if lanelet.identity in self.lanelets:
                raise ValueError("two lanelets have this id: give each its own")
            self.lanelets[lanelet.identity] = lanelet
        except self.UNREADABLE as error:
            self._bad_lanelets.append(self.leave_out(name, error))

    def road(self, lanelets: dict[int, Lanelet] | None = None) -> RoadNetwork:
        """Return the road; raise a `UserError` if more than half of its lanelets are left out."""
        bad = self._bad_lanelets
        if len(bad) > len(self.lanelets):
            count = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
            raise UserError(f"{self.path}: {bad[0].identity}: {bad[0].reason}{count}")
        road = self.lanelets if lanelets is None else lanelets
        return RoadNetwork(road, tuple(self._faults))


def every_step(line: Float64[np.ndarray, "corner 2"]) -> Float64[np.ndarray, "point 3"]:
    """Return x, y in m and the direction in rad of a line, every `STEP` metres."""
    lengths = np.hypot(*np.diff(line, axis=0).T)
    line = line[np.concatenate([[True], lengths > 1e-9])]
    if len(line) < 2:
        return np.zeros((0, 3))
    pieces = np.diff(line, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*pieces.T))])
    at = np.arange(0.0, along[-1], STEP)
    piece = np.searchsorted(along, at, side="right") - 1
    heading = np.arctan2(pieces[piece, 1], pieces[piece, 0])
    return np.column_stack([np.interp(at, along, line[:, axis]) for axis in range(2)] + [heading])


def equal_bounds(
    left: Float64[np.ndarray, "left 2"], right: Float64[np.ndarray, "right 2"]
) -> tuple[Float64[np.ndarray, "point 2"], Float64[np.ndarray, "point 2"]]:
    """Return two bounds with as many points each, at the same shares of their lengths.

    Args:
        left: Points of the left bound, m.
        right: Points of the right bound, m.

    Returns:
        The two bounds as they are if their points correspond or one has fewer than two; else both
        with the points of either.
    """
    if min(len(left), len(right)) < 2:
        return left, right  # `Lanelet` refuses them
    shares = []
    for line in (left, right):
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        shares.append(lengths / max(lengths[-1], 1e-9))
    if len(left) == len(right) and np.allclose(*shares, atol=0.02):
        return left, right
    every = np.unique(np.concatenate(shares))
    every = every[np.concatenate([[True], np.diff(every) > 1e-6])]
    resampled = [
        np.column_stack([np.interp(every, share, line[:, axis]) for axis in range(2)])
        for share, line in zip(shares, (left, right), strict=True)
    ]
    return resampled[0], resampled[1]


class Conflict(enum.IntEnum):
    """Kind of conflict of two lanelets."""

    CROSSING = 0
    MERGING = 1


@dataclass(frozen=True, eq=False)
class Lanes:
    """Road network with its conflicts."""

    road: RoadNetwork  # the lanelets
    conflicts: dict[tuple[int, int], Conflict]  # of two lanelets, the smaller number first
    junction_of: dict[int, int]  # number by lanelet in conflict: those that conflicts connect share

    @cached_property
    def against(self) -> dict[int, set[int]]:
        """Lanelets in conflict with each."""
        against: dict[int, set[int]] = {number: set() for number in self.road.lanelets}
        for first, second in self.conflicts:
            against[first].add(second)
            against[second].add(first)
        return against


def area_of(lanelet: Lanelet) -> Any:
    """Return the area of a lanelet as a Shapely geometry; `UserError` without Shapely."""
    ring = np.concatenate([lanelet.left, lanelet.right[::-1]])
    area = shapely().make_valid(shapely().polygons(ring))
    return area if area.geom_type != "GeometryCollection" else area.buffer(0)


def lanes_of(road: RoadNetwork) -> Lanes:
    """Find a road network's conflicts.

    Two lanelets cross if their centre lines do; they merge if they lead to the same lanelet.
    Lanelets that follow each other or leave the same lanelet also overlap, but their vehicles
    follow each other: no conflict.

    Raises:
        UserError: If Shapely is not installed.
    """
    library = shapely()
    if not road.lanelets:
        return Lanes(road, {}, {})
    lanelets = [road.lanelets[number] for number in sorted(road.lanelets)]
    centres = [library.linestrings(lanelet.centre) for lanelet in lanelets]
    areas = [area_of(lanelet) for lanelet in lanelets]
    conflicts: dict[tuple[int, int], Conflict] = {}
    for first, second in library.STRtree(areas).query(areas, predicate="intersects").T:
        if first >= second:
            continue
        low = lanelets[first]
        high = lanelets[second]
        if high.identity in low.successors or low.identity in high.successors:
            continue
        if {*low.predecessors} & {*high.predecessors}:
            continue
        if {*low.successors} & {*high.successors}:
            conflicts[low.identity, high.identity] = Conflict.MERGING
        elif centres[first].crosses(centres[second]):
            conflicts[low.identity, high.identity] = Conflict.CROSSING
    groups: list[set[int]] = []
    for pair in conflicts:
        joined = [group for group in groups if group & set(pair)]
        groups = [group for group in groups if not group & set(pair)]
        groups.append(set(pair).union(*joined))
    junctions = enumerate(sorted(groups, key=min))
    return Lanes(road, conflicts, {number: index for index, group in junctions for number in group})


def tree_of(points: Float64[np.ndarray, "point axis"]) -> Any:
    """Return SciPy's tree of some points."""
    from scipy.spatial import KDTree  # slow to import

    return KDTree(points)


def shapely() -> Any:
    """Return the library Shapely; `UserError` if it is not installed."""
    return optional("shapely", "maps", "conflict areas", DISTRIBUTION)
