"""Compiled entry points: resets and decisions of recorded junctions, and traffic without an ego.

`gym`, `replay` and `compare` call them. `row` is an episode, `base` the first vehicle of its
recording, `count` the number of its vehicles.
"""

import math

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
from socialiq.worlds.highway.options import DECIDE, SKIP, Contact
from socialiq_recordings.idm import HARDEST
from socialiq_recordings.world import people
from socialiq_recordings.world import traffic as rules
from socialiq_recordings.world.observation import annotate, observe, others_touched, touched
from socialiq_recordings.world.traffic import DT, GONE, PRESENT, WAITING, ahead_of

# Purposes of random numbers; those below 100 belong to drivers.
_EGO = 100
_MOMENT = 101
_NONE, _ARRIVAL, _COLLISION, _TIMEOUT, _OTHER = (int(kind) for kind in Ending)
_UNTOUCHED = int(Contact.NONE)
_LEAST_WAY = 15.0  # m that the ego has ahead of it when it begins
_CURVE = 0.5  # s in which the ego's control comes down to the speed of a curve


@kernel
def _put(traffic, row, vehicle, along, speed):
    traffic.status[row, vehicle] = PRESENT
    traffic.along[row, vehicle] = along
    traffic.speed[row, vehicle] = speed
    traffic.before[row, vehicle] = speed
    traffic.barrier[row, vehicle] = math.inf
    traffic.present[row, traffic.n_present[row]] = vehicle
    traffic.n_present[row] += 1


@kernel
def snapshot(road, traffic, row, base, count, vehicles):
    """Write place, speed and status of every vehicle.

    A vehicle that waits has the place of its entry and no speed (NaN); one that has gone has the
    end of its way.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`.
        row: Episode.
        base: First vehicle of its recording.
        count: Number of vehicles of its recording.
        vehicles: VEHICLE records that are written.
    """
    for number in range(count):
        vehicle = vehicles[number]
        state = road.state_first[base + number]
        vehicle.status = traffic.status[row, number]
        vehicle.along = traffic.along[row, number]
        vehicle.speed = traffic.speed[row, number]
        if vehicle.status == WAITING:
            vehicle.along = road.state[state, 0]
            vehicle.speed = math.nan
        elif vehicle.status == GONE:
            points = road.line_first[base + number + 1] - road.line_first[base + number]
            vehicle.along = min(vehicle.along, points - 2.0)


@inlined_kernel
def populate(road, traffic, row, recording, ego, step):
    """Place the vehicles that were recorded at a sub-step as they were then.

    Drivers draw their parameters; the desired speed is at least the recorded first one.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`; the seed of the row is set.
        row: Episode.
        recording: Number of the recording.
        ego: Number of the ego in its recording; -1 for no ego.
        step: Sub-step from the recording's first frame.
    """
    base = road.recording_first[recording]
    end = road.recording_first[recording + 1]
    traffic.recording[row] = recording
    traffic.ego[row] = ego
    traffic.step[row] = traffic.begun[row] = step
    traffic.n_present[row] = 0
    traffic.touched[row, : end - base] = 0
    traffic.met[row, : end - base] = 0
    for vehicle in range(end - base):
        first = road.state_first[base + vehicle]
        last = road.state_first[base + vehicle + 1] - 1
        for number in range(len(road.drivers)):
            mean = road.drivers[number, 0]
            deviation = road.drivers[number, 1]
            value = mean + deviation * rules.normal(traffic.seed[row], number, vehicle)
            value = min(max(value, road.drivers[number, 2]), road.drivers[number, 3])
            traffic.driver[row, vehicle, number] = value
        desired = max(traffic.driver[row, vehicle, 0], road.state[first, 1])
        traffic.driver[row, vehicle, 0] = desired
        since = step - road.state_step[base + vehicle]
        if since < 0:
            traffic.status[row, vehicle] = WAITING
        elif since <= last - first:
            _put(traffic, row, vehicle, road.state[first + since, 0], road.state[first + since, 1])
        else:
            traffic.status[row, vehicle] = GONE


@inlined_kernel
def reset(road, traffic, row):
    """Begin an episode: draw the ego's place and the moment from the row's seed.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`; the seed of the row is set.
        row: Episode.
    """
    seed = traffic.seed[row]
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
    populate(road, traffic, row, recording, ego, road.state_step[vehicle] + moment)


