"""Kernels of what the ego causes: the episode without it, and what others drive in both worlds."""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.physics import overlap_depth
from socialiq.types import Ending
from socialiq.worlds.highway.core import drivers, stream, traffic
from socialiq.worlds.highway.core.compile import allocating_kernel, entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH
from socialiq.worlds.highway.core.vehicle import clip
from socialiq.worlds.highway.effects import ACCOUNT, AHEAD, BEGIN, PREPARE, REPEAT, SIGNALS
from socialiq.worlds.road_users import INFLUENCE

HARD = -4.0  # m/s², acceleration below which a braking is hard
CLOSE = 2.0  # s between two vehicles at one place, from which an encounter is none
FORESEEN = 3.0  # s before the first of both is there
_LEAST_SPEED = 0.5  # m/s, of who moves towards an encounter
_L = VEHICLE_LENGTH / 2
_W = VEHICLE_WIDTH / 2
_REACH = 2 * np.hypot(_L, _W)  # m between centres of vehicles that may touch
_HALVES = (VEHICLE_LENGTH + VEHICLE_WIDTH) / 2  # m of the way on which a crossing place is covered
_ARRIVED = int(Ending.ARRIVAL)
_COLLIDED = int(Ending.COLLISION)
_TIMED_OUT = int(Ending.TIMEOUT)
_LEFT = int(Ending.OTHER)


@kernel
def predicted_gap(ego, vehicle):
    """Return when the first of two vehicles reaches the crossing of their headings, and the gap.

    Args:
        ego: Record of one vehicle.
        vehicle: Record of another vehicle.

    Returns:
        Both times in s, at constant velocity. The gap is the post-encroachment time of their
        rectangles, at least 0; it is infinite if they don't both come to the crossing.
    """
    across = ego.along_x * vehicle.along_y - ego.along_y * vehicle.along_x
    if abs(across) < 0.1 or ego.speed < _LEAST_SPEED or vehicle.speed < _LEAST_SPEED:
        return 0.0, np.inf
    dx = vehicle.x - ego.x
    dy = vehicle.y - ego.y
    ahead = (dx * vehicle.along_y - dy * vehicle.along_x) / across  # m to the crossing
    ahead_of_vehicle = (dx * ego.along_y - dy * ego.along_x) / across
    if ahead < -_HALVES or ahead_of_vehicle < -_HALVES:
        return 0.0, np.inf
    entry = (ahead - _HALVES) / ego.speed
    leaving = (ahead + _HALVES) / ego.speed
    other_entry = (ahead_of_vehicle - _HALVES) / vehicle.speed
    other_leaving = (ahead_of_vehicle + _HALVES) / vehicle.speed
    gap = max(entry - other_leaving, other_entry - leaving, 0.0)
    return max(min(entry, other_entry), 0.0), gap


@kernel
def encounter(ego, vehicle):
    """Return how close an encounter is predicted, from 0 (none) to 1 (both are at one place now).

    Args:
        ego: Record of one vehicle.
        vehicle: Record of another vehicle.
    """
    begin, gap = predicted_gap(ego, vehicle)
    return clip(1.0 - gap / CLOSE, 0.0, 1.0) * clip(1.0 - begin / FORESEEN, 0.0, 1.0)


def _encroachment_entry(sources: int):
    @entry_point
    def run(tracks, egos, relation, window, gaps, first, end):
        for row in range(first, end):
            least = window + 1
            for identity in range(tracks.shape[1]):
                if identity == egos[row] or relation[row, identity] <= 0:
                    continue
                for frame in range(tracks.shape[2]):
                    ego = tracks[row, egos[row], frame]
                    if np.isnan(ego[0]):
                        continue
                    begin = max(frame - least + 1, 0)
                    stop = min(frame + least, tracks.shape[2])
                    for instant in range(begin, stop):
                        place = tracks[row, identity, instant]
                        dx = place[0] - ego[0]
                        dy = place[1] - ego[1]
                        if not dx * dx + dy * dy < _REACH * _REACH:
                            continue
                        depth = overlap_depth(dx, dy, ego[2], place[2], _L, _W, _L, _W)
                        if depth > 0:
                            least = min(least, abs(frame - instant))
            gaps[row] = least
        return sources

    return run


encroachment: Any = _encroachment_entry(fingerprint())
"""Write the post-encroachment time of each ego to vehicles from other approaches, in frames.

Args:
    tracks: x, y and heading by identity and frame, NaN for none, (row, vehicle, frame, 3).
    egos: Identity of each ego.
    relation: Place of each vehicle in `RELATIONS`.
    window: Largest number of frames; a larger gap is written as `window` + 1.
    gaps: Frames between the first's last and the second's first presence at one place, (row,).
    first: First row of the part to do, up to `end`.
"""


