"""Compiled entry points: resets and decisions of recorded junctions, and traffic without an ego.

`batch`, `replay` and `compare` call them with the records of `batch.records_of`.
"""

import math
from typing import Any

import numpy as np

from socialiq.physics import ballistic
from socialiq.types import Ending
from socialiq.worlds.highway.core.compile import (
    allocating_entry_point,
    fingerprint,
    inlined_kernel,
    kernel,
)
from socialiq.worlds.highway.core.splitmix import hashed
from socialiq.worlds.highway.options import DECIDE_AND_RESET, RESET, SKIP, Contact
from socialiq_recordings.idm import HARDEST
from socialiq_recordings.world import people
from socialiq_recordings.world import traffic as rules
from socialiq_recordings.world.geometry import four, put
from socialiq_recordings.world.observation import annotate, observe, others_touched, touched
from socialiq_recordings.world.traffic import (
    DT,
    GONE,
    PRESENT,
    WAITING,
    ahead_of,
    count_of,
    pair_of,
)

# Purposes of random numbers; those below 100 belong to drivers.
_EGO = 100
_MOMENT = 101
_NONE, _ARRIVAL, _COLLISION, _TIMEOUT, _OTHER = (int(kind) for kind in Ending)
_UNTOUCHED = int(Contact.NONE)
_LEAST_WAY = 15.0  # m that the ego has ahead of it when it begins
_CURVE = 0.5  # s in which the ego's control comes down to the speed of a curve
_BRAKES = 3.0  # m/s², with which a vehicle that enters can stop behind another


@kernel
def _enter(road, episode, vehicles, car, along, speed):
    """Let a vehicle enter the road, as the last of its list."""
    put(road, car, along)
    car.status = PRESENT
    car.speed = speed
    car.before = speed
    car.barrier = math.inf
    vehicles[episode.vehicles].present = car.identity
    episode.vehicles += 1


@kernel
def end_of(road, way):
    """Return the coordinate at which a vehicle leaves the road at the end of its way, m.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        way: Number of the way.
    """
    return road.line_first[way + 1] - road.line_first[way] - 2.0


@kernel
def remove(road, episode, vehicles, number):
    """Take a vehicle off the road; those behind it in the list move up.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        vehicles: VEHICLE records of the episode.
        number: Number of the vehicle in its recording.
    """
    car = vehicles[number]
    car.status = GONE
    car.along = min(car.along, end_of(road, car.way))
    remaining = 0
    for slot in range(episode.vehicles):
        present = vehicles[slot].present
        if present != number:
            vehicles[remaining].present = present
            remaining += 1
    episode.vehicles = remaining


@inlined_kernel
def populate(road, episode, vehicles, recording, ego, step):
    """Place the vehicles that were recorded at a sub-step as they were then.

    Drivers draw their parameters; the desired speed is at least the recorded first one. A vehicle
    that waits has the place of its entry and no speed (NaN); one that has gone has the end of its
    way.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record, whose seed is set.
        vehicles: VEHICLE records of the episode, which are written.
        recording: Number of the recording.
        ego: Number of the ego in its recording; -1 for no ego.
        step: Sub-step from the recording's first frame.
    """
    episode.recording = recording
    episode.controlled[0] = ego
    episode.begun = step
    episode.sub_steps = step
    episode.time = 0.0
    episode.vehicles = 0
    for number in range(count_of(road, episode)):
        car = vehicles[number]
        car.way = way = road.recording_first[recording] + number
        car.length = road.length[way]
        car.width = road.width[way]
        car.level = math.nan
        car.touched = car.met = False
        car.times[:] = -1
        for parameter in range(len(road.drivers)):
            mean, deviation, low, high = four(road.drivers, parameter)
            value = mean + deviation * rules.normal(episode.state_low, parameter, number)
            car.driver[parameter] = min(max(value, low), high)
        first = road.state_first[way]
        car.driver[0] = max(car.driver[0], road.state[first, 1])
        since = step - road.state_step[way]
        if since < 0:
            car.status = WAITING
            put(road, car, road.state[first, 0])
            car.speed = math.nan
        elif since < road.state_first[way + 1] - first:
            along = road.state[first + since, 0]
            _enter(road, episode, vehicles, car, along, road.state[first + since, 1])
        else:
            car.status = GONE
            car.along = end_of(road, way)
            car.speed = 0.0


