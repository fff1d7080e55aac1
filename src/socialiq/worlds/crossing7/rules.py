"""Transition rules of the 7x7 world: the ego picks a speed, vehicles brake for the ego."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from socialiq.types import Ending
from socialiq.worlds.crossing7.options import Options

STOP, SLOW, FAST = 0, 1, 2
LAST = 6  # the ego has arrived in the eastern column; a vehicle beyond the northern row has left
CONFLICT = 3  # both roads cross in cell (3, 3)
ABSENT = -1  # position of an empty slot
HORIZON = 25


class Vehicle(NamedTuple):
    """Position along its road and speed of one slot's vehicle; y = -1, v = 0 if empty."""

    y: Any
    v: Any


class Move(NamedTuple):
    """One step before vehicles leave or spawn, so that a slot still holds the same vehicle."""

    action: Any
    ego: Any
    ego_after: Any
    vehicles: tuple[Vehicle, Vehicle]
    vehicles_after: tuple[Vehicle, Vehicle]


def occupies_conflict(before: Any, after: Any, options: Options) -> Any:
    """Whether a road user stands in the conflict cell after the step, or passed over it."""
    stands = after == CONFLICT
    if options.conflict == "end_cell":
        return stands
    return stands | ((before < CONFLICT) & (after >= CONFLICT))


def drive(vehicle: Vehicle, ego_in_conflict: Any, options: Options) -> Vehicle:
    """Move one vehicle: FAST, but it brakes so as not to enter a conflict cell the ego occupies.

    Vehicles don't react to each other: 5.1.2 gives them a reaction to the ego only. A vehicle that
    is already in the conflict cell continues.
    """
    would_enter = occupies_conflict(vehicle.y, vehicle.y + FAST, options)
    safe = jnp.maximum(CONFLICT - 1 - vehicle.y, STOP)
    if options.braking == "one_level":
        safe = jnp.maximum(safe, vehicle.v - 1)
    speed = jnp.where(ego_in_conflict & would_enter, jnp.minimum(safe, FAST), FAST)
    present = vehicle.y != ABSENT
    return Vehicle(
        y=jnp.where(present, vehicle.y + speed, ABSENT), v=jnp.where(present, speed, STOP)
    )


def move(state: Any, action: Any, options: Options) -> Move:
    """Move the ego and both vehicles at once."""
    ego = state[0]
    ego_after = jnp.minimum(ego + action, LAST)
    ego_in_conflict = occupies_conflict(ego, ego_after, options)
    vehicles = (Vehicle(state[2], state[3]), Vehicle(state[4], state[5]))
    first, second = (drive(vehicle, ego_in_conflict, options) for vehicle in vehicles)
    return Move(action, ego, ego_after, vehicles, (first, second))


def collided(moved: Move, options: Options) -> Any:
    """Whether the ego and a vehicle occupied the conflict cell in the same step.

    This is impossible with `braking="at_once"` and possible with `braking="one_level"`.
    """
    ego_there = occupies_conflict(moved.ego, moved.ego_after, options)
    pairs = zip(moved.vehicles, moved.vehicles_after, strict=True)
    first, second = (
        (before.y != ABSENT) & occupies_conflict(before.y, after.y, options)
        for before, after in pairs
    )
    return ego_there & (first | second)


def ending(moved: Move, options: Options) -> Any:
    """Return the kind of ending, 0 while the episode continues; a collision precedes an arrival."""
    arrived = jnp.where(moved.ego_after == LAST, int(Ending.ARRIVAL), int(Ending.NONE))
    return jnp.where(collided(moved, options), int(Ending.COLLISION), arrived)


def refill(moved: Move, spawns: Any, options: Options) -> tuple[Vehicle, Vehicle]:
    """Remove the vehicles that have left the road and fill the slots.

    Args:
        moved: The step's movements.
        spawns: The chance outcome: whether the second slot spawns if it may.
        options: Options of the world.
    """
    first, second = moved.vehicles_after
    first_left, second_left = first.y > LAST, second.y > LAST
    refilled = options.first_slot == "respawns"
    first = Vehicle(
        y=jnp.where(first_left, 0 if refilled else ABSENT, first.y),
        v=jnp.where(first_left, FAST if refilled else STOP, first.v),
    )
    may_spawn = moved.vehicles[1].y == ABSENT
    if options.second_slot_refills == "same_step":
        may_spawn = may_spawn | second_left
    spawned = may_spawn & spawns
    second = Vehicle(
        y=jnp.where(spawned, 0, jnp.where(second_left, ABSENT, second.y)),
        v=jnp.where(spawned, FAST, jnp.where(second_left, STOP, second.v)),
    )
    return first, second
