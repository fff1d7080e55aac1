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
def _drive(road, episodes, vehicles, ego, settings, moved):
    """Advance by a decision; add what vehicles except the ego drive to (vehicle, 2) totals."""
    count = len(moved)
    hardest = np.zeros(count)
    speed = np.empty(count)
    for number in range(count):
        speed[number] = vehicles[number].speed
        moved[number, 0] -= vehicles[number].along if number != ego else 0.0
    for frame in range(settings.frames):
        sub_step(road, episodes[0], vehicles, settings)
        _brake(vehicles, ego, frame == settings.frames - 1, speed, hardest, moved)
    for number in range(count):
        moved[number, 0] += vehicles[number].along if number != ego else 0.0


@kernel
def _take_out(road, episode, vehicles):
    """Remove the ego, whose place stays empty."""
    remove(road, episode, vehicles, episode.controlled[0])
    episode.controlled[0] = -1


@allocating_kernel
def _begin(road, buffers, ledger, row, settings, effects):
    """Note where vehicles are, and drive the world without the ego to the common end."""
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
        _drive(road, copies, vehicles, number_of_ego, settings, moved)
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
    vehicles[episode.controlled[0]].level = math.nan
    if ending == _COLLIDED:  # both stand until then
        return np.rint(effects.tow_after / DT)
    if ending == _ARRIVED or not effects.released:
        remove(road, episode, vehicles, episode.controlled[0])
    episode.controlled[0] = -1
    return -1.0


@allocating_kernel
def _account(road, buffers, ledger, row, settings, effects):
    """Count a decision, and after the last one what follows it to the common end."""
    copies, vehicles, _ = copied(buffers, row, ledger.driven.shape[1])
    episode = copies[0]
    ego = vehicles[episode.controlled[0]]
    struck = vehicles[episode.touched[0]]
    wrecks = ego.along, struck.along
    count = count_of(road, episode)
    frames = settings.frames
    steps = episode.sub_steps - episode.begun
    before = buffers.before[row]
    begun = (steps - 1) // frames * frames
    end = steps
    towed = -1.0
    if buffers.ending[row] != 0:
        end = effects.decisions * frames
        towed = steps + _end(road, episode, vehicles, buffers.ending[row], effects)
    encountered = 0.0
    moved = np.zeros((count, 2))
    hardest = np.zeros(count)
    speed = np.empty(count)
    for number in range(count):
        speed[number] = before[number].speed
    for step in range(begun, end):
        places = vehicles
        if step < steps:
            places = buffers.trace[row, step - begun]
        else:
            if step == towed:
                remove(road, episode, vehicles, ego.identity)
                remove(road, episode, vehicles, struck.identity)
            sub_step(road, episode, vehicles, settings)
            if step < towed:
                ego.along, struck.along = wrecks
                ego.speed = struck.speed = 0.0
                speed[struck.identity] = math.nan
        _brake(places, ego.identity, (step + 1) % frames == 0, speed, hardest, moved)
        near = _look(road, episode, ego.identity, places, step, step < steps, buffers.vehicles[row])
        encountered = max(encountered, near)
    for number in range(count):
        if number != ego.identity:
            moved[number, 0] = vehicles[number].along - before[number].along
    write(buffers, ledger, row, (begun // frames, end // frames), moved, encountered, effects)


@allocating_kernel
def _look_ahead(road, levels, buffers, ledger, row, action, settings):
    """Write what others do in the next decisions, as `highway.core.effects`."""
    copies, vehicles, _ = copied(buffers, row, ledger.driven.shape[1])
    ego = copies[0].controlled[0]
    moved = np.zeros((count_of(road, copies[0]), 2))
    if action < 0:
        _take_out(road, copies[0], vehicles)
    else:
        vehicles[ego].level = levels[action]
    ledger.ahead[row] = math.nan
    for later in range(AHEAD if action >= -1 else 1):
        _drive(road, copies, vehicles, ego, settings, moved)
        for number in range(len(moved)):
            car = vehicles[number]
            if later == 0 and number != ego and car.status == PRESENT:
                ledger.ahead[row, number, 0] = car.speed
    for number in range(len(moved)):
        if not math.isnan(ledger.ahead[row, number, 0]):
            ledger.ahead[row, number, 1] = moved[number, 0]


def _entry(sources: int) -> Any:
    @allocating_entry_point
    def run(command, buffers, ledger, rows, options, junction, effects, first, end):
        road, levels, _ = junction
        settings = options[0]
        for row in range(first, end):
            if not rows[row] or command == PREPARE:
                continue
            if command == BEGIN:
                _begin(road, buffers, ledger, row, settings, effects[0])
            elif command == ACCOUNT:
                _account(road, buffers, ledger, row, settings, effects[0])
            else:
                action = command - REPEAT  # below 0 without the ego
                _look_ahead(road, levels, buffers, ledger, row, action, settings)
        return sources

    return run


run = _entry(fingerprint(__file__))
"""Carry out a command for some rows, as `highway.core.step.effects`; see `core.run`."""
