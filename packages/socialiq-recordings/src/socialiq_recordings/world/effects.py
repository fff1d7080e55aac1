"""Commands of what the ego causes at a recorded junction (`highway.effects`), compiled.

Later vehicles enter where and when they were recorded, and drivers make no draws after they
entered: both worlds have the same traffic. A vehicle's metres end with its recorded way.
"""

from __future__ import annotations

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
from socialiq.worlds.highway.core.effects import HARD, copied, encounter, write
from socialiq.worlds.highway.effects import ACCOUNT, AHEAD, BEGIN, PREPARE, RELATIONS, REPEAT
from socialiq_recordings.world.core import remove, sub_step
from socialiq_recordings.world.traffic import DT, GONE, PRESENT, count_of, pair_of

_ARRIVED = int(Ending.ARRIVAL)
_COLLIDED = int(Ending.COLLISION)
_SAME_APPROACH, _SAME_EXIT, _CROSSING = range(len(RELATIONS))


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
def _note(times, column, step):
    """Write that a vehicle is in an area at a sub-step."""
    if times[column] < 0:
        times[column] = step
    times[column + 1] = step


@kernel
def _look(road, episode, number_of_ego, vehicles, step, driving, noted):
    """Note the vehicles in an area with the ego's way; return the closest predicted encounter."""
    closest = 0.0
    ego = vehicles[number_of_ego]
    half = 0.5 * ego.length
    for number in range(count_of(road, episode)):
        car = vehicles[number]
        area = road.area_of[pair_of(road, episode, ego, car)]
        if number == number_of_ego or area < 0:
            continue
        times = noted[number].times
        if driving and road.area[area, 0] - half < ego.along < road.area[area, 1] + half:
            _note(times, 0, step)
        side = 0.5 * car.length
        if car.status != PRESENT:
            continue
        if road.area[area, 2] - side < car.along < road.area[area, 3] + side:
            _note(times, 2, step)
        if driving:
            closest = max(closest, encounter(ego, car))
    return closest


@allocating_kernel
def _advance(junction, episode, vehicles, level, settings):
    sub_step(junction[0], episode, vehicles, level, settings.max_speed)


@kernel
def _brake(vehicles, ego, ends, speed, hardest, moved):
    """Compare speeds with those before a sub-step; count hard brakings if it ends a decision."""
    for number in range(len(moved)):
        change = (vehicles[number].speed - speed[number]) / DT
        speed[number] = vehicles[number].speed
        if number != ego and not math.isnan(change):
            hardest[number] = min(hardest[number], change)
        if ends:
            moved[number, 1] += hardest[number] < HARD
            hardest[number] = 0.0


@allocating_kernel
def _drive(junction, episodes, vehicles, ego, level, settings, moved):
    """Advance by a decision; add what vehicles except the ego drive to (vehicle, 2) totals."""
    count = len(moved)
    hardest = np.zeros(count)
    speed = np.empty(count)
    for number in range(count):
        speed[number] = vehicles[number].speed
        moved[number, 0] -= vehicles[number].along if number != ego else 0.0
    for frame in range(settings.frames):
        _advance(junction, episodes[0], vehicles, level, settings)
        _brake(vehicles, ego, frame == settings.frames - 1, speed, hardest, moved)
    for number in range(count):
        moved[number, 0] += vehicles[number].along if number != ego else 0.0


@kernel
def _take_out(road, episode, vehicles):
    """Remove the ego, in whose place nobody drives."""
    remove(road, episode, vehicles, episode.controlled[0])
    episode.controlled[0] = -1


@allocating_kernel
def _begin(junction, buffers, ledger, row, settings, effects):
    """Note where vehicles are, and drive the world without the ego to the common end."""
    road = junction[0]
    copies, vehicles, _ = copied(buffers, row, ledger.driven.shape[1])
    number_of_ego = copies[0].controlled[0]
    ego = vehicles[number_of_ego]
    count = count_of(road, copies[0])
    for number in range(len(vehicles)):
        ledger.relation[row, number] = -1
        for what in range(2):
            ledger.without[row, number, what] = ledger.driven[row, number, what] = 0.0
        if number < count and number != number_of_ego and vehicles[number].status != GONE:
            car = vehicles[number]
            pair = pair_of(road, copies[0], ego, car)
            back = pair_of(road, copies[0], car, ego)
            ledger.relation[row, number] = _relation(road, pair, back)
            ledger.without[row, number, 0] = ledger.driven[row, number, 0] = car.along
    _take_out(road, copies[0], vehicles)
    for decision in range(effects.decisions):
        moved = np.zeros((count, 2))
        _drive(junction, copies, vehicles, number_of_ego, math.nan, settings, moved)
        for what in range(2):
            ledger.alone[row, decision, what] = moved[:, what].sum()
            for number in range(count):
                ledger.without[row, number, what] += moved[number, what]