@inlined_kernel
def reset(road, episode, vehicles):
    """Begin an episode: draw the ego's place and the moment from the episode's seed.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record, whose seed is set.
        vehicles: VEHICLE records of the episode, which are written.
    """
    seed = episode.state_low
    vehicle = road.egos[np.int64(rules.uniform(seed, _EGO, 0) * len(road.egos))]
    recording = np.int64(0)
    while road.recording_first[recording + 1] <= vehicle:
        recording += 1
    first = road.state_first[vehicle]
    end = road.state_first[vehicle + 1]
    moments = np.int64(1)
    while first + moments < end and (
        road.arrival[vehicle] - road.state[first + moments, 0] >= _LEAST_WAY
    ):
        moments += 1
    moment = np.int64(rules.uniform(seed, _MOMENT, 0) * moments)
    ego = vehicle - road.recording_first[recording]
    populate(road, episode, vehicles, recording, ego, road.state_step[vehicle] + moment)


@kernel
def enter(road, episode, vehicles):
    """Let waiting vehicles enter whose time has come and whose place is free.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        vehicles: VEHICLE records of the episode.
    """
    for number in range(count_of(road, episode)):
        car = vehicles[number]
        if car.status != WAITING or road.state_step[car.way] > episode.sub_steps:
            continue
        along = car.along
        speed = road.state[road.state_first[car.way], 1]
        half = 0.5 * car.length
        jam = car.driver[rules.S0]
        gap, pace = people.ahead(road, episode, car)
        free = gap > jam
        # It enters no faster than lets it stop behind another.
        speed = min(speed, math.sqrt(pace**2 + 2.0 * _BRAKES * max(gap - jam, 0.0)))
        for slot in range(episode.vehicles):
            present = vehicles[vehicles[slot].present]
            need = half + 0.5 * present.length
            at = ahead_of(road, pair_of(road, episode, car, present), present.along, along)
            if at > along:
                clear = at - along - need - jam
                free = free and clear > 0.0
                reach = present.speed**2 + 2.0 * _BRAKES * max(clear, 0.0)
                speed = min(speed, math.sqrt(reach))
            behind = ahead_of(road, pair_of(road, episode, present, car), along, present.along)
            if behind > present.along:
                free = free and behind - present.along - need > 0.5
        if free:
            _enter(road, episode, vehicles, car, along, speed)


@kernel
def sub_step(road, episode, vehicles, settings):
    """Advance by a sub-step; vehicles at the end of their ways leave the road, the ego stays.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        vehicles: VEHICLE records of the episode.
        settings: SETTINGS record of the world.
    """
    ego = episode.controlled[0]
    for slot in range(episode.vehicles):
        car = vehicles[vehicles[slot].present]
        car.acceleration = rules.drive(road, episode, vehicles, car)
        if not math.isnan(car.level):
            fastest = min(rules.limit_at(road, car), settings.max_speed)
            car.acceleration = min(car.level, max((fastest - car.speed) / _CURVE, -HARDEST))
    for slot in range(episode.vehicles):
        car = vehicles[vehicles[slot].present]
        driven, speed = ballistic(car.speed, car.acceleration, DT)
        put(road, car, car.along + driven)
        car.speed = speed
    episode.sub_steps += 1
    for slot in range(episode.vehicles - 1, -1, -1):
        car = vehicles[vehicles[slot].present]
        if car.identity != ego and car.along >= end_of(road, car.way):
            remove(road, episode, vehicles, car.identity)
    enter(road, episode, vehicles)


@kernel
def note(vehicles, places):
    """Write where each vehicle is if there is space, which is where effects are measured.

    Args:
        vehicles: VEHICLE records of an episode.
        places: PLACE records that are written.
    """
    for number in range(len(places)):
        car = vehicles[number]
        target = places[number]
        target.x = car.x
        target.y = car.y
        target.along_x = car.along_x
        target.along_y = car.along_y
        target.along = car.along
        target.speed = car.speed
        target.identity = car.identity
        target.status = car.status
        target.counted = car.counted


@inlined_kernel
def decide(road, buffers, row, settings, slack):
    """Run the sub-steps of a decision and write its results.

    The episode ends with a contact, past a closed line, at the arrival or after its duration.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        buffers: Arrays of the batch, which are written.
        row: Row of the episode.
        settings: SETTINGS record of the world.
        slack: Length by which vehicles are narrower and shorter than recorded, m.
    """
    episode = buffers.episodes[row]
    vehicles = buffers.vehicles[row]
    ego = vehicles[episode.controlled[0]]
    half = 0.5 * ego.length
    start = ego.along
    for slot in range(episode.vehicles):
        car = vehicles[vehicles[slot].present]
        car.before = car.speed
    note(vehicles, buffers.before[row])
    ending = _NONE
    contact = _UNTOUCHED
    neighbours_collided = 0
    episode.hit = 0
    episode.others_hit = 0
    for frame in range(settings.frames):
        now = episode.sub_steps * DT
        line = rules.closed_line(road, ego.way, ego.along + half, now)
        sub_step(road, episode, vehicles, settings)
        if len(buffers.trace):
            note(vehicles, buffers.trace[row, frame])
        collided, hits = others_touched(road, episode, vehicles, slack)
        neighbours_collided += collided
        episode.others_hit += hits
        contact = touched(road, episode, vehicles, slack)
        if contact != _UNTOUCHED:
            ending = _COLLISION
        elif ego.along + half >= line:
            ending = _OTHER
        elif ego.along >= road.arrival[ego.way]:
            ending = _ARRIVAL
        if ending != _NONE:
            break
    steps = episode.sub_steps - episode.begun
    if ending == _NONE and steps * DT >= settings.duration - 1e-9:
        ending = _TIMEOUT
    episode.time = steps // settings.frames * settings.decision
    buffers.contact[row] = contact
    buffers.neighbours_collided[row] = neighbours_collided
    buffers.speed[row] = ego.speed
    buffers.ending[row] = ending
    progress = ego.along - start
    annotate(road, episode, vehicles, progress, ending, settings, buffers, row)
    whole = steps % settings.frames == 0
    buffers.present[row, 0] = count_of(road, episode) if whole else 0  # no part is judged
    note(vehicles, buffers.after[row])