@inlined_kernel
def enter(road, traffic, row, base, count):
    """Let waiting vehicles enter whose time has come and whose place is free.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`.
        row: Episode.
        base: First vehicle of its recording.
        count: Number of vehicles of its recording.
    """
    pairs = road.pair_first[traffic.recording[row]]
    for vehicle in range(count):
        if traffic.status[row, vehicle] != WAITING:
            continue
        if road.state_step[base + vehicle] > traffic.step[row]:
            continue
        begin = road.state_first[base + vehicle]
        along = road.state[begin, 0]
        speed = road.state[begin, 1]
        half = 0.5 * road.length[base + vehicle]
        jam = traffic.driver[row, vehicle, 2]
        recording = traffic.recording[row]
        step = traffic.step[row]
        gap, pace = people.ahead(road, recording, step, base + vehicle, along)
        free = gap > jam
        # It enters no faster than lets it stop behind another.
        speed = min(speed, math.sqrt(pace**2 + 2.0 * 3.0 * max(gap - jam, 0.0)))
        for slot in range(traffic.n_present[row]):
            present = traffic.present[row, slot]
            along_there = traffic.along[row, present]
            need = half + 0.5 * road.length[base + present]
            pair = pairs + vehicle * count + present
            back = pairs + present * count + vehicle
            at = ahead_of(road.stretch_first, road.stretch, pair, along_there, along)
            if at > along:
                clear = at - along - need - jam
                free = free and clear > 0.0
                reach = traffic.speed[row, present] ** 2 + 2.0 * 3.0 * max(clear, 0.0)
                speed = min(speed, math.sqrt(reach))
            behind = ahead_of(road.stretch_first, road.stretch, back, along, along_there)
            if behind > along_there:
                free = free and behind - along_there - need > 0.5
        if free:
            _put(traffic, row, vehicle, along, speed)


@inlined_kernel
def sub_step(road, traffic, row, base, count, level, fastest):
    """Advance by a sub-step; vehicles at the end of their ways leave the road, the ego stays.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`.
        row: Episode.
        base: First vehicle of its recording.
        count: Number of vehicles of its recording.
        level: Acceleration of the ego, m/s²; with NaN it drives as a driver of the population.
        fastest: Largest speed of the ego, m/s; not used if `level` is NaN.
    """
    now = traffic.step[row] * DT
    for slot in range(traffic.n_present[row]):
        vehicle = traffic.present[row, slot]
        rate = rules.drive(road, traffic, row, base, count, vehicle, now)
        if vehicle == traffic.ego[row] and not math.isnan(level):
            along = traffic.along[row, vehicle]
            speed = traffic.speed[row, vehicle]
            limit = rules.limit_at(road.line_first, road.line, base + vehicle, along)
            rate = min(level, max((min(limit, fastest) - speed) / _CURVE, -HARDEST))
        traffic.rate[row, vehicle] = rate
    for slot in range(traffic.n_present[row]):
        vehicle = traffic.present[row, slot]
        driven, speed = ballistic(traffic.speed[row, vehicle], traffic.rate[row, vehicle], DT)
        traffic.along[row, vehicle] += driven
        traffic.speed[row, vehicle] = speed
    traffic.step[row] += 1
    remaining = 0
    for slot in range(traffic.n_present[row]):
        vehicle = traffic.present[row, slot]
        points = road.line_first[base + vehicle + 1] - road.line_first[base + vehicle]
        if vehicle != traffic.ego[row] and traffic.along[row, vehicle] >= points - 2.0:
            traffic.status[row, vehicle] = GONE
        else:
            traffic.present[row, remaining] = vehicle
            remaining += 1
    traffic.n_present[row] = remaining
    enter(road, traffic, row, base, count)


@inlined_kernel
def decide(road, traffic, results, row, level, settings, slack):
    """Run the sub-steps of a decision and write its results.

    The episode ends with a contact, past a closed line, at the arrival or after its duration.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`.
        results: Buffers that are written.
        row: Episode, and row of the buffers.
        level: Acceleration of the ego, m/s²; with NaN it drives as a driver of the population.
        settings: SETTINGS record of the world.
        slack: Length by which vehicles are narrower and shorter than recorded, m.
    """
    recording = traffic.recording[row]
    ego = traffic.ego[row]
    base = road.recording_first[recording]
    count = road.recording_first[recording + 1] - base
    vehicle = base + ego
    half = 0.5 * road.length[base + ego]
    start = traffic.along[row, ego]
    ending = _NONE
    for slot in range(traffic.n_present[row]):
        number = traffic.present[row, slot]
        traffic.before[row, number] = traffic.speed[row, number]
    if len(results.trace):
        snapshot(road, traffic, row, base, count, results.before[row])
    results.contact[row] = _UNTOUCHED
    results.neighbours_collided[row] = 0
    traffic.hit[row] = traffic.others_hit[row] = 0
    for frame in range(settings.frames):
        front = traffic.along[row, ego] + half
        now = traffic.step[row] * DT
        line = rules.closed_line(road.closed_first, road.closed, vehicle, front, now)
        sub_step(road, traffic, row, base, count, level, settings.max_speed)
        if len(results.trace):
            snapshot(road, traffic, row, base, count, results.trace[row, frame])
        results.neighbours_collided[row] += others_touched(road, traffic, row, base, slack)
        traffic.others_hit[row] += people.others_touched(road, traffic, row, base, slack)
        contact = touched(road, traffic, row, base, slack)
        if contact == _UNTOUCHED:
            contact = people.touched(road, traffic, row, base, slack)
        if contact != _UNTOUCHED:
            results.contact[row] = contact
            ending = _COLLISION
        elif traffic.along[row, ego] + half >= line:
            ending = _OTHER
        elif traffic.along[row, ego] >= road.arrival[vehicle]:
            ending = _ARRIVAL
        if ending != _NONE:
            break
    elapsed = (traffic.step[row] - traffic.begun[row]) * DT
    if ending == _NONE and elapsed >= settings.duration - 1e-9:
        ending = _TIMEOUT
    results.speed[row] = traffic.speed[row, ego]
    results.ending[row] = ending
    progress = traffic.along[row, ego] - start
    annotate(road, traffic, row, base, count, progress, ending, settings, results, row)
    whole = (traffic.step[row] - traffic.begun[row]) % settings.frames == 0
    results.present[row, 0] = count if whole else 0  # no effect is judged of a part
    if len(results.trace):
        snapshot(road, traffic, row, base, count, results.after[row])


