"""Effects of the ego at a recorded junction: its episode with it and without it, to a common end.

Later vehicles enter where and when they were recorded, and drivers draw nothing after they entered:
both worlds have the same traffic. A vehicle's metres end with its recorded way.
"""

from __future__ import annotations

import collections
import math
from typing import Any

import numpy as np

from socialiq.evaluation.effects import LONGEST_GAP, MOVED
from socialiq.types import Ending
from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel, run_in_parts
from socialiq.worlds.highway.core.effects import HARD, encounter
from socialiq.worlds.highway.effects import RELATIONS
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.world import Actor
from socialiq_recordings.world import traffic as rules
from socialiq_recordings.world.core import reset, sub_step
from socialiq_recordings.world.gym import JunctionBatch, Traffic
from socialiq_recordings.world.observation import overlap, place_of
from socialiq_recordings.world.traffic import DT, GONE, WAITING

_ARRIVED, _COLLIDED = int(Ending.ARRIVAL), int(Ending.COLLISION)
_SAME_APPROACH, _SAME_EXIT, _CROSSING = range(len(RELATIONS))

Episodes = collections.namedtuple("Episodes", "seeds levels until ending")
"""Driven episodes: seed, level of each decision in m/s², sub-steps and kind of its end."""

_End = collections.namedtuple("_End", "steps frames tow released fastest slack")

Tally = collections.namedtuple("Tally", "place relation braking gap encounter")
"""Of each episode: coordinates of others at the end, m, NaN for the ego and for those that had gone
before; their places in `RELATIONS`; hard brakings; sub-steps of the least gap; encounters."""

_Mover = collections.namedtuple("_Mover", "x y along_x along_y speed")


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
def _mover(road, traffic, row, base, vehicle):
    along = traffic.along[row, vehicle]
    x, y, heading = place_of(road.line_first, road.line, base + vehicle, along)
    return _Mover(x, y, math.cos(heading), math.sin(heading), traffic.speed[row, vehicle])


@kernel
def _struck(road, traffic, row, base, ego, slack):
    """Return the vehicle that the ego overlaps, the ego if there is none."""
    for slot in range(traffic.n_present[row]):
        vehicle = traffic.present[row, slot]
        at, there = traffic.along[row, ego], traffic.along[row, vehicle]
        if vehicle != ego and overlap(road, base + ego, at, base + vehicle, there, slack)[0]:
            return vehicle
    return ego


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
def _look(road, traffic, row, base, pairs, ego, step, driving, times):
    """Note who is in an area with the ego's way; return the closest predicted encounter."""
    closest = 0.0
    half = 0.5 * road.length[base + ego]
    for slot in range(traffic.n_present[row]):
        vehicle = traffic.present[row, slot]
        area = road.area_of[pairs + vehicle]
        if vehicle == ego or area < 0:
            continue
        along, side = traffic.along[row, vehicle], 0.5 * road.length[base + vehicle]
        if road.area[area, 2] - side < along < road.area[area, 3] + side:
            _note(times, vehicle, 2, step)
        if driving:
            movers = [_mover(road, traffic, row, base, number) for number in (ego, vehicle)]
            closest = max(closest, encounter(movers[0], movers[1]))
    if driving:
        along = traffic.along[row, ego]
        for vehicle in range(len(times)):
            area = road.area_of[pairs + vehicle]
            if area >= 0 and road.area[area, 0] - half < along < road.area[area, 1] + half:
                _note(times, vehicle, 0, step)
    return closest


