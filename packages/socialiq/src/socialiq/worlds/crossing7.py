"""crossing7, the stochastic 7x7 intersection with reactive traffic (thesis 5.1.2).

The ego chooses a speed; vehicles drive FAST and brake for the ego.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

from socialiq.errors import UserError
from socialiq.foreign import Later
from socialiq.types import Ending
from socialiq.worlds.grid_world import Feature, GridWorld, Outcome, Place

jnp: Any = Later("jax.numpy")


@dataclass(frozen=True)
class Options:
    """Options for what thesis 5.1.2 leaves open, each with its default and the reason for it.

    The defaults were chosen because together they give the thesis' published angles exactly:
    optima of -42.27 degrees at α = 0 and 152.12 at α = 90. docs/worlds/crossing7.md lists the
    effect of every other value.
    """

    # Probability per step that an empty second slot is filled (given in 5.1.2).
    spawn_probability: float = 0.3
    # Whether a vehicle may spawn in the same step in which the second slot empties. The text says
    # "per timestep when the slot is empty", so the slot must have been empty before.
    second_slot_refills: Literal["next_step", "same_step"] = "next_step"
    # Whether the second slot is empty at reset or already filled with the spawn probability.
    second_slot_at_start: Literal["empty", "random"] = "empty"
    # Whether the first slot is refilled in the step in which its vehicle leaves. "Always spawns"
    # is interpreted as always present.
    first_slot: Literal["respawns", "once"] = "respawns"
    # Whether a road user that passes over the conflict cell within a step occupies it, or only a
    # road user that stops there. Under `end_cell` a FAST ego (cells 0, 2, 4, 6) and a FAST vehicle
    # never meet, so there would be no conflict.
    conflict: Literal["swept", "end_cell"] = "swept"
    # Whether a vehicle brakes as far as it must in one step, or by one speed level at most.
    braking: Literal["at_once", "one_level"] = "at_once"
    # Whether the arrival bonus replaces that step's r_env or adds to it. Section 4.1 calls
    # collision and arrival terminal overrides.
    arrival: Literal["override", "added"] = "override"
    # Whether a forced complete stop costs at least 1.5 (1.0 a level, so 2.0 from FAST), or exactly
    # 1.5. Only `at_least` gives the published -42 degrees.
    full_stop: Literal["at_least", "flat"] = "at_least"
    # Cells in which yielding is rewarded: the cell before the conflict cell, or also the conflict
    # cell. `with_conflict` allows reward hacking: the ego stops on the conflict cell and is
    # rewarded for the vehicles that it blocks.
    yield_zone: Literal["before_conflict", "with_conflict"] = "before_conflict"
    # Whether SLOW earns (1 - v/v_max) = 1/2 of the yielding reward as in Eq 4.2, or all of it.
    # From the cell before the conflict SLOW enters the conflict, so the option matters only with
    # `yield_zone="with_conflict"`.
    slow_yield: Literal["half", "full"] = "half"


STOP = 0
SLOW = 1
FAST = 2
LAST = 6  # the ego has arrived in the eastern column; a vehicle beyond the northern row has left
CONFLICT = 3  # both roads cross in cell (3, 3)
ABSENT = -1  # position of an empty slot
HORIZON = 25
SIZE = 7
ENV_WEIGHTS = {"speed": 0.4, "step": -0.3, "arrival": 2.0, "collision": -5.0}
SOCIAL_WEIGHTS = {"yielding": 0.2, "disruption": -1.0, "neighbour_collision": -5.0}
FULL_STOP = 1.5  # speed levels that a forced complete stop counts for


class Vehicle(NamedTuple):
    """Position along its road and speed of one slot's vehicle; y = -1, v = 0 if empty."""

    y: Any
    v: Any


def step(options: Options, state: Any, action: Any, chance: Any) -> Outcome:
    """Move the ego and both vehicles at once; then vehicles leave and spawn.

    A collision, in which the ego and a vehicle occupy the conflict cell in the same step, precedes
    an arrival. It is impossible with `braking="at_once"`. With `arrival="override"` speed and step
    are 0 at a terminal step.

    Args:
        options: Options of the world.
        state: Values of the features: the ego's cell and speed, then position and speed of each
            slot.
        action: The ego's speed in this step: STOP, SLOW or FAST, cells a step.
        chance: 1: a vehicle spawns if the second slot is free; 0: none does.

    Returns:
        The next state, the ending, the signals and the ego's speed.
    """
    ego = state[0]
    ego_after = jnp.minimum(state[0] + action, LAST)
    ego_in_conflict = _occupies_conflict(ego, ego_after, options)
    vehicles = (Vehicle(state[2], state[3]), Vehicle(state[4], state[5]))
    first, second = (_drive(vehicle, ego_in_conflict, options) for vehicle in vehicles)
    pairs = ((vehicles[0], first), (vehicles[1], second))
    first_meets, second_meets = (
        (before.y != ABSENT) & _occupies_conflict(before.y, after.y, options)
        for before, after in pairs
    )
    struck = ego_in_conflict & (first_meets | second_meets)
    arrived = ~struck & (ego_after == LAST)
    counts = ~struck if options.arrival == "added" else ~(struck | arrived)
    running = jnp.asarray(counts, jnp.float32)
    signals = {
        "speed": running * action / FAST,
        "step": running,
        "arrival": jnp.asarray(arrived, jnp.float32),
        "collision": jnp.asarray(struck, jnp.float32),
        "yielding": _yielding(ego, ego_after, action, vehicles, options),
        "disruption": sum(_levels_lost(before, after, options) for before, after in pairs),
        "neighbour_collision": jnp.asarray(struck, jnp.float32),
    }
    spawns = (vehicles[1].y == ABSENT) & (chance == 1)
    if options.second_slot_refills == "same_step":
        spawns = ((vehicles[1].y == ABSENT) | (second.y > LAST)) & (chance == 1)
    first = _refilled(first, first.y > LAST if options.first_slot == "respawns" else False)
    second = _refilled(second, spawns)
    after = jnp.stack([ego_after, action, first.y, first.v, second.y, second.v])
    ending = jnp.where(arrived, int(Ending.ARRIVAL), int(Ending.NONE))
    return Outcome(
        state=after.astype(jnp.int32),
        ending=jnp.where(struck, int(Ending.COLLISION), ending),
        signals=signals,
        speed=jnp.asarray(action, jnp.float32),
    )


