"""Exact front of the 7x7 world for the page: corners, their policies' visits, and their angles."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.social.angle import angle_of, exact_weights, score
from socialiq.types import Ending
from socialiq.worlds.crossing7 import ABSENT, CONFLICT, SIZE, make
from socialiq.worlds.enumerate import Table, tabulate

ANGLES = range(91)
"""Angles that the dial turns to, in degrees."""


@functools.cache
def crossing() -> dict[str, Any]:
    """Return the exact front of the 7x7 world, JSON-compatible.

    Returns:
        `polygon`: extreme points of all policies' expected sums (r_env, r_social), time-dependent
        and random ones included; `front`: the best ones between 0 and 90 degrees; `corners`: those
        that are best at one of `ANGLES`, with one optimal policy each; `best`: the corner of each
        of `ANGLES`; `radius`: for each angle the furthest point that lies at it
        (`AttainableSet.radius`), or None if there is none; `size` and `conflict` of the world.
    """
    world, radii = make(), []
    table = tabulate(world).reachable_part()
    attainable = attainable_set(table.mdp, world.horizon)
    best = [attainable.optimum(float(angle)).vertex for angle in ANGLES]
    numbers = list(dict.fromkeys(best))
    for angle in ANGLES:
        try:
            radii.append(round(attainable.radius(float(angle)), 9))
        except UserError:
            radii.append(None)
    return {
        "polygon": attainable.vertices.round(9).tolist(),
        "front": attainable.front().round(9).tolist(),
        "corners": [_corner(attainable, number, table) for number in numbers],
        "best": [numbers.index(vertex) for vertex in best],
        "radius": radii,
        "size": SIZE,
        "conflict": CONFLICT,
    }


def _corner(attainable: AttainableSet, number: int, table: Table) -> dict[str, Any]:
    """Return a corner: its point, where it lies, the angles that it is best at, and its visits.

    The visits are expected in an episode: decisions by column and action, steps that vehicles begin
    by row from the south, and decisions in the cell before the conflict by the row of the nearest
    vehicle south of it (the last entry for none) and action.
    """
    low, high = attainable.supporting_interval(number)
    reward = score(exact_weights((max(low, 0.0) + min(high, 90.0)) / 2.0), table.mdp.rewards)
    best = horizon_optimum(table.mdp, reward, table.world.horizon)
    evaluation = horizon_evaluation(
        table.mdp, best.probabilities(table.mdp.n_actions), table.world.horizon
    )
    visits, states = evaluation.visits, table.states
    decisions, vehicles = np.zeros((SIZE, visits.shape[1])), np.zeros(SIZE)
    np.add.at(decisions, states[:, 0], visits)
    by_state = visits.sum(axis=1)
    for row in (states[:, 2], states[:, 4]):
        np.add.at(vehicles, row[row != ABSENT], by_state[row != ABSENT])
    rows = states[:, [2, 4]]
    nearest = np.where(rows < CONFLICT, rows, ABSENT).max(axis=1)  # ABSENT is -1: the last entry
    before = states[:, 0] == CONFLICT - 1
    approaching = np.zeros((CONFLICT + 1, visits.shape[1]))
    np.add.at(approaching, nearest[before], visits[before])
    return {
        "point": [round(total, 9) + 0.0 for total in evaluation.totals],
        "angle": angle_of(*evaluation.totals),
        "low": max(low, 0.0),
        "high": min(high, 90.0),
        "length": evaluation.length,
        "arrival": float(evaluation.endings[Ending.ARRIVAL]),
        "timeout": float(evaluation.endings[Ending.TIMEOUT]),
        "decisions": decisions.round(6).tolist(),
        "vehicles": vehicles.round(6).tolist(),
        "approaching": approaching.round(6).tolist(),
    }
