"""One decision of every episode of a batch, and the compiled entry point of all scenes."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from socialiq.types import Ending
from socialiq.worlds.highway.core import seen
from socialiq.worlds.highway.core.contact import collide
from socialiq.worlds.highway.core.drivers import choose, control, drive
from socialiq.worlds.highway.core.lanes import closest_lane
from socialiq.worlds.highway.core.start import reset
from socialiq.worlds.intersection.core import rewards, stream
from socialiq.worlds.intersection.core.compile import entry_point, fingerprint, kernel
from socialiq.worlds.intersection.core.traffic import advance
from socialiq.worlds.intersection.state import DECIDE, DECIDE_AND_RESET, RESET, SKIP

_NOTHING = int(Ending.NONE)


@kernel
def sub_step(cars, count, road, settings):
    """Advance by a sub-step: decisions in the order of entry, motion, then collisions."""
    control(cars[0], road)
    for slot in range(1, count):
        drive(cars, count, slot, road)
    for slot in range(count):
        car = cars[slot]
        car.timer += settings.dt
        advance(car, settings.dt)
        car.lane = closest_lane(road.lanes, car.x, car.y, car.heading, car.lane)
    collide(cars, count, settings.dt)


@kernel
def decide(buffers, row, action, road, settings):
    """Run the sub-steps of one decision; write observation, ending, signals and rewards."""
    episode, cars, before = buffers.episodes[row], buffers.cars[row], buffers.before[row]
    count = episode.vehicles
    for slot in range(len(cars)):
        before[slot] = cars[slot]
    episode.time += settings.decision
    choose(cars[0], action, road, settings)
    for _ in range(settings.frames):
        sub_step(cars, count, road, settings)
    seen.observe(cars, road, buffers.reached[row])
    ending = seen.ending_of(cars[0], road, episode.time >= settings.duration)
    signals, start, braking = buffers.signals[row], episode.start, buffers.braking[row]
    seen.write_signals(before, cars, count, start, ending, road, settings, signals, braking)
    r_env, r_social = rewards.pair(signals, settings)
    buffers.rewards[row, 0], buffers.rewards[row, 1] = r_env, r_social
    buffers.speed[row] = cars[0].speed
    buffers.ending[row] = ending
    return ending


def _sources() -> int:
    """Return a number that changes with any source of the compiled code; see `fingerprint`."""
    digest = hashlib.sha256(fingerprint().to_bytes(8, "big"))
    here = Path(__file__).parent
    for path in (*sorted(here.glob("*.py")), *sorted(here.parent.glob("*.py"))):
        digest.update(path.read_bytes())
    return int.from_bytes(digest.digest()[:7], "big")


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, road, first, end):
        settings = options[0]
        for row in range(first, end):
            episode, cars = buffers.episodes[row], buffers.cars[row]
            if seeded[row]:
                stream.seed(episode, entropy[row])
            command, ending = commands[row], _NOTHING
            if command == SKIP:
                continue
            if command in (DECIDE, DECIDE_AND_RESET):
                ending = decide(buffers, row, actions[row], road, settings)
                buffers.observation[row] = buffers.reached[row]
            if command == RESET or (command == DECIDE_AND_RESET and ending != _NOTHING):
                reset(episode, cars, road, settings)
                episode.start = seen.coordinate(cars[0], road)
                seen.observe(cars, road, buffers.observation[row])
        return sources  # so that the cache depends on the sources

    return run


run: Any = _entry(_sources())
"""Carry out a command for every episode of a batch.

Args:
    buffers: Arrays read and written, `state.Buffers`.
    commands: One of the intersection's commands for each episode, int8.
    entropy: Seed of each episode's stream, uint64.
    seeded: Whether to begin the stream from that seed, bool.
    actions: The ego's actions, int64.
    options: SETTINGS record of the intersection in an array of one.
    road: Tables of the scene, `scene.Road`.
    first: First episode of the part to do.
    end: End of that part.
"""
