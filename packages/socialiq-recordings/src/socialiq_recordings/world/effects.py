"""Commands of what the ego causes at a recorded junction (`highway.effects`), compiled.

Later vehicles enter where and when they were recorded, and drivers make no draws after they
entered: both worlds have the same traffic. A vehicle's metres end with its recorded way. The
commands drive the traffic of a batch on, which `batch.JunctionBatch.measure` puts back.
"""

from __future__ import annotations

import collections
import math
from typing import Any

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core.compile import (
    allocating_entry_point,
    allocating_kernel,
    fingerprint,
    kernel,
)
from socialiq.worlds.highway.core.effects import HARD, encounter, write
from socialiq.worlds.highway.effects import ACCOUNT, AHEAD, BEGIN, PREPARE, RELATIONS, REPEAT
from socialiq_recordings.world.core import snapshot, sub_step
from socialiq_recordings.world.geometry import place_of
from socialiq_recordings.world.observation import overlap
from socialiq_recordings.world.traffic import DT, GONE, PRESENT

_ARRIVED = int(Ending.ARRIVAL)
_COLLIDED = int(Ending.COLLISION)
_SAME_APPROACH, _SAME_EXIT, _CROSSING = range(len(RELATIONS))

_Mover = collections.namedtuple("_Mover", "x y along_x along_y speed")

_Place = collections.namedtuple("_Place", "row recording base count ego")
"""Row of an episode, its recording, first vehicle, number of vehicles, and its ego."""


@kernel
def _remove(traffic, row, vehicle):
    traffic.status[row, vehicle] = GONE
    remaining = 0
    for slot in range(traffic.n_present[row]):
        if traffic.present[row, slot] != vehicle:
            traffic.present[row, remaining] = traffic.present[row, slot]
            remaining += 1
    traffic.n_present[row] = remaining


@kernel
def _mover(road, vehicle, state):
    x, y, heading = place_of(road.line_first, road.line, vehicle, state.along)
    return _Mover(x, y, math.cos(heading), math.sin(heading), state.speed)


@kernel
def _struck(road, traffic, at, slack):
    """Return the vehicle that the ego overlaps; the ego if it overlaps none, but a person."""
    for slot in range(traffic.n_present[at.row]):
        vehicle = traffic.present[at.row, slot]
        along = traffic.along[at.row, at.ego]
        there = traffic.along[at.row, vehicle]
        if vehicle == at.ego:
            continue
        if overlap(road, at.base + at.ego, along, at.base + vehicle, there, slack)[0]:
            return vehicle
    return at.ego


@kernel
def _relation(road, pair, back):
    area = road.area_of[pair]
    if area >= 0:
        return _SAME_EXIT if road.area_merges[area] else _CROSSING
    for way in (pair, back):
        if road.stretch_first[way] < road.stretch_first[way + 1]:
            return _SAME_APPROACH
    return _CROSSING


@kernel
def _note(times, vehicle, column, step):
    """Write that a vehicle is in an area at a sub-step."""
    if times[vehicle, column] < 0:
        times[vehicle, column] = step
    times[vehicle, column + 1] = step


@kernel
def _look(road, at, vehicles, step, driving, times):
    """Note the vehicles in an area with the ego's way; return the closest predicted encounter."""
    closest = 0.0
    pairs = road.pair_first[at.recording] + at.ego * at.count
    along = vehicles[at.ego].along
    half = 0.5 * road.length[at.base + at.ego]
    for vehicle in range(at.count):
        area = road.area_of[pairs + vehicle]
        if vehicle == at.ego or area < 0:
            continue
        if driving and road.area[area, 0] - half < along < road.area[area, 1] + half:
            _note(times, vehicle, 0, step)
        state = vehicles[vehicle]
        side = 0.5 * road.length[at.base + vehicle]
        if state.status != PRESENT:
            continue
        if road.area[area, 2] - side < state.along < road.area[area, 3] + side:
            _note(times, vehicle, 2, step)
        if driving:
            ego = _mover(road, at.base + at.ego, vehicles[at.ego])
            closest = max(closest, encounter(ego, _mover(road, at.base + vehicle, state)))
    return closest


@allocating_kernel
def _advance(junction, at, level, settings):
    road = junction[0]
    traffic = junction[1]
    sub_step(road, traffic, at.row, at.base, at.count, level, settings.max_speed)


@kernel
def _brake(vehicles, at, ends, speed, hardest, moved):
    """Compare speeds with those before a sub-step; count hard brakings if it ends a decision."""
    for vehicle in range(at.count):
        change = (vehicles[vehicle].speed - speed[vehicle]) / DT
        speed[vehicle] = vehicles[vehicle].speed
        if vehicle != at.ego and not math.isnan(change):
            hardest[vehicle] = min(hardest[vehicle], change)
        if ends:
            moved[vehicle, 1] += hardest[vehicle] < HARD
            hardest[vehicle] = 0.0


@allocating_kernel
def _drive(junction, results, at, level, settings, moved):
    """Advance by a decision; add what others drive to (vehicle, 2) totals."""
    vehicles = results.vehicles[at.row]
    hardest = np.zeros(at.count)
    speed = np.empty(at.count)
    snapshot(junction[0], junction[1], at.row, at.base, at.count, vehicles)
    for vehicle in range(at.count):
        speed[vehicle] = vehicles[vehicle].speed
        moved[vehicle, 0] -= vehicles[vehicle].along if vehicle != at.ego else 0.0
    for frame in range(settings.frames):
        _advance(junction, at, level, settings)
        snapshot(junction[0], junction[1], at.row, at.base, at.count, vehicles)
        _brake(vehicles, at, frame == settings.frames - 1, speed, hardest, moved)
    for vehicle in range(at.count):
        moved[vehicle, 0] += vehicles[vehicle].along if vehicle != at.ego else 0.0


