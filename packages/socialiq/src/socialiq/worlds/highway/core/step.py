"""Scenes of highway-env as the shell runs them: their kernels, and the compiled entry points."""

from __future__ import annotations

from typing import Any

from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.collisions import collide
from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.drivers import choose, control, drive, reset
from socialiq.worlds.highway.core.geometry import closest_lane, longitudinal, on_lane
from socialiq.worlds.highway.core.shell import RoadKernels, shell_of
from socialiq.worlds.highway.core.vehicle import advance
from socialiq.worlds.highway.network import EXIT


@kernel
def sub_step(episode, cars, road, settings):
    """Advance by a sub-step: decisions in the order of entry, motion, then collisions."""
    count = episode.vehicles
    control(cars[0], road)
    for slot in range(1, count):
        drive(cars, count, slot, road)
    for slot in range(count):
        car = cars[slot]
        car.timer += settings.dt
        advance(car, settings.dt)
        car.lane = closest_lane(road.lanes, car.x, car.y, car.heading, car.lane)
    contact, touched = episode.contact, episode.touched
    struck = collide(cars, count, len(cars), 0, settings.dt, 0.0, contact, touched)
    episode.contact, episode.touched = struck


@kernel
def _lane(car, road):
    return road.lanes[car.lane]


@kernel
def _kind(car, road):
    return road.lanes[car.lane].kind


@kernel
def _target_kind(car, road):
    return road.lanes[car.target_lane].kind


@kernel
def _coordinate(car, road):
    """Return the metres of the task up to a vehicle, by the first lane of its target road."""
    lane = road.lanes[car.target_lane]
    along = longitudinal(lane, car.x, car.y)
    return lane.before + along * (road.lanes[lane.first].length / lane.length)


@kernel
def _same_origin(_cars, slot, ego, road):
    roads, entries = road.lanes, road.entries
    return roads[entries[slot].lane].road == roads[entries[ego].lane].road


@kernel
def _arrived(ego, road):
    lane = road.lanes[ego.lane]
    return lane.kind == EXIT and longitudinal(lane, ego.x, ego.y) > road.sight[0].arrival


@kernel
def _sight(road):
    return road.sight[0]


@kernel
def _choose(cars, _episode, action, road, settings):
    choose(cars[0], action, road, settings)


@kernel
def _renew(_episode, _cars, _road, _settings):
    """Leave the vehicles as they are."""


@kernel
def _records(_count, cars):
    return len(cars)


_carry_out = shell_of(
    RoadKernels(
        lane=_lane,
        kind=_kind,
        target_kind=_target_kind,
        coordinate=_coordinate,
        same_origin=_same_origin,
        arrived=_arrived,
        sight=_sight,
        choose=_choose,
        sub_step=sub_step,
        renew=_renew,
        reset=reset,
        records=_records,
    )
).carry_out


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, road, first, end):
        for row in range(first, end):
            if seeded[row]:
                stream.seed(buffers.episodes[row], entropy[row])
            _carry_out(buffers, row, commands[row], actions[row], road, options[0])
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


run: Any = _entry(fingerprint())
"""Carry out a command for every episode of a batch.

Args:
    buffers: Arrays read and written, `state.Buffers`.
    commands: One of `state`'s commands for each episode, int8.
    entropy: Seed of each episode's stream, uint64.
    seeded: Whether to begin the stream from that seed, bool.
    actions: The ego's actions, int64.
    options: SETTINGS record in an array of one.
    road: Tables of the scene, `scene.Road`.
    first: First episode of the part to do.
    end: End of that part.
"""


def _off_road_entry(sources: int):
    @entry_point
    def run(lanes, vehicles, present, off_road, first, end):
        for row in range(first, end):
            ego = vehicles[row, present[row, 1]]
            off_road[row] = not on_lane(lanes[ego.lane], ego.x, ego.y, 0.0)
        return sources

    return run


off_road: Any = _off_road_entry(fingerprint())
"""Write whether each ego's centre is beyond its closest lane, on any road.

Args:
    lanes: Records of the road's lanes.
    vehicles: Records of vehicles, (batch, capacity).
    present: Number of vehicles and the ego's slot, (batch, 2).
    off_road: Overwritten, bool (batch,).
    first: First episode of the part to do.
    end: End of that part.
"""
