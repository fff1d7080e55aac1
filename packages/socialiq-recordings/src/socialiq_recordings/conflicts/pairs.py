"""Conflicts of ordered pairs: ways that cross or merge, with arrival times that overlap.

A conflict has two rows, one for each vehicle as the ego. Its measures are those of `measures`.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq_recordings.conflicts import occupancy
from socialiq_recordings.conflicts.areas import Area, area_of, swept
from socialiq_recordings.conflicts.around import OnWay, on_way
from socialiq_recordings.conflicts.config import ConflictConfig
from socialiq_recordings.conflicts.in_time import InTime
from socialiq_recordings.conflicts.lights import held
from socialiq_recordings.conflicts.occupancy import Occupancy
from socialiq_recordings.conflicts.ways import Way, frames_together, way_of
from socialiq_recordings.road.routes import OFF_THE_MAP, Scene


@dataclass(frozen=True, eq=False)
class Meeting:
    """Conflict of an ordered pair.

    Attributes:
        ego: Way of the vehicle whose conflict it is.
        other: Way of the other vehicle.
        area: Their conflict area, the ego first.
        ego_times: The ego's times in the area, recorded or else projected.
        other_times: The other's.
        complete: Whether the times that PET needs were recorded.
        frames: Frames at which both are present and neither has left the area.
    """

    ego: Way
    other: Way
    area: Area
    ego_times: Occupancy
    other_times: Occupancy
    complete: bool
    frames: np.ndarray

    @property
    def ego_first(self) -> bool | None:
        """Whether the ego enters the area first; None if neither will arrive."""
        if np.isinf(self.ego_times.enters) and np.isinf(self.other_times.enters):
            return None
        return bool(self.ego_times.enters <= self.other_times.enters)


class Encounters:
    """Ways and conflict areas of a recording's vehicles, each made once.

    Args:
        scene: The recording.
        config: Options.

    Attributes:
        scene: The recording.
        config: Options.
        ways: Ways of the vehicles on the road, by track.
    """

    def __init__(self, scene: Scene, config: ConflictConfig | None = None) -> None:
        self.scene = scene
        self.config = config or ConflictConfig()
        on_road = [n for n in scene.vehicles.tolist() if scene.matched(n).off <= OFF_THE_MAP]
        self.ways: dict[int, Way] = {track: way_of(scene, track) for track in on_road}
        self._swept: dict[int, Any] = {}
        self._on_way: dict[tuple[int, int], OnWay] = {}
        self._areas: dict[tuple[int, int], Area | None] = {}
        self._in_time: InTime | None = None

    @property
    def in_time(self) -> InTime:
        """The ways by the time at which their vehicles are seen."""
        if self._in_time is None or self._in_time.ways is not self.ways:
            self._in_time = InTime(self.ways)
        return self._in_time

    def area(self, one: int, other: int) -> Area | None:
        """Return the conflict area of two tracks, the first one's coordinates first."""
        first, second = min(one, other), max(one, other)
        if (first, second) not in self._areas:
            ways = self.ways[first], self.ways[second]
            swept_areas = self._swept_by(first), self._swept_by(second)
            self._areas[first, second] = area_of(*ways, *swept_areas, self.scene.lanes)
        found = self._areas[first, second]
        return found if found is None or one == first else found.swapped()

    def moved(self, scene: Scene, ways: Mapping[int, Way]) -> Encounters:
        """Return the encounters of other motion along the same ways; the areas stay.

        Args:
            scene: Tracks of that motion on the same road, numbered newly.
            ways: For each track here, its way there; tracks that are not there are left out.
        """
        other = copy.copy(self)
        other.scene, other.ways = scene, {way.track: way for way in ways.values()}
        number = {track: way.track for track, way in ways.items()}
        other._swept = {number[t]: one for t, one in self._swept.items() if t in number}
        other._areas = {
            (number[a], number[b]): area
            for (a, b), area in self._areas.items()
            if a in number and b in number
        }
        other._on_way = {}
        return other

    def _swept_by(self, track: int) -> Any:
        if track not in self._swept:
            self._swept[track] = swept(self.ways[track], self.config.slack)
        return self._swept[track]

    def meeting(self, ego: int, other: int) -> Meeting | None:
        """Return the conflict of an ordered pair of tracks; None if there is none.

        Either both passed the area within `near` s and were in view together before the second
        arrived, or at one moment before either had left they would at their speeds. Both are the
        first of their lanes then: who queues behind others meets them, not the crossing traffic.
        """
        one, two = self.ways[ego], self.ways[other]
        together = frames_together(one, two)
        area = self.area(ego, other) if len(together) else None
        if area is None:
            return None
        sides = list(zip(area.entry, area.exit, strict=True))
        seen = [occupancy.recorded(way, *side) for way, side in zip((one, two), sides, strict=True)]
        dt = one.dt
        left = min(each.leaves for each in seen)
        frames = together[together * dt < left]
        late = 0 if seen[0] > seen[1] else 1
        first, second = seen[1 - late], seen[late]
        complete = bool(np.isfinite(first.leaves) and np.isfinite(second.enters))
        met = complete and together[0] * dt < second.enters
        met = met and second.enters - first.leaves <= self.config.near
        if met:
            # No third vehicle enters between them, and no red light holds the second.
            way = (one, two)[late]
            frame = int(np.clip(np.ceil(first.leaves / dt), way.first, way.last))
            met = self.first_in_line(way, area.entry[late], frame, (one, two)[1 - late].track)
            met = met and not held(self.scene, way, frame)
        if not met and not any(self._on_course(area, one, two, int(frame)) for frame in frames):
            return None
        times = [occupancy.expected(way, *at) for way, at in zip((one, two), sides, strict=True)]
        return Meeting(one, two, area, times[0], times[1], complete, frames)

    def _on_course(self, area: Area, one: Way, two: Way, frame: int) -> bool:
        """Whether two vehicles would be in the area close in time at the speeds of a frame."""
        times = [
            occupancy.projected(way, area.entry[place], area.exit[place], frame)
            for place, way in enumerate((one, two))
        ]
        soon = max(each.enters for each in times) <= frame * one.dt + self.config.horizon
        return (
            soon
            and occupancy.apart(*times) <= self.config.near
            and self.first_in_line(one, area.entry[0], frame, two.track)
            and self.first_in_line(two, area.entry[1], frame, one.track)
            and not self.held(one, two, frame)
        )

    def held(self, one: Way, two: Way, frame: int) -> bool:
        """Whether a red light holds either of two vehicles at a frame."""
        return held(self.scene, one, frame) or held(self.scene, two, frame)

    def first_in_line(self, way: Way, entry: float, frame: int, but: int) -> bool:
        """Whether no other vehicle is on a way between a vehicle and a conflict area.

        Args:
            way: The vehicle's way.
            entry: Coordinate of the area, m.
            frame: A frame at which it is present.
            but: Track that doesn't count: the other vehicle of the conflict.
        """
        if self.config.queued:
            return True
        key = way.track, frame
        if key not in self._on_way:
            self._on_way[key] = on_way(self.scene, way, frame, self.config.slack)
        others = self._on_way[key].without(but)
        along, _ = way.state(frame)
        return not ((others.along > along) & (others.along < entry)).any()

    def meetings(self) -> list[Meeting]:
        """Return all conflicts, two for each pair, in the order of the tracks."""
        found = []
        for ego, way in self.ways.items():
            for other in self.in_time.seen(way.first, way.last):
                made = self.meeting(ego, other.track) if ego != other.track else None
                if made is not None:
                    found.append(made)
        return found
