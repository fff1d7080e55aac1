"""Folds that hold out moments, vehicles or sites, and leak none of them.

- moments: models learn from the first part of each recording, or of several that overlap, and
  predict the second: drivers may be known, moments are not.
- vehicles: chains of recordings are held out, so that no vehicle and no moment is on both sides.
  A single chain is cut into blocks of time; a vehicle belongs to the block in which it appears, and
  models learn from vehicles that are never in view together with one of the block.
- sites: all recordings of a site are held out.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Int64

from socialiq.errors import UserError, one_of
from socialiq_recordings.prediction.situations import Situations

Holdout = Literal["moments", "vehicles", "sites"]
HOLDOUTS: tuple[Holdout, ...] = get_args(Holdout)

PARTS = 5
"""Largest number of folds of vehicles."""

LEAST = 20
"""Fewest moments from which models are fitted, and fewest vehicles that are cut into blocks."""


_BREAK = 1e5  # s without a moment between recordings that have none in common


class Fold(NamedTuple):
    """Moments to learn from and moments to predict.

    Attributes:
        holdout: What is held out.
        name: Number of the part.
        train: Moments to learn from.
        test: Moments to predict.
    """

    holdout: Holdout
    name: int
    train: Bool[np.ndarray, " moment"]
    test: Bool[np.ndarray, " moment"]


def possible(seen: Situations) -> tuple[Holdout, ...]:
    """Return what can be held out of some moments."""
    holdouts = []
    for holdout in HOLDOUTS:
        try:
            folds(seen, holdout)
        except UserError:
            continue
        holdouts.append(holdout)
    return tuple(holdouts)


def folds(seen: Situations, holdout: Holdout) -> list[Fold]:
    """Return the folds.

    Args:
        seen: All moments.
        holdout: What is held out.

    Raises:
        UserError: If there are too few; the line says what is missing.
    """
    one_of("holdout", holdout, HOLDOUTS)
    result = {"moments": _moments, "vehicles": _vehicles, "sites": _sites}[holdout](seen)
    short = [fold for fold in result if fold.train.sum() < LEAST]
    if short or not result:
        count = int(short[0].train.sum()) if short else 0
        raise UserError(
            f"holding out {holdout} leaves {count} moments to learn from, and {LEAST} are needed: "
            "add recordings, or hold out something else (--holdout)"
        )
    return result


def _moments(seen: Situations) -> list[Fold]:
    cut = np.zeros(len(seen))
    for rows in _stretches(seen):
        cut[rows] = (seen.time[rows].min() + seen.time[rows].max() + 1.0) / 2
    # The acceleration of a moment to learn from ends before the first one to predict begins.
    return [Fold("moments", 0, seen.time + 1.0 <= cut, seen.time >= cut)]


def _stretches(seen: Situations) -> list[Int64[np.ndarray, " some"]]:
    """Return the rows of each stretch of time that recordings cover without a break."""
    order = np.argsort(seen.time, kind="stable")
    breaks = np.flatnonzero(np.diff(seen.time[order]) > _BREAK) + 1
    return np.split(order, breaks)


def _sites(seen: Situations) -> list[Fold]:
    sites = np.unique(seen.site)
    if len(sites) < 2:
        raise UserError(
            "these recordings show one site: add another place, or hold out vehicles or moments "
            "(--holdout)"
        )
    return [
        Fold("sites", number, seen.site != site, seen.site == site)
        for number, site in enumerate(sites)
    ]


def _vehicles(seen: Situations) -> list[Fold]:
    if len(np.unique(seen.chain)) < 2:
        return _blocks(seen)
    group = grouped(seen.chain, PARTS)
    return [
        Fold("vehicles", number, group != number, group == number)
        for number in range(int(group.max()) + 1)
    ]


def grouped(group: Int64[np.ndarray, " moment"], parts: int) -> Int64[np.ndarray, " moment"]:
    """Return the part of each moment; groups stay whole, and parts are about equally large.

    The largest group left goes to the part that is the smallest so far.

    Args:
        group: Group of each moment.
        parts: Largest number of parts.
    """
    number, sizes = np.unique(group, return_inverse=True, return_counts=True)[1:]
    filled = np.zeros(min(parts, len(sizes)))
    part_of = np.zeros(len(sizes), np.int64)
    for largest in np.argsort(-sizes, kind="stable"):
        part_of[largest] = np.argmin(filled)
        filled[part_of[largest]] += sizes[largest]
    return part_of[number]


def _blocks(seen: Situations) -> list[Fold]:
    """Return folds of one chain: blocks of time, without vehicles that meet the block's."""
    vehicles, driver = np.unique(seen.vehicle, return_inverse=True)
    if len(vehicles) < LEAST:
        raise UserError(
            f"these recordings share their vehicles, {len(vehicles)} in all, and vehicles are held "
            f"out of at least {LEAST}: add recordings; held-out moments alone can be predicted "
            "(socialiq data predict --holdout moments)"
        )
    clock = seen.time
    first = np.full(len(vehicles), np.inf)
    np.minimum.at(first, driver, clock)
    block = np.argsort(np.argsort(first, kind="stable"), kind="stable") * PARTS // len(vehicles)
    result = []
    for number in range(PARTS):
        test = (block == number)[driver]
        together = np.isin(np.floor(clock), _seconds(clock[test]))
        met = np.zeros(len(vehicles), bool)
        np.logical_or.at(met, driver, together)
        result.append(Fold("vehicles", number, ~met[driver] & ~test, test))
    return result


def _seconds(clock: np.ndarray) -> np.ndarray:
    """Return the seconds of some moments, and those before and after them."""
    return np.unique(np.floor(clock)[:, None] + np.array([-1.0, 0.0, 1.0]))
