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
    table = tabulate(world).reachable_part()
    attainable = attainable_set(table.mdp, world.horizon)
    numbers = list(dict.fromkeys(attainable.optimum(float(angle)).vertex for angle in ANGLES))
    return {
        "polygon": attainable.vertices.round(9).tolist(),
        "front": attainable.front().round(9).tolist(),
        "corners": [_corner(attainable, number, table) for number in numbers],
        "best": [numbers.index(attainable.optimum(float(angle)).vertex) for angle in ANGLES],
        "radius": [_radius(attainable, float(angle)) for angle in ANGLES],
        "size": SIZE,
        "conflict": CONFLICT,
    }


def _radius(attainable: AttainableSet, angle: float) -> float | None:
    try:
        return round(attainable.radius(angle), 9)
    except UserError:
        return None


def _corner(attainable: AttainableSet, number: int, table: Table) -> dict[str, Any]:
    """Return a corner: its point, where it lies, the angles that it is best at, and its visits."""
    low, high = attainable.supporting_interval(number)
    reward = score(exact_weights((max(low, 0.0) + min(high, 90.0)) / 2.0), table.mdp.rewards)
    best = horizon_optimum(table.mdp, reward, table.world.horizon)
    evaluation = horizon_evaluation(
        table.mdp, best.probabilities(table.mdp.n_actions), table.world.horizon
    )
    return {
        "point": [round(total, 9) + 0.0 for total in evaluation.totals],
        "angle": angle_of(*evaluation.totals),
        "low": max(low, 0.0),
        "high": min(high, 90.0),
        "length": evaluation.length,
        "arrival": float(evaluation.endings[Ending.ARRIVAL]),
        "timeout": float(evaluation.endings[Ending.TIMEOUT]),
        "decisions": ego_visits(table, evaluation.visits).round(6).tolist(),
        "vehicles": vehicle_visits(table, evaluation.visits).round(6).tolist(),
        "approaching": before_the_conflict(table, evaluation.visits).round(6).tolist(),
    }


def ego_visits(table: Table, visits: np.ndarray) -> np.ndarray:
    """Return how often the ego takes each action in each column, expected in an episode.

    Args:
        table: The world, or its reachable part.
        visits: Expected visits by state and action (`HorizonEvaluation.visits`).

    Returns:
        By column and action.
    """
    counts = np.zeros((SIZE, visits.shape[1]))
    np.add.at(counts, table.states[:, 0], visits)
    return counts


def vehicle_visits(table: Table, visits: np.ndarray) -> np.ndarray:
    """Return how many steps vehicles begin in each row, expected in an episode.

    Args:
        table: The world, or its reachable part.
        visits: Expected visits by state and action.

    Returns:
        By row, from the south.
    """
    counts, by_state = np.zeros(SIZE), visits.sum(axis=1)
    for row in (table.states[:, 2], table.states[:, 4]):
        np.add.at(counts, row[row != ABSENT], by_state[row != ABSENT])
    return counts


def before_the_conflict(table: Table, visits: np.ndarray) -> np.ndarray:
    """Return the decisions in the cell before the conflict, expected in an episode.

    Args:
        table: The world, or its reachable part.
        visits: Expected visits by state and action.

    Returns:
        By row of the nearest vehicle south of the conflict, the last entry for none, and by action.
    """
    rows = table.states[:, [2, 4]]
    nearest = np.where(rows < CONFLICT, rows, ABSENT).max(axis=1)  # ABSENT is -1: the last entry
    there = table.states[:, 0] == CONFLICT - 1
    counts = np.zeros((CONFLICT + 1, visits.shape[1]))
    np.add.at(counts, nearest[there], visits[there])
    return counts
