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
    world = make()
    part = tabulate(world).reachable_part()
    found = attainable_set(part.mdp, world.horizon)
    numbers = list(dict.fromkeys(found.optimum(float(angle)).vertex for angle in ANGLES))
    return {
        "polygon": found.vertices.round(9).tolist(),
        "front": found.front().round(9).tolist(),
        "corners": [_corner(found, number, part) for number in numbers],
        "best": [numbers.index(found.optimum(float(angle)).vertex) for angle in ANGLES],
        "radius": [_radius(found, float(angle)) for angle in ANGLES],
        "size": SIZE,
        "conflict": CONFLICT,
    }


def _radius(found: AttainableSet, angle: float) -> float | None:
    try:
        return round(found.radius(angle), 9)
    except UserError:
        return None


def _corner(found: AttainableSet, number: int, part: Table) -> dict[str, Any]:
    """Return a corner: its point, where it lies, the angles that it is best at, and its visits."""
    low, high = found.supporting_interval(number)
    reward = score(exact_weights((max(low, 0.0) + min(high, 90.0)) / 2.0), part.mdp.rewards)
    best = horizon_optimum(part.mdp, reward, part.world.horizon)
    made = horizon_evaluation(part.mdp, best.probabilities(part.mdp.n_actions), part.world.horizon)
    return {
        "point": [round(one, 9) + 0.0 for one in made.totals],
        "angle": angle_of(*made.totals),
        "low": max(low, 0.0),
        "high": min(high, 90.0),
        "length": made.length,
        "arrival": float(made.endings[Ending.ARRIVAL]),
        "timeout": float(made.endings[Ending.TIMEOUT]),
        "decisions": ego_visits(part, made.visits).round(6).tolist(),
        "vehicles": vehicle_visits(part, made.visits).round(6).tolist(),
        "approaching": before_the_conflict(part, made.visits).round(6).tolist(),
    }


def ego_visits(part: Table, visits: np.ndarray) -> np.ndarray:
    """Return how often the ego takes each action in each column, expected in an episode.

    Args:
        part: The world, or its reachable part.
        visits: Expected visits by state and action (`HorizonEvaluation.visits`).

    Returns:
        By column and action.
    """
    found = np.zeros((SIZE, visits.shape[1]))
    np.add.at(found, part.states[:, 0], visits)
    return found


def vehicle_visits(part: Table, visits: np.ndarray) -> np.ndarray:
    """Return how many steps vehicles begin in each row, expected in an episode.

    Args:
        part: The world, or its reachable part.
        visits: Expected visits by state and action.

    Returns:
        By row, from the south.
    """
    found, by_state = np.zeros(SIZE), visits.sum(axis=1)
    for row in (part.states[:, 2], part.states[:, 4]):
        np.add.at(found, row[row != ABSENT], by_state[row != ABSENT])
    return found


def before_the_conflict(part: Table, visits: np.ndarray) -> np.ndarray:
    """Return the decisions in the cell before the conflict, expected in an episode.

    Args:
        part: The world, or its reachable part.
        visits: Expected visits by state and action.

    Returns:
        By row of the nearest vehicle south of the conflict, the last entry for none, and by action.
    """
    rows = part.states[:, [2, 4]]
    nearest = np.where(rows < CONFLICT, rows, ABSENT).max(axis=1)  # ABSENT is -1: the last entry
    there = part.states[:, 0] == CONFLICT - 1
    found = np.zeros((CONFLICT + 1, visits.shape[1]))
    np.add.at(found, nearest[there], visits[there])
    return found
