"""The readings of thesis 5.1.2 that the text leaves open, each with its default and its reason.

The defaults were chosen because together they give the thesis' published angles exactly: optimum
-42.27 degrees at α = 0 and 152.12 at α = 90. docs/worlds/crossing7.md lists what each of the others
changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Options:
    """Readings of the 7x7 world."""

    spawn_probability: float = 0.3
    """Probability per step that an empty second slot is filled (given in 5.1.2)."""

    second_slot_refills: Literal["next_step", "same_step"] = "next_step"
    """Whether a vehicle may spawn in the very step in which the second slot empties. The text
    says "per timestep when the slot is empty", so the slot must have been empty before."""

    second_slot_at_start: Literal["empty", "random"] = "empty"
    """Whether the second slot is empty at reset or already filled with the spawn probability."""

    first_slot: Literal["respawns", "once"] = "respawns"
    """Whether the first slot is refilled in the step in which its vehicle leaves. "Always
    spawns" is read as always present."""

    conflict: Literal["swept", "end_cell"] = "swept"
    """Whether a road user that passes over the conflict cell within a step occupies it, or only
    one that stops there. Under `end_cell` a FAST ego (cells 0, 2, 4, 6) and a FAST vehicle never
    meet, so the conflict would not exist."""

    braking: Literal["at_once", "one_level"] = "at_once"
    """Whether a vehicle brakes as far as it must in one step, or by one speed level at most."""

    arrival: Literal["override", "added"] = "override"
    """Whether the arrival bonus replaces that step's r_env or adds to it. Section 4.1 calls
    collision and arrival terminal overrides."""

    full_stop: Literal["at_least", "flat"] = "at_least"
    """Whether a forced complete stop costs at least 1.5 (1.0 a level, so 2.0 from FAST), or
    exactly 1.5. Only the first gives the published -42 degrees."""

    yield_zone: Literal["before_conflict", "with_conflict"] = "before_conflict"
    """Where yielding is paid: in the cell before the conflict cell, or also while standing in the
    conflict cell. The second invites a reward hack: the ego parks on the conflict cell and
    collects for the vehicles that it blocks."""

    slow_yield: Literal["half", "full"] = "half"
    """Whether SLOW earns (1 - v/v_max) = 1/2 of the yielding reward as in Eq 4.2, or all of it.
    From the cell before the conflict SLOW enters the conflict, so it matters only together with
    `yield_zone="with_conflict"`."""
