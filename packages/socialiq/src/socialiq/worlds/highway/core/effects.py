"""Kernels of what the ego causes: the episode without it, and what others drive in both worlds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from socialiq.physics import overlap_depth
from socialiq.types import Ending
from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.compile import allocating_kernel, entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH
from socialiq.worlds.highway.core.vehicle import clip
from socialiq.worlds.highway.effects import ACCOUNT, AHEAD, BEGIN, PREPARE, REPEAT, SIGNALS

HARD = -4.0  # m/s², acceleration below which a braking is hard
CLOSE = 2.0  # s between two vehicles at one place, from which an encounter is none
FORESEEN = 3.0  # s before the first of both is there
_LEAST_SPEED = 0.5  # m/s, of who moves towards an encounter
_L, _W = VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2
_REACH = 2 * np.hypot(_L, _W)  # m between centres of vehicles that may touch
_HALVES = (VEHICLE_LENGTH + VEHICLE_WIDTH) / 2  # m of the way on which a crossing place is covered
_ARRIVED, _COLLIDED = int(Ending.ARRIVAL), int(Ending.COLLISION)
_TIMED_OUT, _LEFT = int(Ending.TIMEOUT), int(Ending.OTHER)


@kernel
def predicted_gap(ego, vehicle):
    """Return when the first of two vehicles reaches the crossing of their headings, and the gap.

    Both in s, at constant velocity; the gap is the post-encroachment time of their rectangles, at
    least 0. It is infinite if they don't both come there.
    """
    across = ego.along_x * vehicle.along_y - ego.along_y * vehicle.along_x
    if abs(across) < 0.1 or ego.speed < _LEAST_SPEED or vehicle.speed < _LEAST_SPEED:
        return 0.0, np.inf
    dx, dy = vehicle.x - ego.x, vehicle.y - ego.y
    ahead = (dx * vehicle.along_y - dy * vehicle.along_x) / across  # m to the crossing
    ahead_of_vehicle = (dx * ego.along_y - dy * ego.along_x) / across
    if ahead < -_HALVES or ahead_of_vehicle < -_HALVES:
        return 0.0, np.inf
    entry, leaving = (ahead - _HALVES) / ego.speed, (ahead + _HALVES) / ego.speed
    other_entry = (ahead_of_vehicle - _HALVES) / vehicle.speed
    other_leaving = (ahead_of_vehicle + _HALVES) / vehicle.speed
    gap = max(entry - other_leaving, other_entry - leaving, 0.0)
    return max(min(entry, other_entry), 0.0), gap


@kernel
def encounter(ego, vehicle):
    """Return how close an encounter is predicted, 0 (none) to 1 (both are there now)."""
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
                    begin, stop = max(frame - least + 1, 0), min(frame + least, tracks.shape[2])
                    for instant in range(begin, stop):
                        place = tracks[row, identity, instant]
                        dx, dy = place[0] - ego[0], place[1] - ego[1]
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
    """Write signals of the decisions from one to another, and the reward that they make."""
    signals, weights = ledger.signals[row], effects.weights
    for what in range(2):
        alone, together = 0.0, 0.0
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
    """Choose the later traffic of a decision: its stream and the identity of who arrives."""
    stream.seed(episode, arrivals + np.uint64(number))
    episode.next_identity = effects.first_arrival + number


@allocating_kernel
def copied(buffers, row, most):
    """Return the episode in an array of one, and so many records of vehicles."""
    episodes = np.empty(1, buffers.episodes.dtype)
    vehicles: Any = np.empty(most, buffers.vehicles.dtype)
    episodes[0] = buffers.episodes[row]
    for slot in range(buffers.vehicles.shape[1]):
        vehicles[slot] = buffers.vehicles[row, slot]
    return episodes, vehicles


class _Driving(NamedTuple):
    """Kernels that the measures share."""

    # (vehicle, speed before, the ego's identity, road, settings, totals, hardest)
    add: Callable[..., Any]
    tow: Callable[..., Any]  # (episode, vehicles, wrecked, settings, effects)
    # (episodes, vehicles, the ego's identity, arrivals, number, wrecked, road, settings, effects,
    # totals): advance a world without commands
    drive_on: Callable[..., Any]


def _driving_of(kernels: Any) -> _Driving:
    """Return the kernels that drive a world on and count what others drive."""
    sub_step, renew = kernels.sub_step, kernels.renew
    leaves, remove = kernels.leaves, kernels.remove

    @kernel
    def add(vehicle, speed, ego_identity, road, settings, totals, hardest):
        """Add a sub-step of a vehicle, whose speed was given before it, unless it has left."""
        if vehicle.identity == ego_identity or leaves(vehicle, road):
            return
        totals[vehicle.identity, 0] += abs(vehicle.speed) * settings.dt
        if not vehicle.crashed:
            change = (vehicle.speed - speed) / settings.dt
            hardest[vehicle.identity] = min(hardest[vehicle.identity], change)

    @kernel
    def tow(episode, vehicles, wrecked, settings, effects):
        for slot in range(episode.vehicles - 1, -1, -1):
            identity = vehicles[slot].identity
            if vehicles[slot].crashed and wrecked[identity] < effects.tow_after:
                wrecked[identity] += settings.decision
                if wrecked[identity] >= effects.tow_after:
                    remove(episode, vehicles, slot)

    @allocating_kernel
    def drive_on(
        episodes, vehicles, ego_identity, arrivals, number, wrecked, road, settings, effects, moved
    ):
        """Advance all by the time of a decision; add what others drive to (vehicle, 2) totals.

        The episode is the only one of an array, which keeps its memory.
        """
        episode = episodes[0]
        prepare(episode, arrivals, number, effects)
        episode.time += settings.decision
        count, hardest = episode.vehicles, np.zeros(len(moved))
        speed = np.empty(count)
        for _ in range(settings.frames):
            for slot in range(count):
                speed[slot] = vehicles[slot].speed
            sub_step(episode, vehicles, road, settings)
            for slot in range(count):
                add(vehicles[slot], speed[slot], ego_identity, road, settings, moved, hardest)
        for identity in range(len(moved)):
            moved[identity, 1] += hardest[identity] < HARD
        renew(episode, vehicles, road, settings)
        tow(episode, vehicles, wrecked, settings, effects)

    return _Driving(add, tow, drive_on)


def _begin_of(kernels: Any, driving: _Driving) -> Callable[..., Any]:
    """Return the kernel (buffers, ledger, row, road, settings, effects) that begins an episode."""
    remove, relation = kernels.remove, kernels.relation
    drive_on = driving.drive_on

    @allocating_kernel
    def begin(buffers, ledger, row, road, settings, effects):
        """Drive the world without the ego to the common end."""
        most = ledger.driven.shape[1]
        copies, vehicles = copied(buffers, row, most)
        ego, wrecked = copies[0].controlled[0], np.zeros(most)
        for identity in range(most):
            ledger.relation[row, identity], ledger.wrecked[row, identity] = -1, 0.0
            for what in range(2):
                ledger.without[row, identity, what] = 0.0
                ledger.driven[row, identity, what] = 0.0
        arrivals, ego_identity = copies[0].state_low, vehicles[ego].identity
        ledger.arrivals[row] = arrivals
        remove(copies[0], vehicles, ego)
        for number in range(effects.decisions):
            moved = np.zeros((most, 2))
            for slot in range(copies[0].vehicles):
                if vehicles[slot].identity != ego_identity:
                    kind = relation(vehicles[slot], slot, buffers.vehicles[row, ego], road)
                    ledger.relation[row, vehicles[slot].identity] = kind
            drive_on(
                copies,
                vehicles,
                ego_identity,
                arrivals,
                number,
                wrecked,
                road,
                settings,
                effects,
                moved,
            )
            for what in range(2):
                ledger.alone[row, number, what] = 0.0
                for identity in range(most):
                    ledger.alone[row, number, what] += moved[identity, what]
                    ledger.without[row, identity, what] += moved[identity, what]

    return begin


def _account_of(kernels: Any, driving: _Driving) -> Callable[..., Any]:
    """Return the kernel (buffers, ledger, row, number, road, settings, effects) of a decision."""
    relation, same_origin = kernels.relation, kernels.same_origin
    add, tow, follow_up = driving.add, driving.tow, _follow_up_of(kernels, driving)

    @kernel
    def closest(buffers, row, frames, road):
        """Return the closest encounter of the ego with a vehicle of another origin."""
        count, ego = buffers.present[row, 0], buffers.present[row, 1]
        largest = 0.0
        for slot in range(count):
            if slot == ego or same_origin(buffers.after[row], slot, ego, road):
                continue
            for frame in range(frames):
                places = buffers.trace[row, frame]
                largest = max(largest, encounter(places[ego], places[slot]))
        return largest

    @allocating_kernel
    def account(buffers, ledger, row, number, road, settings, effects):
        """Count a decision, and after the last one what follows it."""
        count, ego = buffers.present[row, 0], buffers.present[row, 1]
        ego_identity, moved = buffers.after[row, ego].identity, np.zeros(ledger.driven[row].shape)
        hardest = np.zeros(len(moved))
        for slot in range(count):
            speed = buffers.before[row, slot].speed
            for frame in range(settings.frames):
                vehicle = buffers.trace[row, frame, slot]
                add(vehicle, speed, ego_identity, road, settings, moved, hardest)
                speed = vehicle.speed
        for identity in range(len(moved)):
            moved[identity, 1] += hardest[identity] < HARD
        episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
        tow(episode, vehicles, ledger.wrecked[row], settings, effects)
        last = number + 1
        if buffers.ending[row] != 0:
            follow_up(buffers, ledger, row, number, ego_identity, road, settings, effects, moved)
            last = effects.decisions
        encountered = closest(buffers, row, settings.frames, road)
        write(buffers, ledger, row, (number, last), moved, encountered, effects)
        for slot in range(count):
            identity = buffers.after[row, slot].identity
            if identity != ego_identity and ledger.relation[row, identity] < 0:
                kind = relation(buffers.after[row, slot], slot, buffers.after[row, ego], road)
                ledger.relation[row, identity] = kind

    return account


def _follow_up_of(kernels: Any, driving: _Driving) -> Callable[..., Any]:
    """Return the kernel of what follows the ego's end; the last argument is (vehicle, 2) totals."""
    release, remove = kernels.release, kernels.remove
    drive_on = driving.drive_on

    @allocating_kernel
    def follow_up(buffers, ledger, row, number, ego_identity, road, settings, effects, moved):
        """Drive on after the ego's end to the common end."""
        ending, most = buffers.ending[row], len(moved)
        copies, vehicles = copied(buffers, row, most)
        if ending == _LEFT:
            vehicles[copies[0].controlled[0]].crashed = True
        elif ending == _TIMED_OUT and effects.released:
            release(copies[0], vehicles, road, settings)
        elif ending in (_ARRIVED, _TIMED_OUT):
            remove(copies[0], vehicles, copies[0].controlled[0])
        arrivals, wrecked = ledger.arrivals[row], ledger.wrecked[row].copy()
        for later in range(number + 1, effects.decisions):
            drive_on(
                copies,
                vehicles,
                ego_identity,
                arrivals,
                later,
                wrecked,
                road,
                settings,
                effects,
                moved,
            )

    return follow_up