@kernel
def write(buffers, ledger, row, instants, moved, encountered, effects):
    """Write the signals of some decisions, and the reward that they make.

    Args:
        buffers: Arrays of the batch; r_social of the row is written.
        ledger: `Ledger` of the batch; `signals` and `driven` of the row are written.
        row: Row of the episode.
        instants: Number of the first of these decisions, and of the one after the last.
        moved: Metres and hard brakings of each vehicle with the ego in these decisions, (vehicle,
            2).
        encountered: Closest encounter, 0 to 1.
        effects: EFFECTS record.
    """
    signals = ledger.signals[row]
    weights = effects.weights
    for what in range(2):
        alone = 0.0
        together = 0.0
        for instant in range(instants[0], instants[1]):
            alone += ledger.alone[row, instant, what]
        for identity in range(len(moved)):
            together += moved[identity, what]
            ledger.driven[row, identity, what] += moved[identity, what]
        signals[what] = alone - together if what == 0 else together - alone
    signals[2] = encountered
    reward = 0.0
    for signal in range(len(SIGNALS)):
        reward += weights[signal] * signals[signal]
    if buffers.ending[row] == _COLLIDED:
        reward += weights[len(SIGNALS)]
    buffers.rewards[row, 1] = reward


@kernel
def prepare(episode, arrivals, number, effects):
    """Choose the later traffic of a decision: its stream, and the identity of the next arrival.

    Args:
        episode: EPISODE record, which is written.
        arrivals: Seed of the episode's later traffic, uint64.
        number: Number of the decision.
        effects: EFFECTS record.
    """
    stream.seed(episode, arrivals + np.uint64(number))
    episode.next_identity = effects.first_arrival + number


@kernel
def _ego_of(buffers, row):
    return buffers.vehicles[row, buffers.episodes[row].controlled[0]]


@allocating_kernel
def copied(buffers, ledger, row, ego):
    """Return a copy of an episode that can drive on.

    Args:
        buffers: Arrays of the batch.
        ledger: `Ledger` of the batch.
        row: Row of the episode.
        ego: Identity of the ego.

    Returns:
        The EPISODE record in an array of one, which keeps its memory; the records of vehicles, as
        many as the ledger has, and of people; the seconds since the crash of each wreck, by
        identity; and the ego's identity.
    """
    episodes = np.empty(1, buffers.episodes.dtype)
    vehicles: Any = np.empty(ledger.driven.shape[1], buffers.vehicles.dtype)
    episodes[0] = buffers.episodes[row]
    for slot in range(buffers.vehicles.shape[1]):
        vehicles[slot] = buffers.vehicles[row, slot]
    return episodes, vehicles, buffers.people[row].copy(), ledger.wrecked[row].copy(), ego


