"""Commands of what the ego causes at a recorded junction (`highway.effects`), compiled.

Later vehicles enter where and when they were recorded, and drivers make no draws after they
entered: both worlds have the same traffic. A vehicle's metres end with its recorded way.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core.compile import allocating_kernel, entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.effects import HARD, commands, copied, encounter, write
from socialiq.worlds.highway.effects import RELATIONS
from socialiq_recordings.world.core import note, remove, sub_step
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
def _widen(times, column, step):
    """Write that a vehicle is in an area at a sub-step."""
    if times[column] < 0:
        times[column] = step
    times[column + 1] = step


@kernel
def _look(road, episode, number_of_ego, places, step, driving, vehicles):
    """Note the vehicles in an area with the ego's way; return the closest predicted encounter."""
    closest = 0.0
    ego = places[number_of_ego]
    half = 0.5 * vehicles[number_of_ego].length
    for number in range(count_of(road, episode)):
        car = places[number]
        area = road.area_of[pair_of(road, episode, ego, car)]
        if number == number_of_ego or area < 0:
            continue
        times = vehicles[number].times
        if driving and road.area[area, 0] - half < ego.along < road.area[area, 1] + half:
            _widen(times, 0, step)
        side = 0.5 * vehicles[number].length
        if car.status != PRESENT:
            continue
        if road.area[area, 2] - side < car.along < road.area[area, 3] + side:
            _widen(times, 2, step)
        if driving:
            closest = max(closest, encounter(ego, car))
    return closest


@kernel
def _brake(vehicles, ego, ends, speed, hardest, moved):
    """Compare speeds with those before a sub-step; count hard brakings if it ends a decision."""
    for number in range(len(hardest)):
        change = (vehicles[number].speed - speed[number]) / DT
        speed[number] = vehicles[number].speed
        if number != ego and not math.isnan(change):
            hardest[number] = min(hardest[number], change)
        if ends:
            moved[number, 1] += hardest[number] < HARD
            hardest[number] = 0.0


@allocating_kernel
def _drive_on(state, ledger, row, number, junction, settings, effects, moved):  # noqa: ARG001  as on roads
    """Advance all by a decision; add what vehicles except the ego drive to (vehicle, 2) totals."""
    episodes, vehicles, _, _, ego = state
    count = count_of(junction[0], episodes[0])
    hardest = np.zeros(count)
    speed = np.empty(count)
    for identity in range(count):
        speed[identity] = vehicles[identity].speed
        moved[identity, 0] -= vehicles[identity].along if identity != ego else 0.0
    for frame in range(settings.frames):
        sub_step(junction[0], episodes[0], vehicles, settings)
        _brake(vehicles, ego, frame == settings.frames - 1, speed, hardest, moved)
    for identity in range(count):
        moved[identity, 0] += vehicles[identity].along if identity != ego else 0.0


@kernel
def _prepare(episode, arrivals, number, effects):
    """Choose nothing: later traffic is that of the recording."""


@kernel
def _take_out(state, junction):
    remove(junction[0], state[0][0], state[1], state[4])
    state[0][0].controlled[0] = -1


@kernel
def _act(state, action, junction, settings):  # noqa: ARG001  as on roads
    state[1][state[4]].level = junction[1][action]


@kernel
def _listed(vehicles, slot):
    return vehicles[vehicles[slot].present]


@kernel
def _relate(buffers, state, ledger, row, junction):  # noqa: ARG001  as on roads
    """Note the relations of vehicles that have not gone to the ego, and where they are at first."""
    road = junction[0]
    episode = state[0][0]
    ego = state[1][state[4]]
    for identity in range(count_of(road, episode)):
        car = state[1][identity]
        if car.status == GONE or ledger.relation[row, identity] >= 0:
            continue
        pair = pair_of(road, episode, ego, car)
        back = pair_of(road, episode, car, ego)
        ledger.relation[row, identity] = _relation(road, pair, back)
        ledger.without[row, identity, 0] = ledger.driven[row, identity, 0] = car.along


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
def _account(buffers, ledger, row, _number, junction, settings, effects):
    """Count a decision, and after the last one what follows it to the common end."""
    road = junction[0]
    number_of_ego = buffers.episodes[row].controlled[0]
    # A record of an array doesn't keep the array's memory, so `copies` is used to the end.
    copies, vehicles, _, _, _ = copied(buffers, ledger, row, number_of_ego)
    ego = vehicles[number_of_ego]
    struck = vehicles[copies[0].touched[0]]
    wrecks = ego.along, struck.along
    count = count_of(road, copies[0])
    frames = settings.frames
    steps = copies[0].sub_steps - copies[0].begun
    before = buffers.before[row]
    begun = (steps - 1) // frames * frames
    end = steps
    towed = -1.0
    if buffers.ending[row] != 0:
        end = effects.decisions * frames
        towed = steps + _end(road, copies[0], vehicles, buffers.ending[row], effects)
    encountered = 0.0
    moved = np.zeros((count, 2))
    hardest = np.zeros(count)
    speed = np.empty(count)
    for identity in range(count):
        speed[identity] = before[identity].speed
    driven = np.empty(count, before.dtype)
    for step in range(begun, end):
        places = driven
        if step < steps:
            places = buffers.trace[row, step - begun]
        else:
            if step == towed:
                remove(road, copies[0], vehicles, number_of_ego)
                remove(road, copies[0], vehicles, struck.identity)
            sub_step(road, copies[0], vehicles, settings)
            if step < towed:
                ego.along, struck.along = wrecks
                ego.speed = struck.speed = 0.0
                speed[struck.identity] = math.nan
            note(vehicles, driven)
        _brake(places, number_of_ego, (step + 1) % frames == 0, speed, hardest, moved)
        driving = step < steps
        near = _look(road, copies[0], number_of_ego, places, step, driving, buffers.vehicles[row])
        encountered = max(encountered, near)
    for identity in range(count):
        if identity != number_of_ego:
            moved[identity, 0] = vehicles[identity].along - before[identity].along
    write(buffers, ledger, row, (begun // frames, end // frames), moved, encountered, effects)


carry_out = commands(_prepare, _relate, _take_out, _act, _drive_on, _listed, _account)


def _entry(sources: int) -> Any:
    @entry_point
    def run(command, buffers, ledger, rows, options, junction, effects, first, end):
        for row in range(first, end):
            if rows[row]:
                carry_out(command, buffers, ledger, row, junction, options[0], effects[0])
        return sources

    return run


run = _entry(fingerprint(__file__))
"""Carry out a command for some rows, as `highway.core.step.effects`; see `core.run`."""