@kernel
def _end(road, episode, vehicles, ending, effects):
    """Take the ego out after its end, or let it drive on as traffic.

    Returns:
        Sub-steps until the ego and what it struck are towed; -1 if it did not collide.
    """
    if ending == _COLLIDED:  # both stand until then
        return np.rint(effects.tow_after / DT)
    if ending == _ARRIVED or not effects.released:
        remove(road, episode, vehicles, episode.controlled[0])
    episode.controlled[0] = -1
    return -1.0


@allocating_kernel
def _account(junction, buffers, ledger, row, settings, effects):
    """Count a decision, and after the last one what follows it to the common end."""
    road = junction[0]
    copies, vehicles, _ = copied(buffers, row, ledger.driven.shape[1])
    episode = copies[0]
    ego = episode.controlled[0]
    count = count_of(road, episode)
    frames = settings.frames
    steps = episode.sub_steps - episode.begun
    before = buffers.before[row]
    noted = buffers.vehicles[row]
    number = (steps - 1) // frames
    encountered = 0.0
    moved = np.zeros((count, 2))
    hardest = np.zeros(count)
    speed = np.empty(count)
    for vehicle in range(count):
        speed[vehicle] = before[vehicle].speed
    for step in range(number * frames, steps):
        traced = buffers.trace[row, step - number * frames]
        _brake(traced, ego, (step + 1) % frames == 0, speed, hardest, moved)
        encountered = max(encountered, _look(road, episode, ego, traced, step, True, noted))
    last = number + 1
    if buffers.ending[row] != 0:
        last = effects.decisions
        towed = _end(road, episode, vehicles, buffers.ending[row], effects)
        struck = vehicles[episode.touched[0]]
        wreck = vehicles[ego]
        places = wreck.along, struck.along
        for step in range(steps, effects.decisions * frames):
            if step == steps + towed:
                remove(road, episode, vehicles, wreck.identity)
                remove(road, episode, vehicles, struck.identity)
            _advance(junction, episode, vehicles, math.nan, settings)
            if step < steps + towed:
                wreck.along, struck.along = places
                wreck.speed = struck.speed = 0.0
                speed[struck.identity] = math.nan
            _brake(vehicles, ego, (step + 1) % frames == 0, speed, hardest, moved)
            _look(road, episode, ego, vehicles, step, False, noted)
    for vehicle in range(count):
        if vehicle != ego:
            moved[vehicle, 0] = vehicles[vehicle].along - before[vehicle].along
    write(buffers, ledger, row, (number, last), moved, encountered, effects)


@allocating_kernel
def _look_ahead(junction, buffers, ledger, row, number, settings):
    """Write what others do in the next decisions, as `highway.core.effects`."""
    road = junction[0]
    copies, vehicles, _ = copied(buffers, row, ledger.driven.shape[1])
    ego = copies[0].controlled[0]
    moved = np.zeros((count_of(road, copies[0]), 2))
    level = junction[1][number] if number >= 0 else math.nan
    if number < 0:
        _take_out(road, copies[0], vehicles)
    ledger.ahead[row] = math.nan
    for later in range(AHEAD if number >= -1 else 1):
        _drive(junction, copies, vehicles, ego, level, settings, moved)
        for vehicle in range(len(moved)):
            car = vehicles[vehicle]
            if later == 0 and vehicle != ego and car.status == PRESENT:
                ledger.ahead[row, vehicle, 0] = car.speed
    for vehicle in range(len(moved)):
        if not math.isnan(ledger.ahead[row, vehicle, 0]):
            ledger.ahead[row, vehicle, 1] = moved[vehicle, 0]


def _entry(sources: int) -> Any:
    @allocating_entry_point
    def run(command, buffers, ledger, rows, settings, junction, effects, first, last):
        for row in range(first, last):
            if not rows[row] or command == PREPARE:
                continue
            if command == BEGIN:
                _begin(junction, buffers, ledger, row, settings[0], effects[0])
            elif command == ACCOUNT:
                _account(junction, buffers, ledger, row, settings[0], effects[0])
            else:
                _look_ahead(junction, buffers, ledger, row, command - REPEAT, settings[0])
        return sources

    return run


run = _entry(fingerprint(__file__))
"""Carry out a command for some rows, as `highway.core.step.effects`; see `core.run`."""