@allocating_kernel
def _begin(junction, results, ledger, at, settings, effects):
    """Note where vehicles are, and drive the world without the ego to the common end."""
    road = junction[0]
    traffic = junction[1]
    row = at.row
    pairs = road.pair_first[at.recording]
    first = results.vehicles[row]
    snapshot(road, traffic, row, at.base, at.count, first)
    for vehicle in range(len(first)):
        ledger.relation[row, vehicle] = -1
        for what in range(2):
            ledger.without[row, vehicle, what] = ledger.driven[row, vehicle, what] = 0.0
        for column in range(4):
            ledger.times[row, vehicle, column] = -1
        if vehicle < at.count and vehicle != at.ego and first[vehicle].status != GONE:
            pair = pairs + at.ego * at.count + vehicle
            back = pairs + vehicle * at.count + at.ego
            ledger.relation[row, vehicle] = _relation(road, pair, back)
            ledger.without[row, vehicle, 0] = ledger.driven[row, vehicle, 0] = first[vehicle].along
    _remove(traffic, row, at.ego)
    traffic.ego[row] = -1
    for number in range(effects.decisions):
        moved = np.zeros((at.count, 2))
        _drive(junction, results, at, math.nan, settings, moved)
        for what in range(2):
            ledger.alone[row, number, what] = moved[:, what].sum()
            for vehicle in range(at.count):
                ledger.without[row, vehicle, what] += moved[vehicle, what]


@allocating_kernel
def _account(junction, results, ledger, at, settings, effects):
    """Count a decision, and after the last one what follows it to the common end."""
    road = junction[0]
    traffic = junction[1]
    row = at.row
    frames = settings.frames
    steps = traffic.step[row] - traffic.begun[row]
    times = ledger.times[row]
    before = results.before
    number = (steps - 1) // frames
    encountered = 0.0
    moved = np.zeros((at.count, 2))
    hardest = np.zeros(at.count)
    speed = np.empty(at.count)
    for vehicle in range(at.count):
        speed[vehicle] = before[row, vehicle].speed
    for step in range(number * frames, steps):
        vehicles = results.trace[row, step - number * frames]
        _brake(vehicles, at, (step + 1) % frames == 0, speed, hardest, moved)
        encountered = max(encountered, _look(road, at, vehicles, step, True, times))
    last = number + 1
    vehicles = results.vehicles[row]
    snapshot(road, traffic, row, at.base, at.count, vehicles)
    if results.ending[row] != 0:
        last = effects.decisions
        ending = results.ending[row]
        struck = at.ego
        along = traffic.along[row]
        towed = -math.inf
        if ending == _COLLIDED:  # both stand until they are towed
            struck = _struck(road, traffic, at, junction[3])
            towed = steps + np.rint(effects.tow_after / DT)
        else:
            traffic.ego[row] = -1  # it drives on as traffic
            if ending == _ARRIVED or not effects.released:
                _remove(traffic, row, at.ego)
        wrecks = along[at.ego], along[struck]
        for step in range(steps, effects.decisions * frames):
            if step == towed:
                _remove(traffic, row, at.ego)
                _remove(traffic, row, struck)
            _advance(junction, at, math.nan, settings)
            if step < towed:
                along[at.ego], along[struck] = wrecks
                traffic.speed[row, at.ego] = traffic.speed[row, struck] = 0.0
                speed[struck] = math.nan
            snapshot(road, traffic, row, at.base, at.count, vehicles)
            _brake(vehicles, at, (step + 1) % frames == 0, speed, hardest, moved)
            _look(road, at, vehicles, step, False, times)
    for vehicle in range(at.count):
        if vehicle != at.ego:
            moved[vehicle, 0] = vehicles[vehicle].along - before[row, vehicle].along
    write(results, ledger, row, (number, last), moved, encountered, effects)


@allocating_kernel
def _look_ahead(junction, results, ledger, at, number, settings):
    """Write what others do in the next decisions, as `highway.core.effects`."""
    traffic = junction[1]
    row = at.row
    moved = np.zeros((at.count, 2))
    level = junction[2][number] if number >= 0 else math.nan
    if number < 0:
        _remove(traffic, row, at.ego)
        traffic.ego[row] = -1
    ledger.ahead[row] = math.nan
    for later in range(AHEAD if number >= -1 else 1):
        _drive(junction, results, at, level, settings, moved)
        for vehicle in range(at.count):
            state = results.vehicles[row, vehicle]
            if later == 0 and vehicle != at.ego and state.status == PRESENT:
                ledger.ahead[row, vehicle, 0] = state.speed
    for vehicle in range(at.count):
        if not math.isnan(ledger.ahead[row, vehicle, 0]):
            ledger.ahead[row, vehicle, 1] = moved[vehicle, 0]


def _entry(sources: int) -> Any:
    @allocating_entry_point
    def run(command, results, ledger, rows, settings, junction, effects, first, last):
        road = junction[0]
        traffic = junction[1]
        for row in range(first, last):
            if not rows[row] or command == PREPARE:
                continue
            recording = traffic.recording[row]
            base = road.recording_first[recording]
            end = road.recording_first[recording + 1]
            at = _Place(row, recording, base, end - base, traffic.ego[row])
            if command == BEGIN:
                _begin(junction, results, ledger, at, settings[0], effects[0])
            elif command == ACCOUNT:
                _account(junction, results, ledger, at, settings[0], effects[0])
            else:
                _look_ahead(junction, results, ledger, at, command - REPEAT, settings[0])
        return sources

    return run


run = _entry(fingerprint(__file__))
"""Carry out a command for some rows, as `highway.core.step.effects`; see `core.run`."""
