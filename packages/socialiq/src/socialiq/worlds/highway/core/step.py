"""One decision of an episode of any road, and the entry points of the core."""

import math
from typing import Any

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core import drivers, rewards, stream, traffic
from socialiq.worlds.highway.core import people as people_kernels
from socialiq.worlds.highway.core.compile import (
    allocating_entry_point,
    allocating_kernel,
    entry_point,
    fingerprint,
    kernel,
)
from socialiq.worlds.highway.core.effects import carry_out as carry_out_effects
from socialiq.worlds.highway.core.geometry import distance, longitudinal, on_lane
from socialiq.worlds.highway.options import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Contact

_NO_ENDING = int(Ending.NONE)
_COLLIDED = int(Ending.COLLISION)
_NO_CONTACT = int(Contact.NONE)


@kernel
def _copy(vehicles, count, road, target):
    """Copy so many vehicles and the obstacles behind them."""
    for slot in range(count + len(road.obstacles)):
        target[slot] = vehicles[slot]


@allocating_kernel
def _observe(vehicles, count, slot_of_agent, people, road, settings, observation):
    """Write an agent's observation of so many vehicles, obstacles, and people."""
    agent = vehicles[slot_of_agent]
    records = count + len(road.obstacles)
    along = np.empty(records)
    lane = road.lanes[agent.lane]
    turn = 1.0, 0.0
    if settings.own_frame:
        turn = road.frames[agent.origin, 0], road.frames[agent.origin, 1]
    for slot in range(records):
        along[slot] = longitudinal(lane, vehicles[slot].x, vehicles[slot].y)
    sight = road.sight[0]
    rows = settings.vehicle_rows, settings.shows_behind
    view = along, settings.tie, sight, turn, rows
    rewards.observe(vehicles, records, slot_of_agent, view, observation)
    if len(people):
        people_kernels.observe(people, agent, sight, turn, settings, observation)


@kernel
def _depart(episode, vehicles, road):
    """Remove wrecks, and agents that have arrived."""
    for slot in range(episode.vehicles - 1, -1, -1):
        number = vehicles[slot].agent
        if vehicles[slot].crashed or (number >= 0 and episode.ended[number] != _NO_ENDING):
            traffic.remove(episode, vehicles, slot, road)


@kernel
def _carry_out(buffers, row, command, actions, road, settings):
    if command == SKIP:
        return
    episode = buffers.episodes[row]
    vehicles = buffers.vehicles[row]
    ended = False
    deciding = command in (DECIDE, DECIDE_AND_RESET)
    if deciding:
        _decide(buffers, row, actions, road, settings)
    if command != RESET:
        ended = _annotate(buffers, row, road, settings)
        # Assigning whole arrays compiles NumPy's broadcasting and its messages, for seconds.
        for result in range(row * settings.agents, (row + 1) * settings.agents):
            for slot in range(buffers.reached.shape[1]):
                for feature in range(buffers.reached.shape[2]):
                    reached = buffers.reached[result, slot, feature]
                    buffers.observation[result, slot, feature] = reached
    if deciding:
        if settings.each:
            _depart(episode, vehicles, road)
        traffic.renew(episode, vehicles, road, settings)
    if command == RESET or (command == DECIDE_AND_RESET and ended):
        _begin(buffers, row, road, settings)


