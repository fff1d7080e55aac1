"""One decision of every episode of a batch, and the compiled entry point."""

from __future__ import annotations

from typing import Any

from socialiq.types import Ending
from socialiq.worlds.intersection.buffers import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Buffers
from socialiq.worlds.intersection.core import rewards, spawn, stream
from socialiq.worlds.intersection.core import road_context as surroundings
from socialiq.worlds.intersection.core.collisions import collide
from socialiq.worlds.intersection.core.compile import (
    entry_point,
    fingerprint,
    kernel,
    run_in_parts,
)
from socialiq.worlds.intersection.core.ego import choose, control, route_coordinate
from socialiq.worlds.intersection.core.rules import enforce
from socialiq.worlds.intersection.core.traffic import drive, move
from socialiq.worlds.intersection.state import Contact

_NOTHING = int(Ending.NONE)
_NO_CONTACT = int(Contact.NONE)


@kernel
def sub_step(episode, vehicles, settings):
    """Advance by a sub-step: decisions, road rules if due, motion, then collisions."""
    count, ego = episode.vehicles, episode.ego
    for slot in range(count):
        if slot == ego:
            control(vehicles[slot])
        else:
            drive(vehicles, count, slot, settings)
    episode.sub_steps += 1
    if episode.sub_steps % settings.rule_period == 0:
        enforce(vehicles, count, ego, settings.tie)
    for slot in range(count):
        move(vehicles[slot], settings.dt, settings.tie)
    contact, touched = episode.contact, episode.touched
    found = collide(vehicles, count, ego, settings.dt, settings.tie, contact, touched)
    episode.contact, episode.touched = found


@kernel
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


@kernel
def decide(episode, vehicles, action, settings, before, after, present, trace, row):
    """Run the sub-steps of one decision and write snapshots before and after them."""
    _copy(vehicles, episode.vehicles, before)
    episode.time += settings.decision
    choose(vehicles[episode.ego], action, settings)
    for frame in range(settings.frames):
        sub_step(episode, vehicles, settings)
        if len(trace):
            _copy(vehicles, episode.vehicles, trace[row, frame])
    _copy(vehicles, episode.vehicles, after)
    present[0], present[1] = episode.vehicles, episode.ego


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


@kernel
def annotate(buffers, row, settings):
    """Write observation, ending, signals and rewards of a decision from its two snapshots."""
    before, after = buffers.before[row], buffers.after[row]
    count, ego = buffers.present[row]
    episode = buffers.episodes[row]
    surroundings.see(after, count, ego, settings.tie, buffers.reached[row])
    ending = surroundings.ending_of(after[ego], episode.time >= settings.duration)
    signals, start, braking = buffers.signals[row], episode.start, buffers.braking[row]
    surroundings.write_signals(before, after, count, ego, start, ending, settings, signals, braking)
    r_env, r_social = rewards.pair(signals, settings)
    buffers.rewards[row, 0], buffers.rewards[row, 1] = r_env, r_social
    own, others = surroundings.classical(before, after, count, ego, settings)
    buffers.classical[row, 0], buffers.classical[row, 1] = own, others
    buffers.speed[row] = after[ego].speed
    buffers.ending[row] = ending
    buffers.contact[row] = episode.contact if after[ego].crashed else _NO_CONTACT
    touched = episode.touched if after[ego].crashed else -1
    buffers.neighbours_collided[row] = rewards.neighbours_collided(
        before, after, count, ego, touched
    )
    return ending


@kernel
def _one(buffers, row, command, action, settings):
    """Carry out one episode's command."""
    if command == SKIP:
        return
    episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
    ending = _NOTHING
    if command in (DECIDE, DECIDE_AND_RESET):
        before, after, present = buffers.before[row], buffers.after[row], buffers.present[row]
        decide(episode, vehicles, action, settings, before, after, present, buffers.trace, row)
    if command != RESET:
        ending = annotate(buffers, row, settings)
        _copy_rows(buffers.reached[row], buffers.observation[row])
    if command in (DECIDE, DECIDE_AND_RESET):
        spawn.clear(episode, vehicles)
        probability = settings.spawn_probability
        spawn.spawn(episode, vehicles, 0.0, 1.0, 1.0, probability, False, settings)
    if command == RESET or (command == DECIDE_AND_RESET and ending != _NOTHING):
        reset(episode, vehicles, settings)
        count, ego = episode.vehicles, episode.ego
        surroundings.see(vehicles, count, ego, settings.tie, buffers.observation[row])


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, settings, first, end):
        for row in range(first, end):
            if seeded[row]:
                stream.seed(buffers.episodes[row], entropy[row])
            _one(buffers, row, commands[row], actions[row], settings[0])
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


run = _entry(fingerprint())
"""Carry out a command for every episode of a batch.

Args:
    buffers: Arrays read and written, `buffers.Buffers`.
    commands: One of `buffers`' commands for each episode, int8.
    entropy: Seed of each episode's stream, uint64.
    seeded: Whether to begin the stream from that seed, bool.
    actions: The ego's actions, int64.
    settings: SETTINGS record in an array of one.
    first: First episode of the part to do.
    end: End of that part.
"""


def on_threads(threads: int, buffers: Buffers, commands: Any, *arguments: Any) -> None:
    """Call `run` for all episodes on so many threads.

    Raises:
        UserError: If the machine has fewer.
    """
    run_in_parts(run, threads, len(commands), buffers, commands, *arguments)
