"""Situations of recorded drivers: what is known at a moment, and what the driver did next.

Every vehicle has a moment a second from its first frame on. Only the route is taken as known beyond
the moment. Speeds are those that the recording states for its frame, because speeds over a longer
time look ahead. `advanced` lets a driver go on with an acceleration while all others keep their
speeds, so that a model can be rolled out.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.errors import UserError
from socialiq.physics import ballistic, wrapped
from socialiq.types import Row
from socialiq_recordings.conflicts import ways as motion
from socialiq_recordings.conflicts.encounters import Area, Encounters
from socialiq_recordings.identity.identify import Identified, tracks_kept
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Conflict, Sign
from socialiq_recordings.road.routes import Scene

MOVING = 0.5  # m/s; a slower vehicle stands
HORIZON = 3  # s after a moment to which the position is predicted


@dataclass(frozen=True, eq=False)
class Situations:
    """Situations, a row for each moment of a vehicle.

    A distance is infinite, and its speed 0, where there is no such vehicle.
    """

    recording: Int64[np.ndarray, " moment"]  # index of the recording
    vehicle: Int64[np.ndarray, " moment"]  # number of the vehicle over all recordings
    chain: Int64[np.ndarray, " moment"]  # number of the chain
    site: Int64[np.ndarray, " moment"]  # number of the site
    # s, on one clock: recordings overlap on it only where they have moments in common
    time: Float64[np.ndarray, " moment"]
    speed: Float64[np.ndarray, " moment"]  # m/s
    # acceleration of the second before, m/s²; NaN if the vehicle wasn't in view
    last: Float64[np.ndarray, " moment"]
    length: Float64[np.ndarray, " moment"]  # of the vehicle, m
    gap: Float64[np.ndarray, " moment"]  # to the leader, m, bumper to bumper
    leader_speed: Float64[np.ndarray, " moment"]  # m/s
    behind: Float64[np.ndarray, " moment"]  # gap of the follower, m
    behind_speed: Float64[np.ndarray, " moment"]  # m/s
    # from the front to the next junction on the route, m
    to_junction: Float64[np.ndarray, " moment"]
    # change of direction over the next 20 m, degrees, positive to the left
    turn: Float64[np.ndarray, " moment"]
    limit: Float64[np.ndarray, " moment"]  # speed limit, m/s; infinite if unknown
    # whether a sign on the lanelet tells it to yield or to stop
    gives_way: Bool[np.ndarray, " moment"]
    # from the front to the conflict area, m; negative inside
    to_area: Float64[np.ndarray, " moment"]
    through: Float64[np.ndarray, " moment"]  # from its beginning until the rear has left it, m
    merging: Bool[np.ndarray, " moment"]  # whether the ways merge there
    other_to_area: Float64[np.ndarray, " moment"]  # the other vehicle's distance to it, m
    other_through: Float64[np.ndarray, " moment"]  # as `through`, m
    other_speed: Float64[np.ndarray, " moment"]  # m/s
    other_gap: Float64[np.ndarray, " moment"]  # the other's gap to its own leader, m
    other_leader_speed: Float64[np.ndarray, " moment"]  # m/s
    acceleration: Float64[np.ndarray, " moment"]  # observed mean of the next second, m/s²; a target
    # distance after `HORIZON` s, m; NaN if the vehicle wasn't in view; a target
    driven: Float64[np.ndarray, " moment"]

    def __len__(self) -> int:
        return len(self.vehicle)

    @property
    def conflict(self) -> Bool[np.ndarray, " moment"]:
        """Whether the driver and another are on course for a conflict area."""
        return np.isfinite(self.to_area)

    @property
    def moving(self) -> Bool[np.ndarray, " moment"]:
        """Whether the vehicle moves."""
        return self.speed >= MOVING

    def rows(self, mask: np.ndarray) -> Situations:
        """Return the moments of a mask, or of indices."""
        return Situations(*(getattr(self, field.name)[mask] for field in fields(self)))

    def advanced(self, acceleration: Float64[np.ndarray, " moment"]) -> Situations:
        """Return the situations a second later, all others at their speeds.

        `acceleration` is that of each driver, m/s²; one that comes to a stand stays.
        """
        driven, speed = ballistic(self.speed, acceleration, 1.0)
        return replace(
            self,
            time=self.time + 1.0,
            speed=speed,
            last=acceleration,
            gap=self.gap + self.leader_speed - driven,
            behind=self.behind + driven - self.behind_speed,
            to_junction=self.to_junction - driven,
            to_area=self.to_area - driven,
            other_to_area=self.other_to_area - self.other_speed,
            other_gap=self.other_gap + self.other_leader_speed - self.other_speed,
        )

    def previous(self) -> Int64[np.ndarray, " moment"]:
        """Return the row of the same vehicle's moment a second before; -1 if there is none."""
        before = np.full(len(self), -1, np.int64)
        order = np.lexsort((self.time, self.recording, self.vehicle))
        earlier, later = order[:-1], order[1:]
        same = self.vehicle[earlier] == self.vehicle[later]
        same &= self.recording[earlier] == self.recording[later]
        same &= np.abs(self.time[later] - self.time[earlier] - 1.0) < 0.1
        before[later[same]] = earlier[same]
        return before

    def half(self) -> Int64[np.ndarray, " moment"]:
        """Return 0 for moments in the first half of the driver's conflicts, 1 for later ones.

        A driver's moments in conflict are cut in the middle, of an odd number the first half is the
        smaller; its other moments fall on either side by their time. Drivers without a conflict
        are cut in the middle of all their moments.
        """
        halves = np.ones(len(self), np.int64)
        order = np.lexsort((self.time, self.vehicle))
        ends = np.flatnonzero(np.diff(self.vehicle[order])) + 1
        for rows in np.split(order, ends) if len(order) else ():
            counted = rows[self.conflict[rows]]
            counted = counted if len(counted) else rows
            cut = counted[len(counted) // 2]
            halves[rows[: int(np.flatnonzero(rows == cut)[0])]] = 0
        return halves


def grouped(group: Int64[np.ndarray, " moment"], folds: int) -> Int64[np.ndarray, " moment"]:
    """Return the part of each moment, of at most so many; groups stay whole.

    The largest group left goes to the part that is the smallest so far.
    """
    number, sizes = np.unique(group, return_inverse=True, return_counts=True)[1:]
    filled = np.zeros(min(folds, len(sizes)))
    part_of = np.zeros(len(sizes), np.int64)
    for largest in np.argsort(-sizes, kind="stable"):
        part_of[largest] = np.argmin(filled)
        filled[part_of[largest]] += sizes[largest]
    return part_of[number]


SOON = 5.0
"""s within which both vehicles arrive at a conflict area, at their speeds, to be in conflict."""

_APART = 1e6  # s between recordings without a moment in common
_TURN = 20.0  # m ahead over which a change of direction is measured
_KINDS: dict[str, Any] = dict.fromkeys(("recording", "vehicle", "chain", "site"), np.int64)
_KINDS |= dict.fromkeys(("gives_way", "merging"), np.bool_)
_NO_AREA: dict[str, Any] = {
    "to_area": math.inf,
    "through": 0.0,
    "merging": False,
    "other_to_area": math.inf,
    "other_through": 0.0,
    "other_speed": 0.0,
    "other_gap": math.inf,
    "other_leader_speed": 0.0,
}


def situations_of(
    recordings: Sequence[Recording], identified: Identified, drop: bool = True
) -> Situations:
    """Return the situations of all vehicles on the road, one for each second.

    With `drop` a vehicle whose moments several recordings show gets moments in one only.

    Raises:
        UserError: If no vehicle is in view for a second.
    """
    tracks = [recording.tracks for recording in recordings]
    longest = tracks_kept(tracks, identified) if drop else None
    clocks = clocks_of(identified)
    sites, chains = (
        np.unique(names, return_inverse=True)[1] for names in (identified.site, identified.chain)
    )
    rows: list[Row] = []
    for number, recording in enumerate(recordings):
        source = _Seen(Encounters(Scene(recording)))
        for track in source.ways:
            if longest is not None and (number, track) not in longest:
                continue
            who: Row = {"recording": number, "vehicle": int(identified.vehicle[number][track])}
            who |= {"chain": int(chains[number]), "site": int(sites[number])}
            rows += [who | row for row in source.moments(track, clocks[number])]
    if not rows:
        raise UserError("no vehicle is on the road for a second and more: nothing can be predicted")
    return Situations(
        *(
            np.array([row[field.name] for row in rows], _KINDS.get(field.name, np.float64))
            for field in fields(Situations)
        )
    )


def clocks_of(identified: Identified) -> Float64[np.ndarray, " recording"]:
    """Return the time of each recording's frame 0 on one clock, s.

    Recordings with moments in common show them at one time; others are `_APART`.
    """
    count = len(identified.names)
    clocks = np.full(count, np.nan)
    beside: dict[int, list[tuple[int, float]]] = {number: [] for number in range(count)}
    for overlap in identified.overlaps:
        if overlap.seconds:
            # The second's clock shows `lag` at frame 0 of the first.
            beside[overlap.first].append((overlap.second, -overlap.lag))
            beside[overlap.second].append((overlap.first, overlap.lag))
    for root in range(count):
        waiting = deque([(root, _APART * root)]) if np.isnan(clocks[root]) else deque()
        while waiting:
            index, at = waiting.popleft()
            if np.isnan(clocks[index]):
                clocks[index] = at
                waiting += [(neighbour, at + lag) for neighbour, lag in beside[index]]
    return clocks


class _Seen:
    """Ways of a recording's vehicles with the speeds that it states."""

    def __init__(self, encounters: Encounters) -> None:
        self.encounters, self.scene = encounters, encounters.scene
        self.ways = {
            track: replace(way, speed=self.scene.speed[self.scene.rows(track)])
            for track, way in encounters.ways.items()
        }
        self.dt = self.scene.tracks.dt
        self.lanelets = self.scene.lanes.road.lanelets

    def moments(self, track: int, clock: float) -> list[Row]:
        """Return the situations of a vehicle that is in view for a second after them."""
        way, step, matched = self.ways[track], round(1.0 / self.dt), self.scene.matched(track)
        frames = range(way.first, way.last - step + 1, step)
        partners = []
        for number, partner in self.ways.items() if len(frames) else ():
            if number != track and len(motion.frames_together(way, partner)):
                area = self.encounters.area(track, number)
                partners += [] if area is None else [(partner, area)]
        junction_of, before, entries = self.scene.lanes.junction_of, None, []
        for number in way.lanelets:  # coordinates at which the route enters junctions
            if junction_of.get(number) is not None and junction_of.get(number) != before:
                start = self.lanelets[number].centre[0]
                entries.append(float(way.line.coordinates(start[:1], start[1:]).along[0]))
            before = junction_of.get(number)
        junctions, rows = np.array(entries), []
        for frame in frames:
            along, speed = way.state(frame)
            vehicles = motion.on_way(self.scene, way, frame, self.encounters.config.slack)
            ahead, behind = (
                motion.leader(way, along, vehicles),
                motion.follower(way, along, vehicles),
            )
            front = along + way.length / 2
            to_junction = junctions[junctions > front] - front
            then = frame + round(HORIZON / self.dt)
            at = np.clip([along, along + _TURN], 0.0, way.line.length)
            heading, later = way.line.points_at(at)[1].tolist()
            lanelet = self.lanelets[matched.lanelets[int(matched.place[frame - way.first])]]
            row: Row = {
                "time": clock + frame * self.dt,
                "speed": max(speed, 0.0),
                "last": _acceleration(way, frame, -1.0),
                "length": way.length,
                "gap": ahead.gap,
                "leader_speed": ahead.speed,
                "behind": behind.gap,
                "behind_speed": behind.speed,
                "to_junction": float(to_junction.min()) if len(to_junction) else math.inf,
                "turn": math.degrees(wrapped(later - heading)),
                "acceleration": _acceleration(way, frame, 1.0),
                "driven": way.state(then)[0] - along if then <= way.last else math.nan,
                "limit": lanelet.speed_limit,
                "gives_way": lanelet.sign in (Sign.YIELD, Sign.STOP),
            }
            rows.append(row | self._conflict(way, frame, partners))
        return rows

    def _conflict(
        self, way: motion.Way, frame: int, partners: list[tuple[motion.Way, Area]]
    ) -> Row:
        """Return the conflict whose later vehicle arrives first, at the speeds of the frame."""
        soonest_partner, soonest = None, math.inf
        for partner, area in partners:
            if partner.first <= frame <= partner.last:
                arrives = self._arrives(way, partner, area, frame)
                if arrives < soonest:
                    soonest_partner, soonest = (partner, area), arrives
        if soonest_partner is None:
            return _NO_AREA
        partner, area = soonest_partner
        along, speed = partner.state(frame)
        vehicles = motion.on_way(self.scene, partner, frame, self.encounters.config.slack)
        ahead = motion.leader(partner, along, vehicles.without(way.track))
        row: Row = {
            "to_area": area.entry[0] - way.length / 2 - way.state(frame)[0],
            "through": area.exit[0] - area.entry[0] + way.length,
            "merging": area.kind == Conflict.MERGING,
            "other_to_area": area.entry[1] - partner.length / 2 - along,
            "other_through": area.exit[1] - area.entry[1] + partner.length,
            "other_speed": max(speed, 0.0),
            "other_gap": ahead.gap,
        }
        return row | {"other_leader_speed": ahead.speed}

    def _arrives(self, way: motion.Way, partner: motion.Way, area: Area, frame: int) -> float:
        """Return the time until the later of two arrives; infinite if they are in no conflict."""
        now, config = frame * self.dt, self.encounters.config
        sides = ((way, area.entry[0], area.exit[0]), (partner, area.entry[1], area.exit[1]))
        times = [motion.projected(*side, frame) for side in sides]
        arrives = max(occupancy.enters for occupancy in times) - now
        gone = min(occupancy.leaves for occupancy in times) <= now
        if gone or arrives > SOON or motion.apart(*times) > config.near:
            return math.inf
        first = self.encounters.first_in_line
        alone = first(way, area.entry[0], frame, partner.track)
        alone = alone and first(partner, area.entry[1], frame, way.track)
        alone = alone and not self.encounters.held(way, partner, frame)
        return max(arrives, 0.0) if alone else math.inf


def _acceleration(way: motion.Way, frame: int, seconds: float) -> float:
    """Return the mean acceleration from a frame to a time after or before it, m/s²; NaN: unseen."""
    then = frame + round(seconds / way.dt)
    if not way.first <= then <= way.last:
        return math.nan
    return float(np.diff([way.state(frame)[1], way.state(then)[1]])[0]) / seconds