@kernel
def _decide(buffers, row, actions, road, settings):
    """Run the sub-steps of one decision; write snapshots before and after them.

    Args:
        buffers: Arrays of the batch, which are written.
        row: Row of the episode.
        actions: Actions of all agents of the batch.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    episode = buffers.episodes[row]
    vehicles = buffers.vehicles[row]
    people = buffers.people[row]
    _copy(vehicles, episode.vehicles, road, buffers.before[row])
    episode.time += settings.decision
    for number in range(settings.agents):
        slot = episode.controlled[number]
        if slot >= 0:
            action = actions[row * settings.agents + number]
            drivers.choose(vehicles[slot], action, road, settings)
    for frame in range(settings.frames):
        traffic.sub_step(episode, vehicles, people, buffers.influences[row], road, settings)
        if len(buffers.trace):
            _copy(vehicles, episode.vehicles, road, buffers.trace[row, frame])
            for number in range(len(people)):
                buffers.people_trace[row, frame, number] = people[number]
    _copy(vehicles, episode.vehicles, road, buffers.after[row])
    buffers.present[row, 0] = episode.vehicles
    for number in range(settings.agents):
        buffers.present[row, 1 + number] = episode.controlled[number]


@kernel
def _begin(buffers, row, road, settings):
    """Start an episode."""
    episode = buffers.episodes[row]
    vehicles = buffers.vehicles[row]
    people = buffers.people[row]
    for number in range(settings.agents):
        episode.controlled[number] = -1
        episode.ended[number] = _NO_ENDING
        episode.contact[number] = _NO_CONTACT
        episode.touched[number] = -1
    traffic.reset(episode, vehicles, people, buffers.influences[row], road, settings)
    for number in range(settings.agents):
        slot = episode.controlled[number]
        result = row * settings.agents + number
        episode.start[number] = drivers.coordinate(vehicles[slot], road)
        observation = buffers.observation[result]
        _observe(vehicles, episode.vehicles, slot, people, road, settings, observation)


@kernel
def _clear(buffers, result):
    """Write the results of an agent that has left."""
    for slot in range(buffers.reached.shape[1]):
        for feature in range(buffers.reached.shape[2]):
            buffers.reached[result, slot, feature] = 0.0
    for slot in range(buffers.braking.shape[1]):
        buffers.braking[result, slot] = False
    for signal in range(buffers.signals.shape[1]):
        buffers.signals[result, signal] = 0.0
    for side in range(2):
        buffers.rewards[result, side] = 0.0
        buffers.classical[result, side] = 0.0
    buffers.speed[result] = 0.0
    buffers.contact[result] = _NO_CONTACT
    buffers.neighbours_collided[result] = 0


@kernel
def _is_on_road(vehicle, lanes):
    return on_lane(lanes[vehicle.lane], vehicle.x, vehicle.y, 0.0)


@allocating_kernel
def _write_signals(before, after, count, slot_of_agent, start, ending, road, settings, row):
    """Write the signals of an agent's decision, and which braking was charged to it."""
    signals, braking = row
    ego = after[slot_of_agent]
    reached = drivers.coordinate(ego, road)
    earlier = before[slot_of_agent]
    advanced = reached - drivers.coordinate(earlier, road)
    if math.isnan(advanced):  # elsewhere than on the task's way
        advanced = distance(ego.x, ego.y, earlier.x, earlier.y)
    on_road = _is_on_road(ego, road.lanes)
    rewards.env_signals(advanced, on_road, ego.speed, ending, settings, signals)
    lane = road.lanes[ego.lane]
    along = longitudinal(lane, ego.x, ego.y)
    travelled = reached - start
    within = rewards.in_zone(lane.kind, along, lane.length, travelled, settings)
    counted = np.empty(count, np.bool_)
    lost = np.empty(count)
    for slot in range(count):
        vehicle = after[slot]
        apart = distance(vehicle.x, vehicle.y, ego.x, ego.y)
        same = vehicle.origin == ego.origin
        counts = rewards.counts(apart, same, road.lanes[vehicle.target_lane].kind, settings)
        counted[slot] = slot != slot_of_agent and counts
        lost[slot] = before[slot].speed - vehicle.speed
    rewards.social_signals(ego.speed, within, counted, lost, ending, settings, signals, braking)


@kernel
def _annotate_agent(buffers, row, number, result, on_road, road, settings):
    """Write an agent's results, and return its ending; after the ending all signals are 0."""
    episode = buffers.episodes[row]
    before = buffers.before[row]
    after = buffers.after[row]
    count = buffers.present[row, 0]
    slot = buffers.present[row, 1 + number]
    earlier = episode.ended[number]
    if slot < 0:
        _clear(buffers, result)
        return earlier
    ego = after[slot]
    reached = buffers.reached[result]
    _observe(after, count, slot, buffers.people[row], road, settings, reached)
    left = settings.offroad_terminal and not on_road[slot]
    late = episode.time >= settings.duration
    ending = rewards.ending_of(ego.crashed, left, drivers.arrived(ego, road), late)
    signals = buffers.signals[result]
    start = episode.start[number]
    written = signals, buffers.braking[result]
    _write_signals(before, after, count, slot, start, ending, road, settings, written)
    if earlier == _NO_ENDING:
        episode.ended[number] = ending
    else:
        for signal in range(len(signals)):
            signals[signal] = 0.0
    r_env, r_social = rewards.pair(signals, settings)
    buffers.rewards[result, 0] = r_env
    buffers.rewards[result, 1] = r_social
    ego_reward, neighbours = rewards.classical(before, after, on_road, count, slot, settings)
    buffers.classical[result, 0] = ego_reward
    buffers.classical[result, 1] = neighbours
    buffers.speed[result] = ego.speed
    buffers.contact[result] = episode.contact[number] if ego.crashed else _NO_CONTACT
    touched = episode.touched[number] if ego.crashed else -1
    crashed = rewards.neighbours_collided(before, after, count, slot, touched)
    buffers.neighbours_collided[result] = crashed
    return ending


