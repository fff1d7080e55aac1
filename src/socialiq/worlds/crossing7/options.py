"""Options for what thesis 5.1.2 leaves open, each with its default and the reason for it.

The defaults were chosen because together they give the thesis' published angles exactly: optima
of -42.27 degrees at α = 0 and 152.12 at α = 90. docs/worlds/crossing7.md lists the effect of every
other value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Options:
    """Options of the 7x7 world."""

    spawn_probability: float = 0.3
    """Probability per step that an empty second slot is filled (given in 5.1.2)."""

    second_slot_refills: Literal["next_step", "same_step"] = "next_step"
    """Whether a vehicle may spawn in the same step in which the second slot empties. The text
    says "per timestep when the slot is empty", so the slot must have been empty before."""

    second_slot_at_start: Literal["empty", "random"] = "empty"
    """Whether the second slot is empty at reset or already filled with the spawn probability."""

    first_slot: Literal["respawns", "once"] = "respawns"
    """Whether the first slot is refilled in the step in which its vehicle leaves. "Always
    spawns" is interpreted as always present."""

    conflict: Literal["swept", "end_cell"] = "swept"
    """Whether a road user that passes over the conflict cell within a step occupies it, or only
    a road user that stops there. Under `end_cell` a FAST ego (cells 0, 2, 4, 6) and a FAST vehicle
    never meet, so there would be no conflict."""

    braking: Literal["at_once", "one_level"] = "at_once"
    """Whether a vehicle brakes as far as it must in one step, or by one speed level at most."""

    arrival: Literal["override", "added"] = "override"
    """Whether the arrival bonus replaces that step's r_env or adds to it. Section 4.1 calls
    collision and arrival terminal overrides."""

    full_stop: Literal["at_least", "flat"] = "at_least"
    """Whether a forced complete stop costs at least 1.5 (1.0 a level, so 2.0 from FAST), or
    exactly 1.5. Only `at_least` gives the published -42 degrees."""

    yield_zone: Literal["before_conflict", "with_conflict"] = "before_conflict"
    """Cells in which yielding is rewarded: the cell before the conflict cell, or also the
    conflict cell. `with_conflict` allows reward hacking: the ego stops on the conflict cell and
    is rewarded for the vehicles that it blocks."""

    slow_yield: Literal["half", "full"] = "half"
    """Whether SLOW earns (1 - v/v_max) = 1/2 of the yielding reward as in Eq 4.2, or all of it.
    From the cell before the conflict SLOW enters the conflict, so the option matters only with
    `yield_zone="with_conflict"`."""