def _occupies_conflict(before: Any, after: Any, options: Options) -> Any:
    """Whether a road user stands in the conflict cell after the step, or passed over it."""
    stands = after == CONFLICT
    if options.conflict == "end_cell":
        return stands
    return stands | ((before < CONFLICT) & (after >= CONFLICT))


def _drive(vehicle: Vehicle, ego_in_conflict: Any, options: Options) -> Vehicle:
    """Move one vehicle: FAST, but it brakes so as not to enter a conflict cell the ego occupies.

    Vehicles don't react to each other: 5.1.2 gives them a reaction to the ego only. A vehicle that
    is already in the conflict cell continues.
    """
    would_enter = _occupies_conflict(vehicle.y, vehicle.y + FAST, options)
    safe = jnp.maximum(CONFLICT - 1 - vehicle.y, STOP)
    if options.braking == "one_level":
        safe = jnp.maximum(safe, vehicle.v - 1)
    speed = jnp.where(ego_in_conflict & would_enter, jnp.minimum(safe, FAST), FAST)
    present = vehicle.y != ABSENT
    return Vehicle(jnp.where(present, vehicle.y + speed, ABSENT), jnp.where(present, speed, STOP))


def _refilled(vehicle: Vehicle, spawns: Any) -> Vehicle:
    """Remove a vehicle that has left the road, and fill the slot if one spawns."""
    has_left = vehicle.y > LAST
    return Vehicle(
        y=jnp.where(spawns, 0, jnp.where(has_left, ABSENT, vehicle.y)),
        v=jnp.where(spawns, FAST, jnp.where(has_left, STOP, vehicle.v)),
    )


def _yielding(
    ego: Any, ego_after: Any, action: Any, vehicles: Sequence[Vehicle], options: Options
) -> Any:
    """Return (1 - v/v_max) times the approaching vehicles while the ego is in the influence zone.

    The zone is that of thesis 5.1.2. A vehicle approaches if it is on the road south of the
    conflict cell before the step.
    """
    holds_back = (ego == CONFLICT - 1) & (ego_after < CONFLICT)
    if options.yield_zone == "with_conflict":
        near = (ego == CONFLICT - 1) | (ego == CONFLICT)
        holds_back = near & (ego_after <= CONFLICT)
    approaching = sum(
        jnp.where((vehicle.y >= 0) & (vehicle.y < CONFLICT), 1.0, 0.0) for vehicle in vehicles
    )
    slowness = 1.0 - action / FAST
    if options.slow_yield == "full":
        slowness = jnp.where(action < FAST, 1.0, 0.0)
    return jnp.where(holds_back, slowness * approaching, 0.0)


def _levels_lost(before: Vehicle, after: Vehicle, options: Options) -> Any:
    """Return the speed levels a vehicle was forced to lose; a full stop counts as FULL_STOP."""
    levels = jnp.maximum(before.v - after.v, 0).astype(jnp.float32)
    stopped = (levels > 0) & (after.v == STOP)
    charge = FULL_STOP if options.full_stop == "flat" else jnp.maximum(levels, FULL_STOP)
    return jnp.where(stopped, charge, levels)


def places(state: Sequence[int]) -> list[Place]:
    """Return the places of the ego and of the vehicles that are present, with their speeds."""
    x_ego, v_ego, y_1, v_1, y_2, v_2 = (int(value) for value in state)
    slots = ((1, y_1, v_1), (2, y_2, v_2))
    vehicles = [Place(slot, CONFLICT, y, 90, v) for slot, y, v in slots if y != ABSENT]
    return [Place(0, x_ego, CONFLICT, 0, v_ego), *vehicles]


def make(options: Options | None = None) -> GridWorld:
    """Build the 7x7 world with the given options; a probability must lie in [0, 1]."""
    chosen = options or Options()
    p = chosen.spawn_probability
    if not 0.0 <= p <= 1.0:
        raise UserError(f"spawn_probability {p:g} is not a probability: choose one in [0, 1]")
    slots = [(Feature(f"y_{slot}", -1, 8), Feature(f"v_{slot}", 0, 3)) for slot in (1, 2)]
    empty = 0, STOP, 0, FAST, ABSENT, STOP
    filled = 0, STOP, 0, FAST, 0, FAST
    at_random = ((empty, 1.0 - p), (filled, p))
    return GridWorld(
        name="crossing7",
        options=chosen,
        features=(Feature("x_ego", 0, 7), Feature("v_ego", 0, 3), *slots[0], *slots[1]),
        actions=("STOP", "SLOW", "FAST"),
        start=at_random if chosen.second_slot_at_start == "random" else ((empty, 1.0),),
        chance=(1.0 - p, p),
        horizon=HORIZON,
        max_speed=FAST,
        rules=partial(step, chosen),
        env_weights=ENV_WEIGHTS,
        social_weights=SOCIAL_WEIGHTS,
        places=places,
        size=SIZE,
        units=("arrival", "full_stop", "yield_zone", "slow_yield"),
    )
