"""`data conflicts`: conflicts of recorded vehicles, their measures, and pictures of them."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError
from socialiq.physics import corners
from socialiq.plotting.style import COLORS, figure, finish, png
from socialiq.results_folder import Results, check_target, save
from socialiq.types import Row
from socialiq_recordings.cli.files import OfDistinct, not_used, sources_of
from socialiq_recordings.conflicts.encounters import ConflictConfig, Encounters, Meeting
from socialiq_recordings.conflicts.measures import rows_of
from socialiq_recordings.conflicts.ways import BEHIND
from socialiq_recordings.identity.identify import Identified, pairs_once
from socialiq_recordings.road.routes import Scene

MOST_PICTURES = 200  # largest number of pictures of a call


@dataclass(frozen=True)
class FindConflicts(OfDistinct):
    """List conflicts of recorded vehicles with PET, TTC, gaps and required decelerations.

    Example: socialiq data conflicts junction.safetensors --out conflicts --pictures 20
    """

    out: Path | None = None
    """Folder to write: conflicts, counts by recording, pictures."""
    largest_pet: float = ConflictConfig.near
    """Seconds between two vehicles in an area above which they are in no conflict."""
    horizon: float = ConflictConfig.horizon
    """Seconds ahead in which both must arrive at their present speeds."""
    queued: bool = False
    """Also list conflicts of vehicles that are behind others of their lane."""
    pictures: int = 0
    """Number of conflicts to draw, chosen at random."""
    seed: int = 0
    """Seed of that choice."""
    replace: bool = False
    """Replace earlier results in the folder."""

    def run(self) -> int:
        """Find, measure, write, print."""
        if self.pictures > MOST_PICTURES or self.pictures < 0:
            raise UserError(f"--pictures must be from 0 to {MOST_PICTURES}, got {self.pictures}")
        if self.pictures and self.out is None:
            raise UserError("--pictures needs --out: name the folder for them")
        config = ConflictConfig(self.largest_pet, self.horizon, self.queued)
        if self.out is not None:
            check_target(self.out, self.replace)
        recordings, identified = self.load()
        every = [Encounters(Scene(recording), config) for recording in recordings]
        cases = _cases(every, identified, self.duplicates == "drop")
        conflicts = [row for _, _, row in cases]
        counts = []
        for recording in recordings:
            name = recording.tracks.recording
            rows = [row for row in conflicts if row["recording"] == name]
            pairs = [row for row in rows if row["ego"] < row["other"]]
            count: Row = {"recording": name, "tracks": recording.tracks.n_tracks}
            count |= {"conflicts": len(rows) // 2}
            for kind in ("crossing", "merging"):
                count[kind] = sum(row["kind"] == kind for row in rows) // 2
            counts.append(count | {"with_pet": sum(row["pet"] is not None for row in pairs)})
        names = ("conflicts", "crossing", "merging", "with_pet")
        summary: dict[str, Any] = {name: sum(row[name] for row in counts) for name in names}
        summary |= {"vehicles": len({row["ego_vehicle"] for row in conflicts})}
        summary |= {"chains": len({row["chain"] for row in conflicts})} | not_used(every)
        if self.out is not None:
            provenance: Row = {
                "conflicts": dataclasses.asdict(config),
                "duplicates": self.duplicates,
                "pictures": self.pictures,
                "seed": self.seed,
                "sources": sources_of(recordings),
            }
            tables = {"recordings": counts, "conflicts": conflicts}
            results = Results.of("recordings conflicts", provenance, tables, summary)
            # Pictures of pairs of vehicles chosen at random, each once.
            pairs = [case for case in cases if case[1].ego.track < case[1].other.track]
            chosen = np.random.default_rng(self.seed).permutation(len(pairs))[: self.pictures]
            drawings = {
                f"conflict-{number:02d}": picture(*pairs[index])
                for number, index in enumerate(sorted(chosen.tolist()), 1)
            }
            save(results, self.out, png(drawings), self.replace)
        if self.json:
            print_json(summary | {"conflicts": conflicts})
        else:
            print_table(counts, "Conflicts of unordered pairs")
        return 0


def _cases(
    encounters: list[Encounters], identified: Identified, drop: bool
) -> list[tuple[Encounters, Meeting, Row]]:
    """Return conflicts, each with its encounters and row; with `drop`, each counts once."""
    meetings = {
        (number, meeting.ego.track, meeting.other.track): meeting
        for number, of_recording in enumerate(encounters)
        for meeting in of_recording.meetings()
        if meeting.area.is_conflict
    }
    if drop:
        durations = {key: len(m.frames) * m.ego.dt for key, m in meetings.items()}
        longest = pairs_once(durations, identified)
        meetings = {key: meeting for key, meeting in meetings.items() if key in longest}
    cases = []
    for (number, ego, partner), meeting in meetings.items():
        (row,) = rows_of(encounters[number], [meeting])
        vehicle = identified.vehicle[number]
        row |= {"site": identified.site[number], "chain": identified.chain[number]}
        row |= {"ego_vehicle": int(vehicle[ego]), "other_vehicle": int(vehicle[partner])}
        cases.append((encounters[number], meeting, row))
    return cases


_REACH = 35.0  # m around the place where the ego enters the area
_INKS = (COLORS["prosocial"], COLORS["egoistic"])


def picture(encounters: Encounters, meeting: Meeting, row: Row) -> Figure:
    """Draw a conflict: both ways on the map, and both distances to the area over time."""
    drawing = figure(9.0, 4.3)
    drawing.set_dpi(85)
    left, right = drawing.subplots(1, 2, width_ratios=(1.15, 1.0))
    _map(left, encounters, meeting)
    ways, both_times = (meeting.ego, meeting.other), (meeting.ego_times, meeting.other_times)
    sides = zip("AB", _INKS, ways, both_times, meeting.area.entry, strict=True)
    for below, (letter, ink, way, times, entry) in enumerate(sides):
        time = (way.first + np.arange(len(way.along))) * way.dt
        front = entry - way.length / 2 - way.along
        right.plot(time, front, color=ink, label=f"{letter}, recorded")
        if np.isfinite(times.enters):
            end = times.leaves if np.isfinite(times.leaves) else times.enters
            ends, height = [times.enters, max(end, times.enters + 0.1)], -1.5 - 1.5 * below
            bar = {"linewidth": 5, "solid_capstyle": "butt", "label": f"{letter} in the area"}
            right.plot(ends, [height] * 2, color=ink, **bar)
    right.axhline(0.0, color="#888888", linewidth=0.8)
    right.set_ylim(-15.0, 60.0)
    finish(right, "", 7, xlabel="s from the start", ylabel="m from the front to the area")
    order = {None: "neither arrives", True: "A first", False: "B first"}[row["ego_first"]]
    texts = [f"{row['recording']}: A {row['ego']}, B {row['other']}", row["kind"], order]
    for name, words, unit in (
        ("pet", "PET", "s"),
        ("ttc", "TTC", "s"),
        ("required_deceleration", "A needs", "m/s²"),
        ("other_required_deceleration", "B needs", "m/s²"),
    ):
        value = row[name]
        texts.append(f"{words} {'unknown' if value is None else f'{value:.1f} {unit}'}")
    drawing.suptitle(", ".join(texts), fontsize=9)
    return drawing


def _map(axes: Any, encounters: Encounters, meeting: Meeting) -> None:
    """Draw the last frame at which both are present before the first enters the area."""
    area, scene, ways = meeting.area, encounters.scene, (meeting.ego, meeting.other)
    for lanelet in scene.lanes.road.lanelets.values():
        for bound in (lanelet.left, lanelet.right):
            axes.plot(*bound.T, color="#bbbbbb", linewidth=0.6)
    axes.add_patch(Polygon(area.outline, color="#f0c000", alpha=0.5, zorder=2))
    enters = min(meeting.ego_times.enters, meeting.other_times.enters)
    low, high = max(way.first for way in ways), min(way.last for way in ways)
    moment = high if np.isinf(enters) else int(enters / meeting.ego.dt)
    frame = int(np.clip(moment, low, high))
    tracks, rows = scene.tracks, scene.present(frame)
    for row in rows[~np.isin(tracks.track[rows], [way.track for way in ways])].tolist():
        track = tracks.track[row]
        size = float(tracks.length[track]), float(tracks.width[track])
        centre = np.array([tracks.x[row], tracks.y[row]])
        outline = corners(centre, float(tracks.heading[row]), *size)
        axes.add_patch(Polygon(outline, color="#999999", alpha=0.5))
    for letter, way, ink in zip("AB", ways, _INKS, strict=True):
        driven = way.line.starts.searchsorted(way.along[-1], side="right")
        axes.plot(*way.line.points[1:driven].T, color=ink, linewidth=1.6, zorder=3)
        axes.plot(*way.line.points[driven - 1 :].T, color=ink, linewidth=1.0, linestyle=":")
        point, heading = way.line.points_at(np.array([max(way.state(frame)[0], BEHIND)]))
        outline = corners(point[0], float(heading[0]), way.length, way.width)
        axes.add_patch(Polygon(outline, color=ink, alpha=0.8, zorder=4))
        style = {"ha": "center", "va": "center", "color": "white", "fontsize": 8, "zorder": 5}
        axes.annotate(letter, point[0], **style)
    finish(axes, f"at {frame * meeting.ego.dt:.1f} s; others in grey")
    axes.set_aspect("equal")
    x, y = meeting.ego.line.points_at(np.array(area.entry[:1]))[0][0]
    axes.set_xlim(x - _REACH, x + _REACH)
    axes.set_ylim(y - _REACH, y + _REACH)