@kernel
def _drive(road, traffic, row, episodes, with_ego, end, tally):
    """Drive an episode to the common end. A collision stops both, until they are towed."""
    recording, ego = traffic.recording[row], traffic.ego[row]
    base = road.recording_first[recording]
    count = road.recording_first[recording + 1] - base
    pairs, until, towed = road.pair_first[recording] + ego * count, episodes.until[row], -1
    struck, wrecks, ended = ego, (0.0, 0.0), episodes.ending[row]
    times, hardest = np.full((count, 4), -1), np.zeros(count)
    before, gone = np.empty(count), traffic.status[row, :count] == GONE
    if not with_ego:
        _remove(traffic, row, ego)
        traffic.ego[row], until = -1, -1
    for step in range(end.steps):
        if step == until and ended == _COLLIDED:
            struck, towed = _struck(road, traffic, row, base, ego, end.slack), step + end.tow
            wrecks = traffic.along[row, ego], traffic.along[row, struck]
        elif step == until:
            traffic.ego[row] = -1  # it drives on as traffic
            if ended == _ARRIVED or not end.released:
                _remove(traffic, row, ego)
        if step == towed:
            _remove(traffic, row, ego)
            _remove(traffic, row, struck)
        level = episodes.levels[row, step // end.frames] if step < until else math.nan
        before[:] = np.nan
        for slot in range(traffic.n_present[row]):
            before[traffic.present[row, slot]] = traffic.speed[row, traffic.present[row, slot]]
        sub_step(road, traffic, row, base, count, level, end.fastest)
        if until <= step < towed:
            traffic.along[row, ego], traffic.along[row, struck] = wrecks
            traffic.speed[row, ego] = traffic.speed[row, struck] = 0.0
            before[struck] = np.nan
        for vehicle in range(count):
            if vehicle != ego and traffic.status[row, vehicle] != WAITING:
                change = (traffic.speed[row, vehicle] - before[vehicle]) / DT
                hardest[vehicle] = min(hardest[vehicle], 0.0 if math.isnan(change) else change)
        if with_ego:
            driving = step < until
            close = _look(road, traffic, row, base, pairs, ego, step, driving, times)
            decision = step // end.frames
            tally.encounter[row, decision] = max(tally.encounter[row, decision], close)
        if (step + 1) % end.frames == 0:
            tally.braking[row] += (hardest < HARD).sum()
            hardest[:] = 0.0
    for vehicle in range(count):
        if vehicle == ego or gone[vehicle]:
            continue
        place = road.line_first[base + vehicle + 1] - road.line_first[base + vehicle] - 2.0
        if traffic.status[row, vehicle] == WAITING:
            place = road.state[road.state_first[base + vehicle], 0]
        tally.place[row, vehicle] = min(traffic.along[row, vehicle], place)
        pair, back = pairs + vehicle, road.pair_first[recording] + vehicle * count + ego
        tally.relation[row, vehicle] = _relation(road, pair, back)
        entered, left, they_entered, they_left = times[vehicle]
        if min(entered, they_entered) >= 0:
            apart = max(they_entered - left - 1, entered - they_left - 1, 0)
            tally.gap[row] = min(tally.gap[row], apart)


def _entry(sources: int) -> Any:
    @entry_point
    def run(road, traffic, episodes, with_ego, end, tally, first, last):
        for row in range(first, last):
            traffic.seed[row] = rules.hashed(episodes.seeds[row])
            reset(road, traffic, row)
            _drive(road, traffic, row, episodes, with_ego, end, tally)
        return sources

    return run


_run = _entry(fingerprint(__file__))


def caused(batch: JunctionBatch, actor: Actor, seeds: np.ndarray) -> dict[str, np.ndarray]:
    """Drive episodes, and return the columns of `Effects` that need no branches."""
    world, options, effects = batch.world, batch.options, batch.world.effects
    assert effects is not None
    rows, frames = np.arange(len(seeds)), options.frames
    batch.reset(seeds)
    actor.begin(rows, seeds)
    levels = np.full((len(seeds), options.decisions), np.nan)
    sums = {name: np.zeros(len(seeds)) for name in ("env", "eq_4_2")}
    ending, contact = np.zeros(len(seeds), np.int64), np.zeros(len(seeds), np.int64)
    running, number = np.ones(len(seeds), bool), 0
    while running.any():
        action = np.broadcast_to(actor.decide(batch.observation, running), len(seeds))
        levels[running, number] = batch.levels[action[running]]
        decisions = batch.step(action, auto_reset=False, rows=running)
        sums["env"] += np.where(running, decisions.rewards.env, 0.0)
        sums["eq_4_2"] += np.where(running, decisions.rewards.social, 0.0)
        ending[running], contact[running] = decisions.ending[running], decisions.contact[running]
        running &= decisions.ending == int(Ending.NONE)
        number += 1
    until = batch.traffic.step - batch.traffic.begun
    episodes = Episodes(np.asarray(seeds, np.uint64), levels, until, ending)
    steps, tow = effects.decisions(options) * frames, round(effects.tow_after / DT)
    released = effects.after_timeout == "traffic"
    end = _End(steps, frames, tow or steps, released, world.max_speed, world.config.slack)
    driven, alone = (_driven(batch, episodes, with_ego, end) for with_ego in (True, False))
    lost = np.nan_to_num(alone.place - driven.place)
    kinds = driven.relation[..., None] == np.arange(len(RELATIONS))
    delay, braking = (lost[..., None] * kinds).sum(axis=1), driven.braking - alone.braking
    social = effects.delay_weight * delay.sum(axis=1) + effects.braking_weight * braking
    social += effects.encounter_weight * driven.encounter.sum(axis=1)
    social += effects.caused_collision_weight * (ending == _COLLIDED)
    gap = driven.gap * DT
    return {
        **sums,
        "social": social,
        "ending": ending,
        "at_fault": contact == int(Contact.EGO_STRUCK),
        "delay": delay,
        "braking": braking,
        "gap": np.where(gap > LONGEST_GAP, np.inf, gap),
        "helped": (lost <= -MOVED).sum(axis=1),
        "harmed": (lost >= MOVED).sum(axis=1),
    }


def _driven(batch: JunctionBatch, episodes: Episodes, with_ego: bool, end: _End) -> Tally:
    """Return what is counted in episodes that are driven again from their seeds."""
    world, size = batch.world, len(episodes.seeds)
    place, encounters = np.full((size, world.capacity), np.nan), end.steps // end.frames
    relation, gap = np.full(place.shape, -1), np.full(size, np.inf)
    tally = Tally(place, relation, np.zeros(size), gap, np.zeros((size, encounters)))
    run_in_parts(_run, 1, size, world.road, Traffic.of(world, size), episodes, with_ego, end, tally)
    return tally
