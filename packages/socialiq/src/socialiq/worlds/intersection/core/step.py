"""One decision of every episode of a batch, and the compiled entry point."""

from __future__ import annotations

from typing import Any

from socialiq.types import Ending
from socialiq.worlds.highway.core import rewards, stream
from socialiq.worlds.highway.core.collisions import collide
from socialiq.worlds.highway.core.compile import (
    entry_point,
    fingerprint,
    inlined_kernel,
    kernel,
    run_in_parts,
)
from socialiq.worlds.highway.state import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Buffers, Contact
from socialiq.worlds.intersection.core import road_context, spawn
from socialiq.worlds.intersection.core.ego import choose, control, route_coordinate
from socialiq.worlds.intersection.core.rules import enforce
from socialiq.worlds.intersection.core.traffic import drive, move

_NOTHING = int(Ending.NONE)
_NO_CONTACT = int(Contact.NONE)


@kernel
def sub_step(episode, vehicles, settings):
    """Advance by a sub-step: decisions, road rules if due, motion, then collisions."""
    count, ego = episode.vehicles, episode.ego
    for slot in range(count):
        if slot != ego:
            drive(vehicles, count, slot, settings)
        elif not settings.continuous:  # else the record holds the command
            control(vehicles[slot])
    episode.sub_steps += 1
    if episode.sub_steps % settings.rule_period == 0:
        enforce(vehicles, count, ego, settings)
    for slot in range(count):
        move(vehicles[slot], settings.dt, settings.tie)
    contact, touched = episode.contact, episode.touched
    found = collide(vehicles, count, ego, settings.dt, settings.tie, contact, touched)
    episode.contact, episode.touched = found


@inlined_kernel
def reset(episode, vehicles, settings):
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
        sub_step(episode, vehicles, settings)
    spawn.enter_ego(episode, vehicles, settings)
    episode.start = route_coordinate(vehicles[episode.ego])


@inlined_kernel
def decide(buffers, row, action, settings):
    """Run the sub-steps of one decision and write snapshots before and after them."""
    episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
    _copy(vehicles, episode.vehicles, buffers.before[row])
    episode.time += settings.decision
    if not settings.continuous:
        choose(vehicles[episode.ego], action, settings)
    for frame in range(settings.frames):
        sub_step(episode, vehicles, settings)
        if len(buffers.trace):
            _copy(vehicles, episode.vehicles, buffers.trace[row, frame])
    _copy(vehicles, episode.vehicles, buffers.after[row])
    buffers.present[row, 0], buffers.present[row, 1] = episode.vehicles, episode.ego


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


@inlined_kernel
def annotate(buffers, row, settings):
    """Write observation, ending, signals and rewards of a decision from its two snapshots."""
    before, after = buffers.before[row], buffers.after[row]
    count, ego = buffers.present[row]
    episode = buffers.episodes[row]
    road_context.see(after, count, ego, settings.tie, buffers.reached[row])
    ending = road_context.ending_of(after[ego], episode.time >= settings.duration, settings)
    signals, start, braking = buffers.signals[row], episode.start, buffers.braking[row]
    road_context.write_signals(before, after, count, ego, start, ending, settings, signals, braking)
    r_env, r_social = rewards.pair(signals, settings)
    buffers.rewards[row, 0], buffers.rewards[row, 1] = r_env, r_social
    own, others = road_context.classical(before, after, count, ego, settings)
    buffers.classical[row, 0], buffers.classical[row, 1] = own, others
    buffers.speed[row] = after[ego].speed
    buffers.ending[row] = ending
    buffers.contact[row] = episode.contact if after[ego].crashed else _NO_CONTACT
    touched = episode.touched if after[ego].crashed else -1
    buffers.neighbours_collided[row] = rewards.neighbours_collided(
        before, after, count, ego, touched
    )
    return ending


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, first, end):
        settings = options[0]
        for row in range(first, end):
            episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
            if seeded[row]:
                stream.seed(episode, entropy[row])
            command, ending = commands[row], _NOTHING
            if command == SKIP:
                continue
            deciding = command in (DECIDE, DECIDE_AND_RESET)
            if deciding:
                decide(buffers, row, actions[row], settings)
            if command != RESET:
                ending = annotate(buffers, row, settings)
                _copy_rows(buffers.reached[row], buffers.observation[row])
            if deciding:
                spawn.clear(episode, vehicles)
                probability = settings.spawn_probability
                spawn.spawn(episode, vehicles, 0.0, 1.0, 1.0, probability, False, settings)
            if command == RESET or (command == DECIDE_AND_RESET and ending != _NOTHING):
                reset(episode, vehicles, settings)
                count, ego = episode.vehicles, episode.ego
                road_context.see(vehicles, count, ego, settings.tie, buffers.observation[row])
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


run = _entry(fingerprint(__file__))
"""Carry out a command for every episode of a batch.

Args:
    buffers: Arrays read and written, `buffers.Buffers`.
    commands: One of `buffers`' commands for each episode, int8.
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
