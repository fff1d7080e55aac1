"""Credibility of the simulation behind an audit: what was verified of it, and what was not.

Simulation is evidence as far as its scope, its assumptions, its uncertainty and its validation are
known. This module has the facts about the package's own worlds; an environment's are its owner's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from socialiq.audit.profile.junction import is_junction
from socialiq.worlds.registry import GRIDWORLDS, INTERSECTIONS

INTERSECTION = "intersection"

CONTINUOUS = "intersection with continuous actions"

JUNCTION = "recorded junction"


@dataclass(frozen=True)
class Conformance:
    """A comparison of the compiled intersection with highway-env, decision by decision.

    Attributes:
        command: Command of one run.
        runs: Variations of the command.
        episodes: Number of episodes of all runs.
        decisions: Number of decisions of all runs.
        compared: Options of the world that the runs vary; the others have their defaults.
    """

    command: str
    runs: str
    episodes: int
    decisions: int
    compared: tuple[str, ...]


CONFORMANCE = Conformance(
    command="socialiq conformance --episodes 150 --seed 50000",
    runs="with --population highway_env and thesis, each with and without --connected",
    episodes=600,
    decisions=7282,
    compared=("population", "connected_lanes"),
)
"""The run that docs/worlds/intersection.md describes: no difference in any field."""

_YIELDING = (
    "Other vehicles follow the Intelligent Driver Model and yield by highway-env's rules; none "
    "of them is a person."
)
_EXACT = (
    "Observations are exact, for a limited number of vehicles: no noise, no delay.",
    "A collision is an overlap of two rectangles; its severity is not modelled.",
)

ASSUMPTIONS = {
    INTERSECTION: (
        _YIELDING,
        "The ego follows its lane; its policy chooses between target speeds once per decision.",
        *_EXACT,
    ),
    CONTINUOUS: (
        _YIELDING,
        "The policy's acceleration, and where it steers the angle of the front wheels, are held "
        "until the next decision; nothing else steers the ego.",
        *_EXACT,
    ),
    "gridworld": (
        "The road is a grid, time is in whole steps, and vehicles move by rule in both.",
        "The state is observed exactly.",
    ),
    JUNCTION: (
        "Other vehicles follow the Intelligent Driver Model along recorded ways, with parameters "
        "calibrated on the recordings; none of them is a person, and none changes lanes.",
        "Lines are closed where a recorded vehicle stood without a reason that the model knows; "
        "nothing is known of lights and of entries after the end of a recording.",
        "The ego drives a recorded vehicle's way; its policy chooses an acceleration per decision.",
        *_EXACT,
    ),
}


def credibility(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts for the page `credibility.md`.

    Args:
        report: Content of `report.json`.

    Returns:
        `kind`: `INTERSECTION`, `CONTINUOUS`, `JUNCTION`, "gridworld" or "environment".
        `assumptions`: sentences.
        `conformance`: the comparison with highway-env, if the world is the intersection. `beyond`:
        declared options that were not part of it.
    """
    scenario = report["declaration"]["scenario"]
    world = scenario["world"]
    kind = "gridworld" if world in GRIDWORLDS else "environment"
    if world in INTERSECTIONS:
        kind = INTERSECTION if world == INTERSECTION else CONTINUOUS
    if is_junction(world):
        kind = JUNCTION
    compared = CONFORMANCE if kind == INTERSECTION else None
    beyond = [name for name in scenario["options"] if name not in CONFORMANCE.compared]
    return {
        "kind": kind,
        "assumptions": ASSUMPTIONS.get(kind, ()),
        "conformance": compared,
        "beyond": beyond if compared else [],
    }
