"""Recorded traffic in the page: lanes, vehicles, conflicts, who yields to whom, and rewards."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.types import Ending
from socialiq.view import View
from socialiq_recordings import files
from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.measures import finite_or_none, rows_of
from socialiq_recordings.readers import import_file
from socialiq_recordings.recording import Recording, RoadUser
from socialiq_recordings.road.routes import Scene
from socialiq_recordings.signs_of_simulation import signs_of_simulation
from socialiq_recordings.world.build import build
from socialiq_recordings.world.config import SUB_STEPS, WorldConfig
from socialiq_recordings.world.replay import replay

CHUNK = 100  # frames in a part that the page fetches
_NAMES = ("kind", "complete", "ego_first", "pet")
_NEEDED = ("required_deceleration", "other_required_deceleration")
_CM = 2  # decimals of metres


class Traffic:
    """A recording, as the page shows it.

    Raises:
        UserError: If it has no state, or Shapely is not installed.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._tracks = recording.tracks
        if not self._tracks.n_states:
            raise UserError("the recording has no road user: name another")
        self._first = int(self._tracks.frame.min())
        self.frames = int(self._tracks.frame.max()) - self._first + 1
        self._order = np.argsort(self._tracks.frame, kind="stable")
        self._at = np.searchsorted(
            self._tracks.frame[self._order], self._first + np.arange(self.frames + 1)
        )

    @property
    def parts(self) -> int:
        """Number of parts of the frames."""
        return math.ceil(self.frames / CHUNK)

    def part(self, number: int) -> dict[str, Any]:
        """Return the `frames` of a part, JSON-compatible.

        A row for each road user: track, x, y in m, heading in rad, speed in m/s.
        """
        of = self._tracks
        frames = []
        for frame in range(number * CHUNK, min((number + 1) * CHUNK, self.frames)):
            rows = self._order[self._at[frame] : self._at[frame + 1]]
            columns = (of.x, of.y, of.heading, np.hypot(of.vx, of.vy))
            values = np.stack([column[rows] for column in columns], axis=1).round(3).tolist()
            tracks = of.track[rows].tolist()
            frames.append([[track, *row] for track, row in zip(tracks, values, strict=True)])
        return {"frames": frames}

    def users(self) -> list[dict[str, Any]]:
        """Return the road users by track: name, size in m, and whether each drives."""
        of = self._tracks
        columns = of.identity.tolist(), of.road_user.tolist(), of.length, of.width
        users = []
        for name, kind, length, width in zip(*columns, strict=True):
            user = {"name": name, "user": RoadUser(kind).name.lower()}
            users.append(user | {"length": round(length, 2), "width": round(width, 2)})
        return users

    def lanes(self) -> list[dict[str, Any]]:
        """Return both bounds of each lanelet, m."""
        return [
            {"left": lanelet.left.round(_CM).tolist(), "right": lanelet.right.round(_CM).tolist()}
            for lanelet in self._recording.road.lanelets.values()
        ]

    def conflicts(self) -> list[dict[str, Any]]:
        """Return the conflicts of unordered pairs, those that came closest first.

        Frames count from the first of the recording.
        """
        if not self._recording.road.lanelets:
            return []
        encounters = Encounters(Scene(self._recording))
        pairs = [
            meeting
            for meeting in encounters.meetings()
            if meeting.area.is_conflict and meeting.ego.track < meeting.other.track
        ]
        conflicts = []
        for meeting, row in zip(pairs, rows_of(encounters, pairs), strict=True):
            times = (*meeting.ego_times, *meeting.other_times)
            ends = (*meeting.frames[:1], *meeting.frames[-1:])
            conflict = {
                "tracks": [meeting.ego.track, meeting.other.track],
                "outline": meeting.area.outline.round(_CM).tolist(),
                "times": [finite_or_none(time / self._tracks.dt - self._first) for time in times],
                "seen": [int(frame) - self._first for frame in ends],
            }
            conflicts.append(conflict | {name: row[name] for name in (*_NAMES, *_NEEDED)})
        return sorted(
            conflicts, key=lambda conflict: math.inf if conflict["pet"] is None else conflict["pet"]
        )

    def drivers(self) -> list[dict[str, Any]]:
        """Return the vehicles that drive across a conflict area, with their decisions' rewards."""
        if not self._recording.road.lanelets:
            return []
        try:
            built = build([self._recording], WorldConfig())
            replayed = replay(built.world)
        except UserError:
            return []  # no vehicle meets a conflict, or is seen for a whole decision
        tracks = list(built.every[0].ways)
        table = replayed.table
        rewards = np.stack([table.rewards.env, table.rewards.social], axis=1).round(4)
        frame = 1 / (SUB_STEPS * self._tracks.dt)  # of a sub-step
        drivers = []
        for vehicle, first, count in zip(
            replayed.vehicle.tolist(), table.episode_starts, table.episode_lengths, strict=True
        ):
            begin = int(replayed.step[first])
            steps = begin + np.arange(count + 1) * built.world.config.frames
            driver = {"track": tracks[vehicle], "rewards": rewards[first : first + count].tolist()}
            driver["frames"] = np.rint(steps * frame).astype(int).tolist()
            ending = Ending(int(table.ending[first + count - 1])).name.lower()
            drivers.append(driver | {"ending": ending})
        return drivers


def recording_view(path: Path) -> View:
    """Return a file of `socialiq data import`, or a CommonRoad scenario, as content of the page.

    Raises:
        UserError: If it can't be read, is empty, or an extra is missing that it needs.
    """
    if path.suffix.lower() == ".xml":
        (imported,) = import_file(path)
        recording = imported.recording
    else:
        recording = files.load(path)
    traffic = Traffic(recording)
    tracks = recording.tracks
    simulated = " Simulated, not human." if signs_of_simulation(tracks) else ""
    seconds = f"{traffic.frames * tracks.dt:,.0f} s"
    lead = f"{tracks.n_tracks:,} recorded road users in {seconds}.{simulated}"
    data: dict[str, Any] = {
        "dt": tracks.dt,
        "frames": traffic.frames,
        "chunk": CHUNK,
        "users": traffic.users(),
        "lanes": traffic.lanes(),
        "conflicts": traffic.conflicts(),
        "drivers": traffic.drivers(),
    }
    title = one_line(tracks.recording, 60)
    return View("traffic", title, lead, data, count=traffic.parts, part=traffic.part)
