"""Construction of a world from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq_recordings.conflicts.encounters import Area, ConflictConfig, Encounters
from socialiq_recordings.conflicts.measures import sign, turn
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.identity.identify import Identified, identify, once, same_moments
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Conflict
from socialiq_recordings.road.routes import Scene
from socialiq_recordings.simulated import signs_of_simulation
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.drivers import Calibration, Observed, calibrate, observe
from socialiq_recordings.world.lines import (
    SPACING,
    closures_of,
    line_of,
    on_way_of,
    speed_limits,
    states_of,
    stretches,
)
from socialiq_recordings.world.recorded_world import LAYOUT, RecordedWorld, Road

_MINOR = ("yield", "stop")
_MAJOR = ("priority", "none", "light")
_LEFT, _STRAIGHT = 45.0, 30.0  # degrees


def yields(encounters: Encounters, way: Way, other: Way, area: Area) -> int:
    """Return 1 if the first vehicle yields, -1 if the other does, 0 if who comes first goes first.

    Args:
        encounters: Of the recording.
        way: Of the first vehicle.
        other: Way of the other.
        area: Their conflict area, the first one's coordinates first.
    """
    signs = sign(encounters, way, other), sign(encounters, other, way)
    if signs[0] in _MINOR and signs[1] in _MAJOR:
        return 1
    if signs[1] in _MINOR and signs[0] in _MAJOR:
        return -1
    if area.kind == Conflict.CROSSING:
        turns = turn(way, area.entry[0], area.exit[0]), turn(other, area.entry[1], area.exit[1])
        left = turns[0] > _LEFT, turns[1] > _LEFT
        if left[0] != left[1] and min(abs(turn) for turn in turns) < _STRAIGHT:
            return 1 if left[0] else -1
    return 0


LEAST_VEHICLES = 2
MOST_VEHICLES = 2000
"""Vehicles of one recording; 16 bytes are kept for each two of them."""

_APPROACH = 20.0  # m before the first conflict area: the influence zone, as at the intersection
_BEYOND = 10.0  # m behind the last conflict area at which the ego has arrived
_LEAST_WAY = 15.0  # m that an ego must have to drive
_APART = 60.0  # s; vehicles seen further apart in time never meet in an episode


class Made(NamedTuple):
    """World, and what it was made from.

    Attributes:
        world: The world.
        every: Encounters of each recording.
        kept: Tracks of each that count, so that a vehicle in two recordings counts once.
        observed: What the recordings show.
        calibration: The drivers.
        identified: Sites, chains and vehicles of the recordings.
    """

    world: RecordedWorld
    every: list[Encounters]
    kept: list[set[int]]
    observed: Observed
    calibration: Calibration
    identified: Identified


def build(recordings: Sequence[Recording], config: WorldConfig) -> Made:
    """Make a world of recordings, whose drivers are calibrated on all of them.

    Args:
        recordings: With roads; several give several schedules of entries.
        config: Options.

    Raises:
        UserError: If a recording has no road or too few vehicles, or no vehicle meets a conflict.
    """
    for one in recordings:
        _check_rate(one, config)
    identified = identify(recordings)
    every = [_encounters(recording, config) for recording in recordings]
    counted = _kept(every, recordings, identified)
    observed = observe(every, counted)
    calibration = calibrate(observed)
    rows_by_recording = [_Part(encounters, calibration.lateral, config) for encounters in every]
    columns = _joined(rows_by_recording, counted)
    columns["drivers"] = [calibration.drivers.array()]
    arrays = {name: _column(name, values) for name, values in columns.items()}
    if not len(arrays["egos"]):
        raise UserError(
            "no vehicle has a way across a conflict area ahead of it: a world needs a junction "
            "that recorded vehicles drive through"
        )
    speeds = observed.speeds
    fastest = max(calibration.drivers.desired_speed.high, float(np.quantile(speeds, 0.99)))
    provenance = {
        "recordings": [_described(encounters) for encounters in every],
        "sites": sorted(set(identified.site)),
        "calibration": calibration.as_header(),
        "vehicles": len(arrays["identity"]),
        "egos": len(arrays["egos"]),
        "closures": len(arrays["closed"]),
    }
    world = RecordedWorld(Road(**arrays), config, float(fastest), provenance)
    return Made(world, every, counted, observed, calibration, identified)


def _check_rate(recording: Recording, config: WorldConfig) -> None:
    """Refuse a rate of decisions that the recording's frames don't have."""
    name, dt = one_line(recording.tracks.recording, 60), recording.tracks.dt
    frames = 1 / config.policy_rate / dt
    if abs(frames - round(frames)) > 1e-6 or round(frames) < 1:
        raise UserError(
            f"{name} has a frame every {dt:g} s, and a decision needs a whole number of them: "
            f"choose a --policy-rate that divides {1 / dt:g}"
        )


def _encounters(recording: Recording, config: WorldConfig) -> Encounters:
    name = one_line(recording.tracks.recording, 60)
    if not recording.road.lanelets:
        raise UserError(f"{name} has no road: name its map with --road")
    encounters = Encounters(Scene(recording), ConflictConfig(slack=config.slack))
    encounters.ways = {track: way for track, way in encounters.ways.items() if len(way.along) > 1}
    if len(encounters.ways) < LEAST_VEHICLES:
        raise UserError(
            f"{name} has {len(encounters.ways)} vehicles on its lanelets: a world needs "
            f"{LEAST_VEHICLES} or more; is --road the map of this recording?"
        )
    if len(encounters.ways) > MOST_VEHICLES:
        raise UserError(
            f"{name} has {len(encounters.ways):,} vehicles, more than {MOST_VEHICLES:,}: "
            "import it in parts"
        )
    return encounters


def _kept(
    every: Sequence[Encounters], recordings: Sequence[Recording], identified: Identified
) -> list[set[int]]:
    """Return the tracks of each recording that no other recording shows for longer."""
    same = same_moments(identified)
    sizes = {
        (number, track): float(len(way.along))
        for number, encounters in enumerate(every)
        for track, way in encounters.ways.items()
    }
    chosen = once(sizes, lambda key: same.get(key, ()))
    return [{t for p, t in chosen if p == number} for number in range(len(recordings))]


def _described(encounters: Encounters) -> dict[str, Any]:
    tracks = encounters.scene.tracks
    return {
        "recording": tracks.recording,
        "vehicles": len(encounters.ways),
        "seconds": float((int(tracks.frame.max()) - int(tracks.frame.min()) + 1) * tracks.dt),
        "simulated": bool(signs_of_simulation(tracks)),
        "source": tracks.source,
    }


class _Part:
    """Rows of one recording."""

    def __init__(self, encounters: Encounters, lateral: float, config: WorldConfig) -> None:
        self.ways: list[Way] = list(encounters.ways.values())
        self._encounters = encounters
        self.first_frame = int(encounters.scene.tracks.frame.min())
        inferred = config.lights == "inferred"
        closures = closures_of(encounters, self.first_frame) if inferred else []
        self.rows: dict[str, list[Any]] = {name: [] for name in LAYOUT}
        self._pairs(config)
        for number, way in enumerate(self.ways):
            line, states = line_of(way), states_of(way, self.first_frame)
            limits = speed_limits(line, lateral)
            rows = self.rows
            rows["identity"].append(encounters.scene.tracks.identity[way.track])
            rows["length"].append(way.length)
            rows["width"].append(way.width)
            rows["line"].append(np.column_stack([line.x, line.y, line.heading, limits]))
            rows["state_step"].append(states.first)
            rows["state"].append(np.column_stack([states.along, states.speed]))
            rows["closed"].append(np.array(on_way_of(way, closures)).reshape(-1, 3))
            self._route(number, way, len(line.x))

    def _pairs(self, config: WorldConfig) -> None:
        """Add conflict areas and stretches of the ordered pairs that an episode may have.

        A pair may be in an episode if its vehicles are seen at most `_APART` s apart.
        """
        rows, count = self.rows, len(self.ways)
        place_of = {way.track: number for number, way in enumerate(self.ways)}
        area_of, lengths = np.full(count**2, -1), np.zeros(count**2, np.int64)
        for number, ego_way in enumerate(self.ways):
            apart = _APART / ego_way.dt
            for partner in self._encounters.in_time.seen(
                ego_way.first - apart, ego_way.last + apart
            ):
                if ego_way.track == partner.track:
                    continue
                pair = number * count + place_of[partner.track]
                lying = stretches(partner, ego_way, config.slack)
                if lying:
                    rows["stretch"].append(np.array(lying))
                    lengths[pair] = len(lying)
                area = self._encounters.area(ego_way.track, partner.track)
                if area is not None:
                    area_of[pair] = len(rows["area"])
                    rows["area"].append((area.entry[0], area.exit[0], area.entry[1], area.exit[1]))
                    rows["area_yields"].append(yields(self._encounters, ego_way, partner, area))
                    rows["area_merges"].append(int(area.kind == Conflict.MERGING))
        self.area_of, self.stretches = area_of.reshape(count, count), lengths

    def _route(self, place: int, way: Way, points: int) -> None:
        """Add the influence zone, the origin and the arrival of a vehicle as the ego."""
        rows, numbers = self.rows, self.area_of[place]
        areas = [rows["area"][number] for number in numbers[numbers >= 0].tolist()]
        begin = float(way.along[0])
        ahead = [area for area in areas if area[1] > begin]
        end = (points - 2) * SPACING
        first = min((area[0] for area in ahead), default=end)
        last = max((area[1] for area in ahead), default=end)
        arrival = min(last + way.length / 2 + _BEYOND, end)
        rows["zone"].append((first - _APPROACH, last))
        rows["origin"].append(first)
        rows["arrival"].append(arrival)
        rows["egos"].append(bool(ahead) and arrival - begin >= _LEAST_WAY)


def _joined(parts: Sequence[_Part], kept: Sequence[set[int]]) -> dict[str, list[Any]]:
    """Return the rows of all recordings, with the first places of ragged columns."""
    columns: dict[str, list[Any]] = {name: [] for name in LAYOUT}
    firsts = ("recording_first", "pair_first", "line_first", "state_first", "closed_first")
    for name in firsts:
        columns[name].append(0)
    columns["stretch_first"].append(np.zeros(1, np.int64))
    for rows_of, tracks in zip(parts, kept, strict=True):
        vehicles, areas = len(columns["identity"]), len(columns["area"])
        for name in ("line", "state", "closed"):
            for values in rows_of.rows[name]:
                columns[f"{name}_first"].append(columns[f"{name}_first"][-1] + len(values))
                columns[name].append(values)
        columns["stretch"] += rows_of.rows["stretch"]
        stretches_before = columns["stretch_first"][-1][-1]
        columns["stretch_first"].append(stretches_before + np.cumsum(rows_of.stretches))
        for name in ("identity", "length", "width", "arrival", "origin", "zone", "state_step"):
            columns[name] += rows_of.rows[name]
        numbers = rows_of.area_of.ravel()
        columns["area_of"].append(np.where(numbers >= 0, numbers + areas, -1))
        for name in ("area", "area_yields", "area_merges"):
            columns[name] += rows_of.rows[name]
        columns["egos"] += [
            vehicles + number
            for number, way in enumerate(rows_of.ways)
            if rows_of.rows["egos"][number] and way.track in tracks
        ]
        columns["recording_first"].append(len(columns["identity"]))
        columns["pair_first"].append(columns["pair_first"][-1] + len(numbers))
    return columns


def _column(name: str, values: list[Any]) -> np.ndarray:
    dtype, shape = LAYOUT[name]
    if name in ("line", "state", "stretch", "closed", "drivers", "area_of", "stretch_first"):
        return np.concatenate([np.zeros((0, *shape)), *values]).astype(dtype)
    return np.array(values, dtype).reshape(-1, *shape)
