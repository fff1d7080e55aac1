"""One decision of an episode of any road: the kernels that all compiled roads share.

A road gives its own kernels as `RoadKernels`; its entry point calls `carry_out` for every episode
of a batch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core import rewards
from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import distance, longitudinal, on_lane
from socialiq.worlds.highway.core.rewards import observe
from socialiq.worlds.highway.state import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Contact

_NOTHING = int(Ending.NONE)
_NO_CONTACT = int(Contact.NONE)


class RoadKernels(NamedTuple):
    """Kernels by which a road differs from others; `road` is its tables.

    Attributes:
        lane: (vehicle, road) -> record of its closest lane.
        kind: (vehicle, road) -> kind of that lane: APPROACH, EXIT, or another.
        target_kind: (vehicle, road) -> kind of the lane that it steers along.
        coordinate: (vehicle, road) -> its metres along the task.
        same_origin: (vehicles, slot, ego, road) -> whether it entered by the ego's approach.
        arrived: (vehicle, road) -> whether it has arrived.
        sight: (road) -> SIGHT record.
        choose: (vehicles, episode, action, road, settings): begin an action of the ego.
        sub_step: (episode, vehicles, road, settings): advance all by a sub-step.
        renew: (episode, vehicles, road, settings): remove and add vehicles after a decision.
        reset: (episode, vehicles, road, settings): start an episode from its stream.
        records: (episode, vehicles) -> number of records in use, obstacles among them.
    """

    lane: Callable[..., Any]
    kind: Callable[..., Any]
    target_kind: Callable[..., Any]
    coordinate: Callable[..., Any]
    same_origin: Callable[..., Any]
    arrived: Callable[..., Any]
    sight: Callable[..., Any]
    choose: Callable[..., Any]
    sub_step: Callable[..., Any]
    renew: Callable[..., Any]
    reset: Callable[..., Any]
    records: Callable[..., Any]


class Shell(NamedTuple):
    """Kernels of a road's decisions.

    Attributes:
        annotate: (buffers, row, road, settings) -> ending of a decision, from its two snapshots.
        carry_out: (buffers, row, command, action, road, settings): do one command.
    """

    annotate: Callable[..., Any]
    carry_out: Callable[..., Any]


@kernel
def _copy(vehicles, count, target):
    for slot in range(count):
        target[slot] = vehicles[slot]


@kernel
def _copy_rows(source, target):
    # An assignment of whole arrays compiles NumPy's broadcasting and its messages, for seconds.
    for row in range(source.shape[0]):
        for column in range(source.shape[1]):
            target[row, column] = source[row, column]


def shell_of(road_kernels: RoadKernels) -> Shell:
    """Return the kernels of a road's decisions."""
    lane_of, kind_of, target_kind, coordinate, same_origin, arrived, sight, *running = road_kernels
    choose, sub_step, renew, reset, records = running

    @kernel
    def see(vehicles, count, ego, road, settings, observation):
        """Write the observation; coordinates are measured along the ego's lane."""
        lane = lane_of(vehicles[ego], road)
        along = np.empty(count)
        for slot in range(count):
            along[slot] = longitudinal(lane, vehicles[slot].x, vehicles[slot].y)
        observe(vehicles, count, ego, along, settings.tie, sight(road), observation)

    @kernel
    def on_road(vehicle, road):
        return on_lane(lane_of(vehicle, road), vehicle.x, vehicle.y, 0.0)

    @kernel
    def write_signals(before, after, count, slot_of_ego, start, ending, road, settings, row):
        """Write all signals of a decision, and which braking is charged to the ego (`rewards`)."""
        signals, braking = row
        ego = after[slot_of_ego]
        reached = coordinate(ego, road)
        advance = reached - coordinate(before[slot_of_ego], road)
        rewards.env_signals(advance, on_road(ego, road), ego.speed, ending, settings, signals)
        lane = lane_of(ego, road)
        along = longitudinal(lane, ego.x, ego.y)
        kind = kind_of(ego, road)
        within = rewards.in_zone(kind, along, lane.length, reached - start, settings)
        counted, lost = np.empty(count, np.bool_), np.empty(count)
        for slot in range(count):
            vehicle = after[slot]
            apart = distance(vehicle.x, vehicle.y, ego.x, ego.y)
            same = same_origin(after, slot, slot_of_ego, road)
            counts = rewards.counts(apart, same, target_kind(vehicle, road), settings)
            counted[slot] = slot != slot_of_ego and counts
            lost[slot] = before[slot].speed - vehicle.speed
        rewards.social_signals(ego.speed, within, counted, lost, ending, settings, signals, braking)

    @kernel
    def annotate(buffers, row, road, settings):
        """Write observation, ending, signals and rewards of a decision from its two snapshots."""
        episode, before, after = buffers.episodes[row], buffers.before[row], buffers.after[row]
        count, slot = buffers.present[row, 0], buffers.present[row, 1]
        ego = after[slot]
        see(after, records(count, after), slot, road, settings, buffers.reached[row])
        left = settings.offroad_terminal and not on_road(ego, road)
        late = episode.time >= settings.duration
        ending = rewards.ending_of(ego.crashed, left, arrived(ego, road), late)
        signals = buffers.signals[row]
        written = signals, buffers.braking[row]
        write_signals(before, after, count, slot, episode.start, ending, road, settings, written)
        r_env, r_social = rewards.pair(signals, settings)
        buffers.rewards[row, 0], buffers.rewards[row, 1] = r_env, r_social
        there = np.empty(count, np.bool_)
        for number in range(count):
            there[number] = on_road(after[number], road)
        ego_reward, neighbours = rewards.classical(before, after, there, count, slot, settings)
        buffers.classical[row, 0], buffers.classical[row, 1] = ego_reward, neighbours
        buffers.speed[row] = ego.speed
        buffers.ending[row] = ending
        buffers.contact[row] = episode.contact if ego.crashed else _NO_CONTACT
        touched = episode.touched if ego.crashed else -1
        crashed = rewards.neighbours_collided(before, after, count, slot, touched)
        buffers.neighbours_collided[row] = crashed
        return ending

    @kernel
    def decide(buffers, row, action, road, settings):
        """Run the sub-steps of one decision; write snapshots before and after them."""
        episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
        _copy(vehicles, records(episode.vehicles, vehicles), buffers.before[row])
        episode.time += settings.decision
        choose(vehicles, episode, action, road, settings)
        for frame in range(settings.frames):
            sub_step(episode, vehicles, road, settings)
            if len(buffers.trace):
                _copy(vehicles, records(episode.vehicles, vehicles), buffers.trace[row, frame])
        _copy(vehicles, records(episode.vehicles, vehicles), buffers.after[row])
        buffers.present[row, 0], buffers.present[row, 1] = episode.vehicles, episode.ego

    @kernel
    def carry_out(buffers, row, command, action, road, settings):
        """Carry out one of `state`'s commands for one episode, whose stream is seeded."""
        if command == SKIP:
            return
        episode, vehicles, ending = buffers.episodes[row], buffers.vehicles[row], _NOTHING
        deciding = command in (DECIDE, DECIDE_AND_RESET)
        if deciding:
            decide(buffers, row, action, road, settings)
        if command != RESET:
            ending = annotate(buffers, row, road, settings)
            _copy_rows(buffers.reached[row], buffers.observation[row])
        if deciding:
            renew(episode, vehicles, road, settings)
        if command == RESET or (command == DECIDE_AND_RESET and ending != _NOTHING):
            reset(episode, vehicles, road, settings)
            episode.start = coordinate(vehicles[episode.ego], road)
            count = records(episode.vehicles, vehicles)
            see(vehicles, count, episode.ego, road, settings, buffers.observation[row])

    return Shell(annotate, carry_out)
