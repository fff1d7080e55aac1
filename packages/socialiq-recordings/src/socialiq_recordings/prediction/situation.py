"""Situations of recorded drivers: what is known at a moment, and what the driver did next.

Only the route is taken as known beyond the moment. Speeds are those that the recording states for
its frame, because speeds over a longer time look ahead. `advanced` lets a driver go on with an
acceleration while all others keep their speeds, so that a model can be rolled out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64

MOVING = 0.5
"""m/s; a slower vehicle stands."""

HORIZON = 3
"""s after a moment to which the position is predicted."""


@dataclass(frozen=True, eq=False)
class Situations:
    """Situations, a row for each moment of a vehicle.

    A distance is infinite, and its speed 0, where there is no such vehicle.

    Attributes:
        recording: Index of the recording.
        vehicle: Number of the vehicle over all recordings.
        chain: Number of the chain.
        site: Number of the site.
        time: s, on one clock: recordings overlap on it only where they have moments in common.
        speed: m/s.
        last: Acceleration of the second before, m/s²; NaN if the vehicle wasn't in view.
        length: Of the vehicle, m.
        gap: To the leader, m, bumper to bumper.
        leader_speed: m/s.
        behind: Gap of the follower, m.
        behind_speed: m/s.
        to_junction: From the front to the next junction on the route, m.
        turn: Change of direction over the next 20 m, degrees, positive to the left.
        limit: Speed limit, m/s; infinite if unknown.
        gives_way: Whether a sign on the lanelet tells it to yield or to stop.
        to_area: From the front to the conflict area, m; negative inside.
        through: From its beginning until the rear has left it, m.
        merging: Whether the ways merge there.
        other_to_area: The other vehicle's distance to it, m.
        other_through: As `through`, m.
        other_speed: m/s.
        other_gap: The other's gap to its own leader, m.
        other_leader_speed: m/s.
        acceleration: Observed mean of the next second, m/s²; a target.
        driven: Distance after `HORIZON` s, m; NaN if the vehicle wasn't in view; a target.
    """

    recording: Int64[np.ndarray, " moment"]
    vehicle: Int64[np.ndarray, " moment"]
    chain: Int64[np.ndarray, " moment"]
    site: Int64[np.ndarray, " moment"]
    time: Float64[np.ndarray, " moment"]
    speed: Float64[np.ndarray, " moment"]
    last: Float64[np.ndarray, " moment"]
    length: Float64[np.ndarray, " moment"]
    gap: Float64[np.ndarray, " moment"]
    leader_speed: Float64[np.ndarray, " moment"]
    behind: Float64[np.ndarray, " moment"]
    behind_speed: Float64[np.ndarray, " moment"]
    to_junction: Float64[np.ndarray, " moment"]
    turn: Float64[np.ndarray, " moment"]
    limit: Float64[np.ndarray, " moment"]
    gives_way: Bool[np.ndarray, " moment"]
    to_area: Float64[np.ndarray, " moment"]
    through: Float64[np.ndarray, " moment"]
    merging: Bool[np.ndarray, " moment"]
    other_to_area: Float64[np.ndarray, " moment"]
    other_through: Float64[np.ndarray, " moment"]
    other_speed: Float64[np.ndarray, " moment"]
    other_gap: Float64[np.ndarray, " moment"]
    other_leader_speed: Float64[np.ndarray, " moment"]
    acceleration: Float64[np.ndarray, " moment"]
    driven: Float64[np.ndarray, " moment"]

    def __len__(self) -> int:
        """Return the number of moments."""
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
        """Return some moments.

        Args:
            mask: Those to keep, or their indices.
        """
        return Situations(*(getattr(self, one.name)[mask] for one in fields(self)))

    def advanced(self, acceleration: Float64[np.ndarray, " moment"]) -> Situations:
        """Return the situations a second later, all others at their speeds.

        Args:
            acceleration: Of each driver, m/s²; one that comes to a stand stays.
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
        found = np.full(len(self), -1, np.int64)
        order = np.lexsort((self.time, self.recording, self.vehicle))
        one, two = order[:-1], order[1:]
        same = self.vehicle[one] == self.vehicle[two]
        same &= self.recording[one] == self.recording[two]
        same &= np.abs(self.time[two] - self.time[one] - 1.0) < 0.1
        found[two[same]] = one[same]
        return found

    def half(self) -> Int64[np.ndarray, " moment"]:
        """Return 0 for moments in the first half of the driver's conflicts, 1 for later ones.

        A driver's moments in conflict are cut in the middle, of an odd number the first half is the
        smaller; its other moments fall on either side by their time. Drivers without a conflict
        are cut in the middle of all their moments.
        """
        found = np.ones(len(self), np.int64)
        order = np.lexsort((self.time, self.vehicle))
        ends = np.flatnonzero(np.diff(self.vehicle[order])) + 1
        for rows in np.split(order, ends) if len(order) else ():
            counted = rows[self.conflict[rows]]
            counted = counted if len(counted) else rows
            cut = counted[len(counted) // 2]
            found[rows[: int(np.flatnonzero(rows == cut)[0])]] = 0
        return found


def joined(parts: Sequence[Situations]) -> Situations:
    """Return the moments of several tables in one."""
    return Situations(
        *(np.concatenate([getattr(one, f.name) for one in parts]) for f in fields(Situations))
    )


def ballistic(
    speed: Float64[np.ndarray, "*shape"], rate: Float64[np.ndarray, "*shape"], seconds: float
) -> tuple[Float64[np.ndarray, "*shape"], Float64[np.ndarray, "*shape"]]:
    """Return distances and speeds after constant accelerations, as `conflicts.idm.ballistic`.

    Args:
        speed: m/s.
        rate: m/s².
        seconds: Duration.
    """
    after = speed + rate * seconds
    stops = after < 0
    until_stand = speed**2 / (-2 * np.where(stops, rate, -1.0))
    driven = np.where(stops, until_stand, (speed + after) / 2 * seconds)
    return driven, np.maximum(after, 0.0)
