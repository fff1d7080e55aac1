"""Recording with every vehicle matched to the road."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int64

from socialiq.worlds.highway.state import Contact
from socialiq_recordings.recording import Recording
from socialiq_recordings.rectangles import touching
from socialiq_recordings.road.network import Lanes, lanes_of
from socialiq_recordings.road.routes import APPROACH, JUNCTION, Crossing, Matched, Matcher
from socialiq_recordings.tracks import RoadUser

VEHICLES = (RoadUser.CAR, RoadUser.TRUCK, RoadUser.BUS, RoadUser.MOTORCYCLE)
"""Road users that drive on lanelets; others are neither ego nor neighbour."""


class Scene:
    """Recording with its conflicts and routes.

    Args:
        recording: Tracks and road.

    Attributes:
        tracks: Tracks of the recording.
        lanes: Road with conflicts.
        matcher: Matcher of that road.
        vehicles: Numbers of the tracks that are vehicles.
        speed: Speed along the heading, m/s, by state.

    Raises:
        UserError: If there is no road network, or Shapely is not installed.
    """

    def __init__(self, recording: Recording) -> None:
        tracks = recording.tracks
        self.tracks = tracks
        self.lanes: Lanes = lanes_of(recording.road)
        self.matcher = Matcher(recording.road)
        kinds = [int(kind) for kind in VEHICLES]
        self.vehicles = np.flatnonzero(np.isin(tracks.road_user, kinds))
        self.speed = tracks.vx * np.cos(tracks.heading) + tracks.vy * np.sin(tracks.heading)
        self._starts = tracks.starts
        self._matched: dict[int, Matched] = {}
        self._crossings: dict[tuple[int, int], Crossing | None] = {}
        self._presences: dict[tuple[int, int, float], tuple[int, int] | None] = {}

    def rows(self, track: int) -> slice:
        """Return the rows of a track."""
        return slice(int(self._starts[track]), int(self._starts[track + 1]))

    def matched(self, track: int) -> Matched:
        """Return a track's lanelets."""
        if track not in self._matched:
            self._matched[track] = self.matcher.match(self.tracks, track)
        return self._matched[track]

    def crossing(self, track: int, junction: int) -> Crossing | None:
        """Return a track's way over a junction; None if it doesn't touch it."""
        if (track, junction) not in self._crossings:
            found = self.matcher.crossing(self.matched(track), self.lanes, junction)
            self._crossings[track, junction] = found
        return self._crossings[track, junction]

    def junctions(self, track: int) -> list[int]:
        """Return the junctions on a track's way, in order."""
        of = self.lanes.junction_of
        return list(dict.fromkeys(of[n] for n in self.matched(track).lanelets if n in of))

    @cached_property
    def _by_frame(self) -> dict[int, Int64[np.ndarray, " row"]]:
        driving = np.flatnonzero(np.isin(self.tracks.track, self.vehicles))
        order = driving[np.argsort(self.tracks.frame[driving], kind="stable")]
        frames, first = np.unique(self.tracks.frame[order], return_index=True)
        return dict(zip(frames.tolist(), np.split(order, first[1:]), strict=True))

    def present(self, frame: int) -> Int64[np.ndarray, " row"]:
        """Return the rows of the vehicles of one frame, in the order of their tracks."""
        return self._by_frame.get(int(frame), np.zeros(0, np.int64))

    def row_at(self, track: int, frame: int) -> int | None:
        """Return a track's row at a frame; None if it isn't present."""
        rows = self.rows(track)
        row = rows.start + frame - int(self.tracks.frame[rows.start])
        return row if rows.start <= row < rows.stop else None

    def presence(self, track: int, junction: int, reach: float) -> tuple[int, int] | None:
        """Return the first and last frame of a track in a junction, or within reach before it.

        Args:
            track: Number of the track.
            junction: Index in `Lanes.junctions`.
            reach: Distance before the junction, m.
        """
        key = (track, junction, reach)
        if key not in self._presences:
            at = np.flatnonzero(self._at_junction(track, junction, reach))
            first = int(self.tracks.frame[self.rows(track).start])
            found = (first + int(at[0]), first + int(at[-1])) if len(at) else None
            self._presences[key] = found
        return self._presences[key]

    def _at_junction(self, track: int, junction: int, reach: float) -> Bool[np.ndarray, " state"]:
        way, rows = self.crossing(track, junction), self.rows(track)
        if way is None:
            return np.zeros(rows.stop - rows.start, bool)
        near = way.part == JUNCTION
        before = way.sections[APPROACH]
        if before is not None:
            seen = before.coordinates(self.tracks.x[rows], self.tracks.y[rows])
            near |= (way.part == APPROACH) & (seen.along >= before.length - reach)
        return near

    def contact(
        self, track: int, row: int, ahead: float, slack: float, shock: float = 0.0
    ) -> Contact:
        """Return a vehicle's contacts, now or after some time at the present speeds.

        The kind is by whose motion closed the gap between the centres (`core.collisions`).

        Args:
            track: The vehicle.
            row: Row of the vehicle.
            ahead: Time of the prediction, s; 0 for the present.
            slack: m by which rectangles are shorter and narrower than recorded.
            shock: m/s². Only those count at which the velocity of one of the two changes faster
                within half a second.
        """
        tracks = self.tracks
        rows = self.present(int(tracks.frame[row]))
        others = rows[tracks.track[rows] != track]
        both = np.stack([np.full(len(others), row), others], axis=1)
        heading = tracks.heading[both]
        velocity = self.speed[both][..., None] * np.stack([np.cos(heading), np.sin(heading)], -1)
        size = np.stack([tracks.length[tracks.track[both]], tracks.width[tracks.track[both]]], -1)
        centre = np.stack([tracks.x[both], tracks.y[both]], axis=-1)
        size = np.maximum(size - slack, 0.0)
        found = np.flatnonzero(touching(centre, heading, size, velocity * ahead))
        if shock and len(found) and self.change(row) <= shock:
            found = found[[self.change(int(others[one])) > shock for one in found]]
        if len(found) == 0:
            return Contact.NONE
        between = centre[found[0], 1] - centre[found[0], 0]
        own, other = velocity[found[0]] @ between
        return Contact.EGO_STRUCK if own >= -other else Contact.EGO_WAS_STRUCK

    def change(self, row: int) -> float:
        """Return the largest change of a vehicle's velocity around a row, m/s².

        Over 0.2 s or a frame, if that is longer, within half a second before and after.
        """
        rows, dt = self.rows(int(self.tracks.track[row])), self.tracks.dt
        around, step = max(1, round(0.5 / dt)), max(1, round(0.2 / dt))
        near = slice(max(rows.start, row - around), min(rows.stop, row + around + 1))
        vx, vy = self.tracks.vx[near], self.tracks.vy[near]
        if len(vx) <= step:
            return 0.0
        changed = np.hypot(vx[step:] - vx[:-step], vy[step:] - vy[:-step])
        return float(changed.max() / (step * dt))

    def lost(self, row: int, frames: int, summed: bool) -> float:
        """Return the loss of speed over the last frames, or since it came into view, m/s."""
        first = max(row - frames, int(self._starts[self.tracks.track[row]]))
        speeds = self.speed[first : row + 1]
        if summed:
            return float(np.maximum(-np.diff(speeds), 0.0).sum())
        return float(speeds[0] - speeds[-1])

    def heading_before(self, way: Crossing) -> float:
        """Return the direction in which a way enters its junction, rad."""
        before, across, _ = way.sections
        return across.heading_at_start if before is None else before.heading_at_end


def same_direction(one: float, other: float) -> bool:
    """Whether two directions differ by less than an eighth of a turn."""
    return bool(abs((one - other + np.pi) % (2 * np.pi) - np.pi) < np.pi / 4)