def commands(prepare, relate, take_out, act, drive_on, listed, account):
    """Return the kernel that carries out the commands of `highway.effects` on a kind of road.

    Its arguments are a command, the arrays of the batch, its `Ledger`, the row of an episode, the
    road, a SETTINGS and an EFFECTS record. Arguments of the kernels are those of `_drive_on`.

    Args:
        prepare: Kernel that chooses the later traffic before a decision.
        relate: Kernel that notes the relations of the vehicles in a copy to the ego.
        take_out: Kernel that removes the ego from a copy.
        act: Kernel that lets the ego of a copy choose an action.
        drive_on: Kernel that advances a copy by a decision.
        listed: Kernel of the vehicles of a copy and a place in the list of those on the road; it
            returns the vehicle's record.
        account: Kernel that counts a decision, and after the last one what follows it.
    """

    @allocating_kernel
    def begin(buffers, ledger, row, road, settings, effects):
        """Drive the world without the ego to the common end."""
        most = ledger.driven.shape[1]
        for identity in range(most):
            ledger.relation[row, identity] = -1
            ledger.wrecked[row, identity] = 0.0
            for what in range(2):
                ledger.without[row, identity, what] = 0.0
                ledger.driven[row, identity, what] = 0.0
        ledger.arrivals[row] = buffers.episodes[row].state_low
        state = copied(buffers, ledger, row, _ego_of(buffers, row).identity)
        take_out(state, road)
        for number in range(effects.decisions):
            moved = np.zeros((most, 2))
            relate(buffers, state, ledger, row, road)
            drive_on(state, ledger, row, number, road, settings, effects, moved)
            for what in range(2):
                ledger.alone[row, number, what] = 0.0
                for identity in range(most):
                    ledger.alone[row, number, what] += moved[identity, what]
                    ledger.without[row, identity, what] += moved[identity, what]

    @allocating_kernel
    def look_ahead(buffers, ledger, row, number, action, road, settings, effects):
        """Write what others do in the next decisions.

        The ego repeats an action; -1: without the ego; -2: the same, one decision only.
        """
        state = copied(buffers, ledger, row, _ego_of(buffers, row).identity)
        episodes, vehicles, _, _, ego = state
        moved = np.zeros((len(vehicles), 2))
        if action < 0:
            take_out(state, road)
        for identity in range(len(moved)):
            ledger.ahead[row, identity, 0] = np.nan
            ledger.ahead[row, identity, 1] = np.nan
        for later in range(AHEAD if action >= -1 else 1):
            if action >= 0:
                act(state, action, road, settings)
            drive_on(state, ledger, row, number + later, road, settings, effects, moved)
            for slot in range(episodes[0].vehicles):
                vehicle = listed(vehicles, slot)
                if later == 0 and vehicle.identity != ego:
                    ledger.ahead[row, vehicle.identity, 0] = vehicle.speed
        for identity in range(len(moved)):
            if not np.isnan(ledger.ahead[row, identity, 0]):
                ledger.ahead[row, identity, 1] = moved[identity, 0]

    @kernel
    def carry_out(command, buffers, ledger, row, road, settings, effects):
        number = int(np.rint(buffers.episodes[row].time / settings.decision))
        if command == BEGIN:
            begin(buffers, ledger, row, road, settings, effects)
        elif command == PREPARE:
            prepare(buffers.episodes[row], ledger.arrivals[row], number, effects)
        elif command == ACCOUNT:
            account(buffers, ledger, row, number - 1, road, settings, effects)
        else:
            action = command - REPEAT  # below 0 without the ego
            look_ahead(buffers, ledger, row, number, action, road, settings, effects)

    return carry_out


@kernel
def _add(vehicle, speed, ego_identity, lane, renews, settings, totals, hardest):
    """Add a sub-step of a vehicle, whose speed was given before it, unless it has left."""
    if vehicle.identity == ego_identity or traffic.leaves(vehicle, lane, renews):
        return
    totals[vehicle.identity, 0] += abs(vehicle.speed) * settings.dt
    if not vehicle.crashed:
        change = (vehicle.speed - speed) / settings.dt
        hardest[vehicle.identity] = min(hardest[vehicle.identity], change)


@kernel
def _tow(episode, vehicles, wrecked, road, settings, effects):
    """Remove wrecks whose time is over."""
    for slot in range(episode.vehicles - 1, -1, -1):
        identity = vehicles[slot].identity
        if vehicles[slot].crashed and wrecked[identity] < effects.tow_after:
            wrecked[identity] += settings.decision
            if wrecked[identity] >= effects.tow_after:
                traffic.remove(episode, vehicles, slot, road)


@allocating_kernel
def _drive_on(state, ledger, row, number, road, settings, effects, moved):
    """Advance all by the time of a decision; add what others drive to (vehicle, 2) totals.

    Args:
        state: Copy of the episode, as of `copied`.
        ledger: `Ledger` of the batch.
        row: Row of the episode.
        number: Number of the decision.
        road: Tables of the road.
        settings: SETTINGS record.
        effects: EFFECTS record.
        moved: Metres and hard brakings of each vehicle except the ego, to which is added.
    """
    episodes, vehicles, people, wrecked, ego = state
    episode = episodes[0]
    prepare(episode, ledger.arrivals[row], number, effects)
    episode.time += settings.decision
    count = episode.vehicles
    renews = len(road.arrivals) > 0
    hardest = np.zeros(len(moved))
    speed = np.empty(count)
    influences = np.empty((settings.agents, len(people)), INFLUENCE)  # which are not read
    for _ in range(settings.frames):
        for slot in range(count):
            speed[slot] = vehicles[slot].speed
        traffic.sub_step(episode, vehicles, people, influences, road, settings)
        for slot in range(count):
            vehicle = vehicles[slot]
            lane = road.lanes[vehicle.lane]
            _add(vehicle, speed[slot], ego, lane, renews, settings, moved, hardest)
    for identity in range(len(moved)):
        moved[identity, 1] += hardest[identity] < HARD
    traffic.renew(episode, vehicles, road, settings)
    _tow(episode, vehicles, wrecked, road, settings, effects)


