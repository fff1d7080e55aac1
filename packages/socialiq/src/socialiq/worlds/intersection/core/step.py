"""The intersection as the shell runs it: its kernels, and the compiled entry point."""

from __future__ import annotations

from typing import Any

from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.collisions import collide
from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel, run_in_parts
from socialiq.worlds.highway.core.shell import RoadKernels, shell_of
from socialiq.worlds.highway.state import Buffers, Contact
from socialiq.worlds.intersection.core import spawn, traffic
from socialiq.worlds.intersection.core.geometry import LANES
from socialiq.worlds.intersection.core.traffic import enforce
from socialiq.worlds.intersection.state import SIGHT

_NO_CONTACT = int(Contact.NONE)


@kernel
def sub_step(episode, vehicles, _road, settings):
    """Advance by a sub-step: decisions, road rules if due, motion, then collisions."""
    count, ego = episode.vehicles, episode.ego
    for slot in range(count):
        if slot != ego:
            traffic.drive(vehicles, count, slot, settings)
        elif not settings.continuous:  # else the record holds the command
            traffic.control(vehicles[slot])
    episode.sub_steps += 1
    if episode.sub_steps % settings.rule_period == 0:
        enforce(vehicles, count, ego, settings)
    for slot in range(count):
        traffic.move(vehicles[slot], settings.dt, settings.tie)
    contact, touched = episode.contact, episode.touched
    struck = collide(vehicles, count, count, ego, settings.dt, settings.tie, contact, touched)
    episode.contact, episode.touched = struck


@kernel
def _reset(episode, vehicles, road, settings):
    """Start an episode from the current state of the stream."""
    episode.time = 0.0
    episode.sub_steps = 0
    episode.vehicles = 0
    episode.ego = -1
    episode.next_identity = 0
    episode.contact = _NO_CONTACT
    episode.touched = -1
    spawn.fill(episode, vehicles, settings)
    for _ in range(settings.warm_up):
        sub_step(episode, vehicles, road, settings)
    spawn.enter_ego(episode, vehicles, settings)


@kernel
def _choose(vehicles, episode, action, _road, settings):
    if not settings.continuous:
        traffic.choose(vehicles[episode.ego], action, settings)


@kernel
def _renew(episode, vehicles, _road, settings):
    spawn.clear(episode, vehicles)
    spawn.spawn(episode, vehicles, 0.0, 1.0, 1.0, settings.spawn_probability, False, settings)


@kernel
def _lane(vehicle, _road):
    return LANES[vehicle.lane]


@kernel
def _kind(vehicle, _road):
    return vehicle.lane % 5


@kernel
def _target_kind(vehicle, _road):
    return vehicle.target_lane % 5


@kernel
def _coordinate(vehicle, _road):
    return traffic.route_coordinate(vehicle)


@kernel
def _same_origin(vehicles, slot, ego, _road):
    return vehicles[slot].origin == vehicles[ego].origin


@kernel
def _arrived(vehicle, _road):
    return traffic.arrived(vehicle)


@kernel
def _sight(_road):
    return SIGHT[0]


@kernel
def _records(count, _vehicles):
    return count


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
        reset=_reset,
        records=_records,
    )
).carry_out


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, first, end):
        for row in range(first, end):
            if seeded[row]:
                stream.seed(buffers.episodes[row], entropy[row])
            _carry_out(buffers, row, commands[row], actions[row], 0, options[0])
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


run = _entry(fingerprint(__file__))
"""Carry out a command for every episode of a batch.

Args:
    buffers: Arrays read and written, `state.Buffers`.
    commands: One of `state`'s commands for each episode, int8.
    entropy: Seed of each episode's stream, uint64.
    seeded: Whether to begin the stream from that seed, bool.
    actions: The ego's actions, int64. Continuous ones are held in its record instead: steering
        and acceleration.
    options: SETTINGS record in an array of one.
    first: First episode of the part to do.
    end: End of that part.
"""


def on_threads(threads: int, buffers: Buffers, commands: Any, *arguments: Any) -> None:
    """Call `run` for all episodes on so many threads.

    Raises:
        UserError: If the machine has fewer.
    """
    run_in_parts(run, threads, len(commands), buffers, commands, *arguments)