@allocating_kernel
def _annotate(buffers, row, road, settings):
    """Write the results of all agents, and return whether the episode has ended."""
    after = buffers.after[row]
    count = buffers.present[row, 0]
    on_road = np.empty(count, np.bool_)
    for slot in range(count):
        on_road[slot] = _is_on_road(after[slot], road.lanes)
    driving = 0
    crashed = False
    for number in range(settings.agents):
        result = row * settings.agents + number
        ending = _annotate_agent(buffers, row, number, result, on_road, road, settings)
        buffers.ending[result] = ending
        driving += ending == _NO_ENDING
        crashed |= ending == _COLLIDED
    return driving == 0 or (crashed and not settings.each)


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, road, first, end):
        for row in range(first, end):
            if seeded[row]:
                stream.seed(buffers.episodes[row], entropy[row])
            _carry_out(buffers, row, commands[row], actions, road, options[0])
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


def _effects_entry(sources: int):
    @entry_point
    def run(command, buffers, ledger, rows, options, road, record, first, end):
        for row in range(first, end):
            if rows[row]:
                carry_out_effects(command, buffers, ledger, row, road, options[0], record[0])
        return sources

    return run


run: Any = _entry(fingerprint())
"""Carry out a command for every episode of a batch.

Args:
    buffers: Arrays read and written, `options.Buffers`.
    commands: One of `options`' commands for each episode, int8.
    entropy: Seed of each episode's stream, uint64; it begins where `seeded`, bool.
    actions: The agents' actions, int64. Continuous ones are held in their records instead.
    options: SETTINGS record in an array of one.
    road: Tables of the road, `scenes.Road`.
    first: First episode of the part to do, up to `end`.
"""


effects: Any = _effects_entry(fingerprint())
"""Carry out a command of `core.effects` for some rows of a traced batch, bool (batch,).

Ledger and record are of `highway.effects`; the other arguments are those of `run`.
"""


def _off_road_entry(sources: int):
    @entry_point
    def run(lanes, vehicles, present, off_road, first, end):
        for row in range(first, end):
            for number in range(present.shape[1] - 1):
                slot = present[row, 1 + number]
                left = False
                if slot >= 0:
                    car = vehicles[row, slot]
                    left = not on_lane(lanes[car.lane], car.x, car.y, 0.0)
                off_road[row, number] = left
        return sources

    return run


off_road: Any = _off_road_entry(fingerprint())
"""Write whether each agent is beyond its closest lane, on any road, bool (batch, agents)."""


def _choices_entry(sources: int):
    @allocating_entry_point
    def run(vehicles, slots, options, road, speeds, lanes, first, end):
        agent = np.empty(1, vehicles.dtype)
        for row in range(first, end):
            for number in range(slots.shape[1]):
                for action in range(speeds.shape[2]):
                    speeds[row, number, action] = 0.0
                    lanes[row, number, action] = 0
                    if slots[row, number] < 0:
                        continue
                    agent[0] = vehicles[row, slots[row, number]]
                    drivers.choose(agent[0], action, road, options[0])
                    speeds[row, number, action] = agent[0].target_speed
                    lanes[row, number, action] = agent[0].target_lane
        return sources

    return run


choices: Any = _choices_entry(fingerprint())
"""Write the target speed, m/s, and the target lane that each action would select.

Args:
    vehicles: Records of vehicles, (row, slot).
    slots: Slot of each agent, -1 if it has left, (row, agent).
    options: SETTINGS record in an array of one.
    road: Tables of the road.
    speeds: Target speeds that are written, (row, agent, action); 0 of agents that have left.
    lanes: Target lanes that are written, (row, agent, action).
    first: First row of the part to do, up to `end`.
"""