def _run(sources: int):
    @allocating_entry_point
    def run(buffers, commands, seeds, seeded, actions, options, junction, first, end):
        road, levels, slack = junction
        for row in range(first, end):
            command = commands[row]
            if command == SKIP:
                continue
            episode = buffers.episodes[row]
            vehicles = buffers.vehicles[row]
            if command != RESET:
                vehicles[episode.controlled[0]].level = levels[actions[row]]
                decide(road, buffers, row, options[0], slack)
                observe(road, episode, vehicles, buffers.observation[row])
                buffers.reached[row] = buffers.observation[row]
            ends = command == DECIDE_AND_RESET and buffers.ending[row] != _NONE
            if command == RESET or ends:
                episode.state_low = rules.following(episode.state_low)
                if seeded[row]:
                    episode.state_low = hashed(seeds[row])
                episode.increment_low = 1  # the row has begun
                reset(road, episode, vehicles)
                observe(road, episode, vehicles, buffers.observation[row])
        return sources  # so that the cache depends on the sources

    return run


def _replay(sources: int):
    @allocating_entry_point
    def replay(road, state, results, recordings, egos, steps, options, first, end):
        episode = state[0][0]
        vehicles = state[1][0]
        frames = options[0].frames
        for moment in range(first, end):
            step = steps[moment]
            ego = vehicles[egos[moment]]
            populate(road, episode, vehicles, recordings[moment], egos[moment], step)
            observe(road, episode, vehicles, results.observation[moment])
            results.speed[moment] = ego.speed
            start = ego.along
            populate(road, episode, vehicles, recordings[moment], egos[moment], step + frames)
            for slot in range(episode.vehicles):
                car = vehicles[vehicles[slot].present]
                since = max(step - road.state_step[car.way], 0)
                car.before = road.state[road.state_first[car.way] + since, 1]
            ending = _ARRIVAL if ego.along >= road.arrival[ego.way] else _NONE
            results.ending[moment] = ending
            progress = ego.along - start
            annotate(road, episode, vehicles, progress, ending, options[0], results, moment)
        return sources

    return replay


def _without_ego(sources: int):
    @allocating_entry_point
    def without_ego(road, state, recordings, states, steps, options, slack, first, end):
        for row in range(first, end):
            episode = state[0][row]
            vehicles = state[1][row]
            populate(road, episode, vehicles, recordings[row], -1, 0)
            for step in range(steps):
                for slot in range(episode.vehicles):
                    car = vehicles[vehicles[slot].present]
                    states[row, step, car.identity, 0] = car.along
                    states[row, step, car.identity, 1] = car.speed
                sub_step(road, episode, vehicles, options[0])
                _, hits = others_touched(road, episode, vehicles, slack)
                episode.others_hit += hits
        return sources

    return without_ego


run: Any = _run(fingerprint(__file__))
replay: Any = _replay(fingerprint(__file__))
without_ego: Any = _without_ego(fingerprint(__file__))
"""Entry points: carry out a command for every episode of a batch (`highway.core.step.run`); write
observation and rewards of recorded moments; drive all vehicles from the first frame.

Args:
    buffers: Arrays of a batch, `options.Buffers`.
    state: EPISODE and VEHICLE records that are overwritten, of `batch.records_of`.
    results: Buffers that are written.
    commands: RESET, DECIDE, DECIDE_AND_RESET or SKIP, by row.
    seeds: Seeds of the streams that a reset begins, uint64.
    seeded: Whether a reset begins a stream, by row.
    actions: Numbers of levels.
    options: SETTINGS record in an array of one.
    junction: `recorded_world.Road`, the levels in m/s² by action (NaN: as a driver of the
        population) and m by which vehicles are smaller than recorded.
    states: Coordinates, m, and speeds, m/s, that are written, (row, step, vehicle, 2).
    first: First row of the part to do, up to `end`.
"""