def _look_ahead_of(kernels: Any, driving: _Driving) -> Callable[..., Any]:
    """Return the kernel (buffers, ledger, row, number, action, road, settings, effects)."""
    choose, remove = kernels.choose, kernels.remove
    drive_on = driving.drive_on

    @allocating_kernel
    def look_ahead(buffers, ledger, row, number, action, road, settings, effects):
        """Write what others do in the next decisions if the ego repeats an action.

        Without it below 0, in the next decision alone if below -1.
        """
        most = ledger.driven.shape[1]
        copies, vehicles = copied(buffers, row, most)
        ego_identity, moved = vehicles[copies[0].controlled[0]].identity, np.zeros((most, 2))
        wrecked, arrivals = ledger.wrecked[row].copy(), ledger.arrivals[row]
        if action < 0:
            remove(copies[0], vehicles, copies[0].controlled[0])
        for identity in range(most):
            ledger.ahead[row, identity, 0], ledger.ahead[row, identity, 1] = np.nan, np.nan
        for later in range(AHEAD if action >= -1 else 1):
            if action >= 0:
                choose(vehicles[copies[0].controlled[0]], action, road, settings)
            drive_on(
                copies,
                vehicles,
                ego_identity,
                arrivals,
                number + later,
                wrecked,
                road,
                settings,
                effects,
                moved,
            )
            for slot in range(copies[0].vehicles):
                identity = vehicles[slot].identity
                if later == 0 and identity != ego_identity:
                    ledger.ahead[row, identity, 0] = vehicles[slot].speed
        for identity in range(most):
            if not np.isnan(ledger.ahead[row, identity, 0]):
                ledger.ahead[row, identity, 1] = moved[identity, 0]

    return look_ahead


def effects_of(kernels: Any) -> Callable[..., Any]:
    """Return the kernel (command, buffers, ledger, row, road, settings, effects) of a road.

    Later traffic is drawn for each decision from a stream of its own, by the episode, so that both
    worlds and all copies of a state meet the same arrivals. Ledger and record are those of
    `highway.effects`.
    """
    driving = _driving_of(kernels)
    begin = _begin_of(kernels, driving)
    account, look_ahead = _account_of(kernels, driving), _look_ahead_of(kernels, driving)

    @kernel
    def run(command, buffers, ledger, row, road, settings, effects):
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

    return run
