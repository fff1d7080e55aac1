"""One decision of every episode of a batch, and the compiled entry point of all scenes."""

from __future__ import annotations

from typing import Any

from socialiq.types import Ending
from socialiq.worlds.highway.core import rewards, seen, stream
from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.contact import collide
from socialiq.worlds.highway.core.drivers import choose, control, drive
from socialiq.worlds.highway.core.lanes import closest_lane
from socialiq.worlds.highway.core.start import reset
from socialiq.worlds.highway.core.vehicle import advance
from socialiq.worlds.highway.state import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Contact

_NOTHING = int(Ending.NONE)
_NO_CONTACT = int(Contact.NONE)


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
    found = collide(cars, count, settings.dt, episode.contact, episode.touched)
    episode.contact, episode.touched = found


@kernel
def _copy(cars, target):
    for slot in range(len(cars)):
        target[slot] = cars[slot]


@kernel
def decide(buffers, row, action, road, settings):
    """Run the sub-steps of one decision; write snapshots before and after them."""
    episode, cars = buffers.episodes[row], buffers.vehicles[row]
    _copy(cars, buffers.before[row])
    episode.time += settings.decision
    choose(cars[0], action, road, settings)
    for frame in range(settings.frames):
        sub_step(episode, cars, road, settings)
        if len(buffers.trace):
            _copy(cars, buffers.trace[row, frame])
    _copy(cars, buffers.after[row])
    buffers.present[row, 0], buffers.present[row, 1] = episode.vehicles, 0


@kernel
def annotate(buffers, row, road, settings):
    """Write observation, ending, signals and rewards of a decision from its two snapshots."""
    episode, before, after = buffers.episodes[row], buffers.before[row], buffers.after[row]
    count, ego = episode.vehicles, after[0]
    seen.observe(after, road, buffers.reached[row])
    ending = seen.ending_of(ego, road, episode.time >= settings.duration)
    signals, start, braking = buffers.signals[row], episode.start, buffers.braking[row]
    seen.write_signals(before, after, count, start, ending, road, settings, signals, braking)
    r_env, r_social = rewards.pair(signals, settings)
    buffers.rewards[row, 0], buffers.rewards[row, 1] = r_env, r_social
    own, others = seen.classical(before, after, count, road, settings)
    buffers.classical[row, 0], buffers.classical[row, 1] = own, others
    buffers.speed[row] = ego.speed
    buffers.ending[row] = ending
    buffers.contact[row] = episode.contact if ego.crashed else _NO_CONTACT
    touched = episode.touched if ego.crashed else -1
    crashed = rewards.neighbours_collided(before, after, count, 0, touched)
    buffers.neighbours_collided[row] = crashed
    return ending


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, road, first, end):
        settings = options[0]
        for row in range(first, end):
            episode, cars = buffers.episodes[row], buffers.vehicles[row]
            if seeded[row]:
                stream.seed(episode, entropy[row])
            command, ending = commands[row], _NOTHING
            if command == SKIP:
                continue
            if command in (DECIDE, DECIDE_AND_RESET):
                decide(buffers, row, actions[row], road, settings)
                ending = annotate(buffers, row, road, settings)
                buffers.observation[row] = buffers.reached[row]
            if command == RESET or (command == DECIDE_AND_RESET and ending != _NOTHING):
                reset(episode, cars, road, settings)
                episode.start = seen.coordinate(cars[0], road)
                seen.observe(cars, road, buffers.observation[row])
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
