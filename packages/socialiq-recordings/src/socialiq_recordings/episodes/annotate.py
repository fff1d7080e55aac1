"""Annotation of a recorded vehicle as the ego: observations, actions and rewards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int8, Int32, Int64

from socialiq.types import Ending
from socialiq.worlds.highway import network
from socialiq.worlds.highway.core.compile import run_in_parts
from socialiq.worlds.highway.settings import SIGNALS
from socialiq.worlds.highway.state import FEATURES, Contact
from socialiq.worlds.intersection.core import geometry
from socialiq.worlds.intersection.core.annotator import SEEN, SNAPSHOT, run
from socialiq.worlds.intersection.core.ego import EXIT_DISTANCE
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.settings import settings_of
from socialiq_recordings.episodes import actions, decisions
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.scene import Scene, same_direction
from socialiq_recordings.road.paths import Path
from socialiq_recordings.road.routes import APPROACH, EXIT, JUNCTION, Crossing

_BOUNDARY = 2.0  # m before the end of a section within which the next section may count
_KINDS = {APPROACH: network.APPROACH, JUNCTION: geometry.STRAIGHT, EXIT: network.EXIT}


@dataclass(frozen=True, eq=False)
class Driven:
    """Episode of one vehicle.

    Attributes:
        track: Number of the track in the recording.
        junction: Index of the junction in `Lanes.junctions`.
        frame: Frame of every decision, and of the end of the last decision.
        observation: Observation there, in the simulator's frame: the junction's centre is the
            origin and the ego comes from the south.
        action: Action of each decision, by the discretisation of the options.
        residual: Speed one decision later minus that predicted by the action, m/s.
        speed: Speed at every decision and at the end, m/s.
        pair: r_env and r_social of every decision.
        signals: Signals of the rewards, in the order of `SIGNALS`.
        ending: Value of `Ending`, by decision; TIMEOUT at the end of the view or the time limit.
        jump: Largest difference between a decision's advance along the route and the distance
            driven, m; large where the lanelets don't fit the track.
        contact: Value of the simulator's `Contact`: whose motion closed the gap, if it collided.
    """

    track: int
    junction: int
    frame: Int64[np.ndarray, " decision_and_one"]
    observation: Float32[np.ndarray, "decision_and_one feature"]
    action: Int32[np.ndarray, " decision"]
    residual: Float64[np.ndarray, " decision"]
    speed: Float64[np.ndarray, " decision_and_one"]
    pair: Float64[np.ndarray, "decision 2"]
    signals: Float64[np.ndarray, "decision signal"]
    ending: Int8[np.ndarray, " decision"]
    jump: float
    contact: int


class Prepared(NamedTuple):
    """Records of an episode for the kernels of observation and rewards.

    Attributes:
        options: The simulator's options at the recording's rate.
        rows: The ego's rows at every decision, and at the end of the last one.
        snapshots: SNAPSHOT records, by row.
        seen: SEEN records, by row and slot; slots are the vehicles present in that frame, in the
            order of `Scene.present`.
        contact: The ego's contact at the end.
    """

    options: Options
    rows: Int64[np.ndarray, " decision_and_one"]
    snapshots: np.ndarray
    seen: np.ndarray
    contact: Contact


def prepare(scene: Scene, track: int, way: Crossing, config: EpisodeConfig) -> Prepared | None:
    """Return the records of a vehicle's way over a junction; None if it lacks a decision.

    Args:
        scene: The recording.
        track: The vehicle.
        way: Its way over the junction.
        config: The choices.

    Raises:
        UserError: If the policy rate doesn't fit the recording's.
    """
    options = config.options_at(scene.tracks.dt)
    rows = _decision_rows(scene, track, way, options)
    if len(rows) < 2:
        return None
    snapshots = _ego(scene, way, rows)
    endings, contact = _endings(scene, track, rows, snapshots, options, config)
    last = next((k for k, one in enumerate(endings) if one), len(rows) - 1)
    rows, snapshots = rows[: last + 1], snapshots[: last + 1]
    snapshots["ending"] = endings[: last + 1]
    seen = _vehicles(scene, track, way, rows, snapshots, options, config)
    return Prepared(options, rows, snapshots, seen, contact)


def driven(
    scene: Scene,
    track: int,
    way: Crossing,
    config: EpisodeConfig,
    without: Callable[[Prepared], Bool[np.ndarray, "snapshot slot"]] | None = None,
) -> Driven | None:
    """Annotate a vehicle's way over a junction; None if it is shorter than one decision.

    Args:
        scene: The recording.
        track: The vehicle.
        way: Its way over the junction.
        config: The choices.
        without: Function that marks losses of speed that are not the ego's doing.

    Raises:
        UserError: If the policy rate doesn't fit the recording's.
    """
    ready = prepare(scene, track, way, config)
    if ready is None:
        return None
    options, rows, snapshots, seen, contact = ready
    endings = snapshots["ending"].tolist()
    if without is not None:
        seen["lost"][without(ready)] = 0.0
    observation = np.zeros((len(rows), options.observed_vehicles, len(FEATURES)), np.float32)
    signals, pairs = np.zeros((len(rows), len(SIGNALS))), np.zeros((len(rows), 2))
    arguments = snapshots, seen, settings_of(options), observation, signals, pairs
    run_in_parts(run, 0, len(snapshots), *arguments)
    if endings[-1] == Ending.NONE:
        endings[-1] = Ending.TIMEOUT  # out of view
    speed = scene.speed[rows]
    return Driven(
        track,
        way.junction,
        scene.tracks.frame[rows].astype(np.int64),
        observation.reshape(len(rows), -1),
        *_actions(speed, options, config),
        speed,
        pairs[1:],
        signals[1:],
        np.array(endings[1:], np.int8),
        float(abs(abs(snapshots["advance"]) - _distances(scene, rows)).max()),
        int(contact) if endings[-1] == Ending.COLLISION else int(Contact.NONE),
    )


def _actions(
    speed: Float64[np.ndarray, " decision_and_one"], options: Options, config: EpisodeConfig
) -> tuple[Int32[np.ndarray, " decision"], Float64[np.ndarray, " decision"]]:
    if config.actions == "accelerations":
        return decisions.levels_of(speed, config.levels, 1 / config.policy_rate)
    return actions.inferred(speed, options)


def _distances(
    scene: Scene, rows: Int64[np.ndarray, " snapshot"]
) -> Float64[np.ndarray, " snapshot"]:
    """Return the distance of each snapshot from the previous snapshot, m; 0 at the first."""
    x, y = scene.tracks.x[rows], scene.tracks.y[rows]
    return np.hypot(np.diff(x, prepend=x[0]), np.diff(y, prepend=y[0]))


def _decision_rows(
    scene: Scene, track: int, way: Crossing, options: Options
) -> Int64[np.ndarray, " decision_and_one"]:
    """Return the rows of decisions, from the start of the way to this junction."""
    matched, of = scene.matched(track), scene.lanes.junction_of
    others = [p for p in range(way.first) if matched.lanelets[p] in of]
    begun = np.flatnonzero(matched.place > (others[-1] if others else -1))
    if len(begun) == 0:
        return np.zeros(0, np.int64)
    rows = scene.rows(track)
    return np.arange(rows.start + int(begun[0]), rows.stop, options.frames)


def _ego(scene: Scene, way: Crossing, rows: Int64[np.ndarray, " snapshot"]) -> np.ndarray:
    """Return SNAPSHOT records of the ego, without its slot, the count and the ending."""
    tracks = scene.tracks
    x, y = tracks.x[rows], tracks.y[rows]
    made = np.zeros(len(rows), SNAPSHOT)
    part = way.part[rows - scene.rows(int(tracks.track[rows[0]])).start]
    made["kind"] = [_KINDS[int(one)] for one in part]
    for one, path in enumerate(way.sections):
        here = part == one
        if path is not None and here.any():
            made["along"][here] = path.coordinates(x[here], y[here]).along
            made["length"][here] = path.length
    route = _route_coordinate(way, part, x, y)
    made["advance"] = np.diff(route, prepend=route[:1])
    made["travelled"] = route - route[0]
    made["on_road"] = scene.lanes.on_road(x, y)
    return made


def _route_coordinate(
    way: Crossing,
    part: Int64[np.ndarray, " snapshot"],
    x: Float64[np.ndarray, " snapshot"],
    y: Float64[np.ndarray, " snapshot"],
) -> Float64[np.ndarray, " snapshot"]:
    """Return metres along the sequence of sections.

    As in `core.ego.route_coordinate`, a vehicle is on the first section whose end it has not
    passed. Only the matched section and its neighbours are considered, because on a curved
    road coordinates along other sections are meaningless.
    """
    found = np.empty(len(x))
    lengths = [path.length if path is not None else 0.0 for path in way.sections]
    along = [path.coordinates(x, y).along if path is not None else None for path in way.sections]
    for row, matched in enumerate(part.tolist()):
        section = matched
        before, own = along[matched - 1] if matched else None, along[matched]
        assert own is not None  # a state is in it
        if before is not None and -_BOUNDARY <= before[row] - lengths[matched - 1] <= 0.0:
            section = matched - 1
        elif own[row] > lengths[matched] and matched < EXIT and along[matched + 1] is not None:
            section = matched + 1
        here = along[section]
        assert here is not None
        metres = float(here[row])
        first = all(one is None for one in along[:section])
        found[row] = sum(lengths[:section]) + (metres if first else max(metres, 0.0))
    return found


def _endings(
    scene: Scene,
    track: int,
    rows: Int64[np.ndarray, " snapshot"],
    snapshots: np.ndarray,
    options: Options,
    config: EpisodeConfig,
) -> tuple[list[int], Contact]:
    """Return the ending at each snapshot, the first of which is the start, and the contact."""
    arrived = (snapshots["kind"] == network.EXIT) & (snapshots["along"] >= EXIT_DISTANCE)
    late = np.arange(len(rows)) / options.policy_frequency >= options.duration
    endings, contact = [int(Ending.NONE)] * len(rows), Contact.NONE
    for k in range(1, len(rows)):
        contact = _contact(scene, track, int(rows[k - 1]), int(rows[k]), int(rows[0]), config)
        if contact != Contact.NONE:
            endings[k] = int(Ending.COLLISION)
        elif arrived[k]:
            endings[k] = int(Ending.ARRIVAL)
        elif config.clock and late[k]:
            endings[k] = int(Ending.TIMEOUT)
        if endings[k]:
            break
    return endings, contact


def _contact(
    scene: Scene, track: int, before: int, after: int, first: int, config: EpisodeConfig
) -> Contact:
    """Return the ego's first contact between two rows, and which vehicle struck."""
    predicted = config.contact == "predicted"
    slack = 0.0 if predicted else config.slack
    for row in range(before + 1, after + 1):
        if predicted and row - 1 > first:
            found = scene.contact(track, row - 1, scene.tracks.dt, slack)
            if found != Contact.NONE:
                return found
        shock = config.shock if config.contact == "evidence" else 0.0
        found = scene.contact(track, row, 0.0, slack, shock)
        if found != Contact.NONE:
            return found
    return Contact.NONE