@inlined_kernel
def replay_moment(road, traffic, results, moment, recording, ego, step, settings):
    """Write observation and rewards of a recorded state and the decision that follows it.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`, whose first row is overwritten.
        results: Buffers that are written.
        moment: Row of the buffers.
        recording: Number of the recording.
        ego: Number of the recorded vehicle in its recording.
        step: Sub-step of the state from the recording's first frame.
        settings: SETTINGS record of the world.
    """
    base = road.recording_first[recording]
    count = road.recording_first[recording + 1] - base
    populate(road, traffic, 0, recording, ego, step)
    observe(road, traffic, 0, base, count, results.observation[moment])
    results.speed[moment] = traffic.speed[0, ego]
    start = traffic.along[0, ego]
    populate(road, traffic, 0, recording, ego, step + settings.frames)
    for slot in range(traffic.n_present[0]):
        vehicle = traffic.present[0, slot]
        begun = max(road.state_step[base + vehicle], step)
        at = road.state_first[base + vehicle] + begun - road.state_step[base + vehicle]
        traffic.before[0, vehicle] = road.state[at, 1]
    progress = traffic.along[0, ego] - start
    ending = _ARRIVAL if traffic.along[0, ego] >= road.arrival[base + ego] else _NONE
    results.ending[moment] = ending
    annotate(road, traffic, 0, base, count, progress, ending, settings, results, moment)


def _entries(sources: int):
    @allocating_entry_point
    def run(results, commands, seeds, seeded, actions, options, junction, first, end):
        road, traffic, levels, slack = junction
        for row in range(first, end):
            if commands[row] == SKIP:
                continue
            if commands[row] == DECIDE:
                decide(road, traffic, results, row, levels[actions[row]], options[0], slack)
            else:
                if seeded[row]:
                    traffic.seed[row] = hashed(seeds[row])
                else:
                    traffic.seed[row] = rules.following(traffic.seed[row])
                reset(road, traffic, row)
            base = road.recording_first[traffic.recording[row]]
            count = road.recording_first[traffic.recording[row] + 1] - base
            observe(road, traffic, row, base, count, results.observation[row])
        return sources  # so that the cache depends on the sources

    @allocating_entry_point
    def replay(road, traffic, results, recordings, egos, steps, options, first, end):
        for moment in range(first, end):
            at = recordings[moment], egos[moment], steps[moment]
            replay_moment(road, traffic, results, moment, at[0], at[1], at[2], options[0])
        return sources

    @allocating_entry_point
    def without_ego(road, traffic, recordings, states, steps, slack, first, end):
        for row in range(first, end):
            populate(road, traffic, row, recordings[row], -1, 0)
            base = road.recording_first[recordings[row]]
            count = road.recording_first[recordings[row] + 1] - base
            for step in range(steps):
                for slot in range(traffic.n_present[row]):
                    vehicle = traffic.present[row, slot]
                    states[row, step, vehicle, 0] = traffic.along[row, vehicle]
                    states[row, step, vehicle, 1] = traffic.speed[row, vehicle]
                sub_step(road, traffic, row, base, count, math.nan, 1.0)
                traffic.others_hit[row] += people.others_touched(road, traffic, row, base, slack)
        return sources

    return run, replay, without_ego


run, replay, without_ego = _entries(fingerprint(__file__))
"""Entry points.

Args:
    results: `state.Buffers`.
    commands: RESET, DECIDE or SKIP of `state`, by row.
    seeds: Seeds of the streams that a reset begins, uint64.
    seeded: Whether a reset begins a stream, by row.
    actions: Numbers of levels.
    options: SETTINGS record in an array of one.
    junction: `recorded_world.Road`, `gym.Traffic`, the levels in m/s² (NaN: as a driver of the
        population) and m by which vehicles are smaller than recorded.
    first: First row of the part to do.
    end: End of that part.
"""

__all__ = ["replay", "run", "without_ego"]
