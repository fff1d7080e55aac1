"""Construction of a world from recordings."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq_recordings.conflicts.encounters import Area, ConflictConfig, Encounters
from socialiq_recordings.conflicts.measures import sign, turn
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.identity.identify import Identified, identify, once, same_moments
from socialiq_recordings.recording import PEOPLE, Recording
from socialiq_recordings.road.network import Conflict
from socialiq_recordings.road.routes import Scene
from socialiq_recordings.signs_of_simulation import signs_of_simulation
from socialiq_recordings.world import lines
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.drivers import Calibration, Observed, calibrate, observe
from socialiq_recordings.world.recorded_world import LAYOUT, RecordedWorld, Road

LEAST_VEHICLES = 2
MOST_VEHICLES = 2000  # vehicles of one recording; 16 bytes are kept for each two of them
_APPROACH = 20.0  # m before the first conflict area: the influence zone, as at the intersection
_BEYOND = 10.0  # m behind the last conflict area at which the ego has arrived
_LEAST_WAY = 15.0  # m that an ego must have to drive
_APART = 60.0  # s; vehicles seen further apart in time never meet in an episode


class Made(NamedTuple):
    """World, and what it was made from."""

    world: RecordedWorld  # the world
    every: list[Encounters]  # encounters of each recording
    # tracks of each that count, so that a vehicle in two recordings counts once
    kept: list[set[int]]
    observed: Observed  # what the recordings show
    calibration: Calibration  # the drivers
    identified: Identified  # sites, chains and vehicles of the recordings


def build(recordings: Sequence[Recording], config: WorldConfig) -> Made:
    """Make a world of recordings with roads, whose drivers are calibrated on all of them.

    Several recordings give several schedules of entries.

    Raises:
        UserError: If a recording has no road or too few vehicles, or no vehicle meets a conflict.
    """
    every = [_encounters(recording, config) for recording in recordings]
    identified = identify(recordings)
    sizes = {
        (number, track): float(len(way.along))
        for number, encounters in enumerate(every)
        for track, way in encounters.ways.items()
    }
    same = same_moments(identified)
    longest = once(sizes, lambda key: same.get(key, ()))
    counted = [{t for p, t in longest if p == number} for number in range(len(recordings))]
    observed = observe(every, counted)
    calibration = calibrate(observed)
    arrays = _arrays(every, counted, calibration, config)
    if not len(arrays["egos"]):
        raise UserError(
            "no vehicle has a way across a conflict area ahead of it: a world needs a junction "
            "that recorded vehicles drive through"
        )
    fastest = float(np.quantile(observed.speeds, 0.99))
    described = []
    for encounters in every:
        tracks = encounters.scene.tracks
        frames = int(tracks.frame.max()) - int(tracks.frame.min()) + 1
        source: dict[str, Any] = {
            "recording": tracks.recording,
            "vehicles": len(encounters.ways),
            "seconds": float(frames * tracks.dt),
            "simulated": bool(signs_of_simulation(tracks)),
            "source": tracks.source,
        }
        described.append(source)
    errors = {"rms": calibration.rms, "rms_constant": calibration.rms_constant}
    header = {"lateral": calibration.lateral, "evidence": calibration.evidence}
    header |= {name: None if np.isnan(v) else v for name, v in errors.items()}
    provenance: dict[str, Any] = {
        "recordings": described,
        "sites": sorted(set(identified.site)),
        "calibration": header,
        "vehicles": len(arrays["identity"]),
        "egos": len(arrays["egos"]),
        "closures": len(arrays["closed"]),
    }
    max_speed = max(calibration.drivers.desired_speed.high, fastest)
    world = RecordedWorld(Road(**arrays), config, float(max_speed), provenance)
    return Made(world, every, counted, observed, calibration, identified)


def _encounters(recording: Recording, config: WorldConfig) -> Encounters:
    """Return the encounters of a recording that has a road, and frames at all decisions."""
    name = one_line(recording.tracks.recording, 60)
    dt = recording.tracks.dt
    frames = 1 / config.policy_rate / dt
    if abs(frames - round(frames)) > 1e-6 or round(frames) < 1:
        raise UserError(
            f"{name} has a frame every {dt:g} s, and a decision needs a whole number of them: "
            f"choose a --policy-rate that divides {1 / dt:g}"
        )
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


def _arrays(
    every: Sequence[Encounters],
    counted: Sequence[set[int]],
    calibration: Calibration,
    config: WorldConfig,
) -> dict[str, np.ndarray]:
    """Return the arrays of a world; columns of `*_first` are sums of the counts before."""
    columns: dict[str, list[Any]] = {name: [] for name in LAYOUT}
    columns["drivers"].append(np.array(calibration.drivers))
    for encounters, tracks in zip(every, counted, strict=True):
        _append(columns, encounters, tracks, calibration.lateral, config)
    for name in ("line", "state", "closed", "person_state"):
        columns[f"{name}_first"] = [len(rows) for rows in columns[name]]
    arrays = {}
    for name, values in columns.items():
        dtype, shape = LAYOUT[name]
        if name in _PARTS:
            array = np.concatenate([np.zeros((0, *shape)), *values]).astype(dtype)
        else:
            array = np.array(values, dtype).reshape(-1, *shape)
        arrays[name] = np.append(0, array.cumsum()) if name.endswith("_first") else array
    return arrays


_PARTS = ("line", "state", "stretch", "closed", "drivers", "area_of", "stretch_first")
_PARTS += ("person_class", "person_size", "person_state")


def _append(
    columns: dict[str, list[Any]],
    encounters: Encounters,
    tracks: set[int],
    lateral: float,
    config: WorldConfig,
) -> None:
    """Append the vehicles and pairs of a recording; only `tracks` can be egos."""
    ways = list(encounters.ways.values())
    first_frame = int(encounters.scene.tracks.frame.min())
    closures = lines.closures_of(encounters, first_frame) if config.lights == "inferred" else []
    number_of = {way.track: number for number, way in enumerate(ways)}
    area_of = np.full((len(ways), len(ways)), -1)
    lengths = np.zeros((len(ways), len(ways)), np.int64)
    for number, way in enumerate(ways):
        apart = _APART / way.dt
        for partner in encounters.in_time.between(way.first - apart, way.last + apart):
            if way.track == partner.track:
                continue
            pair = number, number_of[partner.track]
            lying = lines.stretches(partner, way, config.slack)
            if len(lying):
                columns["stretch"].append(lying)
                lengths[pair] = len(lying)
            area = encounters.area(way.track, partner.track)
            if area is not None:
                area_of[pair] = len(columns["area"])
                columns["area"].append((area.entry[0], area.exit[0], area.entry[1], area.exit[1]))
                columns["area_yields"].append(_yields(encounters, way, partner, area))
                columns["area_merges"].append(int(area.kind == Conflict.MERGING))
        line = lines.line_of(way)
        step, states = lines.states_of(way, first_frame)
        met = lines.on_way_of(way, closures)
        areas = [columns["area"][area] for area in area_of[number].tolist() if area >= 0]
        ahead = [area for area in areas if area[1] > way.along[0]]
        end = (len(line) - 2) * lines.SPACING
        first = min((area[0] for area in ahead), default=end)
        last = max((area[1] for area in ahead), default=end)
        arrival = min(last + way.length / 2 + _BEYOND, end)
        if ahead and arrival - way.along[0] >= _LEAST_WAY and way.track in tracks:
            columns["egos"].append(len(columns["identity"]))
        columns["identity"].append(encounters.scene.tracks.identity[way.track])
        columns["length"].append(way.length)
        columns["width"].append(way.width)
        columns["line"].append(np.column_stack([line, lines.speed_limits(line, lateral)]))
        columns["state_step"].append(step)
        columns["state"].append(states)
        columns["closed"].append(np.array(met).reshape(-1, 3))
        columns["zone"].append((first - _APPROACH, last))
        columns["origin"].append(first)
        columns["arrival"].append(arrival)
    columns["area_of"].append(area_of.ravel())
    columns["stretch_first"].append(lengths.ravel())
    _append_people(columns, encounters.scene, first_frame)
    columns["recording_first"].append(len(ways))
    columns["pair_first"].append(len(ways) ** 2)


def _append_people(columns: dict[str, list[Any]], scene: Scene, first_frame: int) -> None:
    """Append the pedestrians and cyclists of a recording."""
    tracks = scene.tracks
    people = np.flatnonzero(np.isin(tracks.road_user, PEOPLE)).tolist()
    for rows in map(scene.rows, people):
        times = (tracks.frame[rows] - first_frame) * tracks.dt
        heading = np.unwrap(tracks.heading[rows])
        speed = np.hypot(tracks.vx[rows], tracks.vy[rows])
        states = tracks.x[rows], tracks.y[rows], heading, speed
        step, at = lines.sub_steps_of(times)
        columns["person_step"].append(step)
        columns["person_state"].append(np.column_stack([np.interp(at, times, s) for s in states]))
    columns["person_class"].append(tracks.road_user[people])
    columns["person_size"].append(np.column_stack([tracks.length[people], tracks.width[people]]))
    columns["person_first"].append(len(people))


_MINOR = ("yield", "stop")
_MAJOR = ("priority", "none", "light")
_LEFT = 45.0  # degrees
_STRAIGHT = 30.0  # degrees


def _yields(encounters: Encounters, way: Way, partner: Way, area: Area) -> int:
    """Return 1 if the first vehicle yields by signs or turns, -1 if the second does, 0 if neither.

    With 0 the vehicle that comes second yields.
    """
    signs = sign(encounters, way, partner), sign(encounters, partner, way)
    if signs[0] in _MINOR and signs[1] in _MAJOR:
        return 1
    if signs[1] in _MINOR and signs[0] in _MAJOR:
        return -1
    if area.kind == Conflict.CROSSING:
        turns = turn(way, area.entry[0], area.exit[0]), turn(partner, area.entry[1], area.exit[1])
        left = turns[0] > _LEFT, turns[1] > _LEFT
        if left[0] != left[1] and min(abs(turn) for turn in turns) < _STRAIGHT:
            return 1 if left[0] else -1
    return 0