@kernel
def relation_of(vehicle, ego):
    """Return the place of a vehicle in `effects.RELATIONS`, by its way and the ego's.

    Args:
        vehicle: Record of the vehicle.
        ego: Record of the ego.
    """
    if vehicle.origin == ego.origin:
        return 0
    planned = vehicle.route >= 0 and ego.route >= 0
    return 1 if planned and vehicle.destination == ego.destination else 2


@kernel
def _relate(buffers, state, ledger, row, road):  # noqa: ARG001  the road of other kinds is read
    """Note the relations of the vehicles in a copy to the ego."""
    ego = _ego_of(buffers, row)
    for slot in range(state[0][0].vehicles):
        vehicle = state[1][slot]
        if vehicle.identity != ego.identity:
            ledger.relation[row, vehicle.identity] = relation_of(vehicle, ego)


@kernel
def _take_out(state, road):
    traffic.remove(state[0][0], state[1], state[0][0].controlled[0], road)


@kernel
def _act(state, action, road, settings):
    drivers.choose(state[1][state[0][0].controlled[0]], action, road, settings)


@kernel
def _listed(vehicles, slot):
    return vehicles[slot]


@kernel
def _closest(buffers, row, frames):
    """Return the closest encounter of the ego with a vehicle of another origin.

    Returns:
        As `encounter`, from 0 to 1; the largest over vehicles and frames of the decision.
    """
    count = buffers.present[row, 0]
    ego = buffers.present[row, 1]
    largest = 0.0
    for slot in range(count):
        if slot == ego or buffers.after[row, slot].origin == buffers.after[row, ego].origin:
            continue
        for frame in range(frames):
            places = buffers.trace[row, frame]
            largest = max(largest, encounter(places[ego], places[slot]))
    return largest


@allocating_kernel
def _follow_up(buffers, ledger, row, number, ego, road, settings, effects, moved):
    """Drive on after the end of an ego, by its identity, to the common end; see `_drive_on`."""
    ending = buffers.ending[row]
    state = copied(buffers, ledger, row, ego)
    episode = state[0][0]
    vehicles = state[1]
    if ending == _LEFT:
        vehicles[episode.controlled[0]].crashed = True
    elif ending == _TIMED_OUT and effects.released:
        traffic.release(episode, vehicles, road, settings)
    elif ending in (_ARRIVED, _TIMED_OUT):
        _take_out(state, road)
    for later in range(number + 1, effects.decisions):
        _drive_on(state, ledger, row, later, road, settings, effects, moved)


@allocating_kernel
def _account(buffers, ledger, row, number, road, settings, effects):
    """Count a decision, and after the last one what follows it."""
    count = buffers.present[row, 0]
    ego = buffers.present[row, 1]
    ego_identity = buffers.after[row, ego].identity
    moved = np.zeros(ledger.driven[row].shape)
    hardest = np.zeros(len(moved))
    renews = len(road.arrivals) > 0
    for slot in range(count):
        speed = buffers.before[row, slot].speed
        for frame in range(settings.frames):
            vehicle = buffers.trace[row, frame, slot]
            lane = road.lanes[vehicle.lane]
            _add(vehicle, speed, ego_identity, lane, renews, settings, moved, hardest)
            speed = vehicle.speed
    for identity in range(len(moved)):
        moved[identity, 1] += hardest[identity] < HARD
    episode = buffers.episodes[row]
    vehicles = buffers.vehicles[row]
    _tow(episode, vehicles, ledger.wrecked[row], road, settings, effects)
    last = number + 1
    if buffers.ending[row] != 0:
        _follow_up(buffers, ledger, row, number, ego_identity, road, settings, effects, moved)
        last = effects.decisions
    encountered = _closest(buffers, row, settings.frames)
    write(buffers, ledger, row, (number, last), moved, encountered, effects)
    for slot in range(count):
        identity = buffers.after[row, slot].identity
        if identity != ego_identity and ledger.relation[row, identity] < 0:
            kind = relation_of(buffers.after[row, slot], buffers.after[row, ego])
            ledger.relation[row, identity] = kind


carry_out = commands(prepare, _relate, _take_out, _act, _drive_on, _listed, _account)
"""Carry out a command of `highway.effects`; see `commands`.

Later traffic is drawn for each decision from a separate stream, by the episode, so that both worlds
and all copies of a state meet the same arrivals.
"""