def _vehicles(
    scene: Scene,
    track: int,
    way: Crossing,
    rows: Int64[np.ndarray, " snapshot"],
    snapshots: np.ndarray,
    options: Options,
    config: EpisodeConfig,
) -> np.ndarray:
    """Return SEEN records of all vehicles; write the ego's slot and the count to the snapshots."""
    present = [scene.present(int(scene.tracks.frame[row])) for row in rows]
    made = np.zeros((len(rows), max(map(len, present))), SEEN)
    entry = scene.heading_before(way)
    for k, (row, there) in enumerate(zip(rows.tolist(), present, strict=True)):
        seen = made[k, : len(there)]
        snapshots["count"][k], snapshots["ego"][k] = len(there), np.flatnonzero(there == row)[0]
        _place(scene, way, entry, there, seen)
        line = _line(scene, track, way, row)
        seen["along"] = line.coordinates(scene.tracks.x[there], scene.tracks.y[there]).along
        for slot, other in enumerate(there.tolist()):
            summed = config.loss == "summed"
            seen["lost"][slot] = scene.lost(other, options.frames, summed)
            seen["kind"][slot], seen["same_origin"][slot] = _seat(scene, way, entry, other)
    return made


def _place(
    scene: Scene, way: Crossing, entry: float, rows: Int64[np.ndarray, " there"], seen: np.ndarray
) -> None:
    """Write positions and headings in the simulator's frame: y to the south, clockwise."""
    tracks, centre = scene.tracks, scene.lanes.junctions[way.junction]
    turn = np.pi / 2 - entry
    cos, sin = np.cos(turn), np.sin(turn)
    dx, dy = tracks.x[rows] - centre.x, tracks.y[rows] - centre.y
    seen["x"], seen["y"] = cos * dx - sin * dy, -(sin * dx + cos * dy)
    heading = -(tracks.heading[rows] + turn)
    seen["along_x"], seen["along_y"] = np.cos(heading), np.sin(heading)
    seen["speed"] = scene.speed[rows]


def _line(scene: Scene, track: int, way: Crossing, row: int) -> Path:
    """Return the ego's lane: its section, or inside the junction the nearest lanelet."""
    state = row - scene.rows(track).start
    nearest, part = int(scene.matched(track).nearest[state]), int(way.part[state])
    if part == JUNCTION and nearest in scene.lanes.junctions[way.junction].lanelets:
        return scene.matcher.path(nearest)
    section = way.sections[part]
    assert section is not None  # a state is in it
    return section


def _seat(scene: Scene, way: Crossing, entry: float, row: int) -> tuple[int, bool]:
    """Return a vehicle's kind of lane, and whether it entered by the ego's approach."""
    track = int(scene.tracks.track[row])
    other = scene.crossing(track, way.junction)
    if other is None:
        return network.EXIT, False
    part = int(other.part[row - scene.rows(track).start])
    return _KINDS[part], same_direction(entry, scene.heading_before(other))
