"""Yielding of recorded road users by class, and the weight that the order of passing shows."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.types import Row
from socialiq_recordings.conflicts.encounters import Meeting
from socialiq_recordings.conflicts.measures import YIELDED
from socialiq_recordings.recording import GROUPS, RoadUser

LEAD = 3.0  # s before the first of two enters, at which their speeds show the stakes
_ANGLES = np.arange(0.0, 90.5, 1.0)  # degrees
_SHARPNESS = np.geomspace(0.05, 4.0, 40)  # 1/s; times are known to half a second
_FEWEST = 20  # contested conflicts from which a weight is estimated


def group_of(kind: str) -> str:
    """Return the group of a class: `vehicle`, `bicycle`, `pedestrian` or `other`."""
    return GROUPS[RoadUser[kind.upper()]]


def who_yields(conflicts: Sequence[Row]) -> list[Row]:
    """Return a row for each pair of groups: conflicts, order of passing, and yielding.

    `conflicts` has two rows for each conflict (`measures.rows_of`). `of_first` counts those in
    which the one of the first group passed first, `of_yielded` those in which it passed second and
    lost at least `YIELDED`; of two of one group, either. `first_lost` counts the conflicts in which
    the road user that passed first lost as much. Such a loss is not yielding, so chance explains
    about as many of the losses of those that passed second.
    """
    rows: list[Row] = []
    for of, to in combinations_with_replacement(dict.fromkeys(GROUPS.values()), 2):
        chosen = [
            row
            for row in conflicts
            if (group_of(row["ego_class"]), group_of(row["other_class"])) == (of, to)
            and (of != to or row["ego"] < row["other"])
        ]
        if not chosen:
            continue
        pets = [row["pet"] for row in chosen if row["pet"] is not None]
        ordered = [row for row in chosen if None not in (row["ego_lost"], row["other_lost"])]
        gave = Counter(
            (row["ego_first"], side)
            for row in ordered
            for side in ("ego", "other")
            if row[f"{side}_lost"] >= YIELDED
        )
        row: Row = {"of": of, "to": to, "conflicts": len(chosen), "with_pet": len(pets)}
        row |= {"median_pet": statistics.median(pets) if pets else None, "ordered": len(ordered)}
        yielded = gave[False, "ego"], gave[True, "other"]
        counts = sum(row["ego_first"] for row in ordered), *yielded
        if of == to:
            counts = None, sum(yielded), None
        row |= dict(zip(("of_first", "of_yielded", "to_yielded"), counts, strict=True))
        rows.append(row | {"first_lost": gave[True, "ego"] + gave[False, "other"]})
    return rows


class Stakes(NamedTuple):
    """Times that two road users would lose by waiting, and the order in which they passed."""

    own_wait: float  # s that the ego would wait for the other to leave the area
    other_wait: float  # s that the other would wait for the ego
    second: bool  # whether the ego passed second

    @property
    def contested(self) -> bool:
        """Whether one of them must wait, in either order; else the order says little."""
        return min(self.own_wait, self.other_wait) > 0


def stakes_of(meeting: Meeting) -> Stakes | None:
    """Return the stakes `LEAD` s before the first enters.

    None if they were not recorded, one of the two stands, or neither goes first.
    """
    enters = min(meeting.ego_times.enters, meeting.other_times.enters)
    if meeting.is_head_on or not (meeting.complete and np.isfinite(enters)):
        return None
    frames = np.flatnonzero(meeting.frames * meeting.ego.dt <= enters - LEAD)
    if not len(frames):
        return None
    (arrives, leaves), (other_arrives, other_leaves) = (
        times[frames[-1]] for times in meeting.times
    )
    own_wait = max(other_leaves - arrives, 0.0)
    other_wait = max(leaves - other_arrives, 0.0)
    if not np.isfinite([own_wait, other_wait]).all():
        return None
    return Stakes(float(own_wait), float(other_wait), not meeting.ego_first)


class Weight(NamedTuple):
    """Angle of the weight of another's time, degrees, with its interval."""

    angle: float  # of (own, other's): 45 weighs both alike, 90 the other's alone
    low: float
    high: float
    sharpness: float  # 1/s; 0 would be a coin


def _log_likelihoods(
    own_wait: Float64[np.ndarray, " pair"],
    other_wait: Float64[np.ndarray, " pair"],
    second: Float64[np.ndarray, " pair"],
) -> Float64[np.ndarray, "choice pair"]:
    """Return the log-likelihood of each pair at all angles and sharpnesses.

    P(second) = 1 / (1 + exp(-k (sin φ other - cos φ own))): the logit of a choice between waiting
    and going first (McFadden 1974).
    """
    angle = np.radians(_ANGLES)[:, None]
    gain = np.sin(angle) * other_wait - np.cos(angle) * own_wait
    logit = (_SHARPNESS[:, None, None] * gain).reshape(-1, len(own_wait))
    return -np.logaddexp(0.0, np.where(second > 0, -logit, logit))


def weight(
    stakes: Sequence[Stakes],
    cluster: Int64[np.ndarray, " pair"],
    seed: int = 0,
    resamples: int = 1000,
) -> Weight | None:
    """Estimate the weight that the order of passing shows, by maximum likelihood.

    The order is the outcome of both: if the one goes whose wait costs more, and they weigh each
    other's by w and v, tan φ is (1 + w) / (1 + v). So at 45 degrees the first to come is the first
    to go, and two egoists can't be told from two polite road users.

    Args:
        stakes: Stakes of each pair (`stakes_of`).
        cluster: Number of each pair's cluster; pairs of one cluster are not independent.
        seed: Seed of the resampling.
        resamples: Number of times that the clusters are drawn again.

    Returns:
        The estimate with an interval of 95 %, over resampled clusters. None with fewer than 20
        contested conflicts or two clusters.
    """
    clusters, index = np.unique(cluster, return_inverse=True)
    if sum(pair.contested for pair in stakes) < _FEWEST or len(clusters) < 2:
        return None
    of_pairs = _log_likelihoods(*np.array(stakes, np.float64).T)
    sums = np.stack([of_pairs[:, index == n].sum(axis=1) for n in range(len(clusters))], axis=1)
    draws = np.random.default_rng(seed).multinomial(
        len(clusters), np.full(len(clusters), 1 / len(clusters)), resamples
    )
    best = int(sums.sum(axis=1).argmax())
    angles = _ANGLES[(sums @ draws.T).argmax(axis=0) % len(_ANGLES)]
    low, high = np.quantile(angles, [0.025, 0.975]).tolist()
    return Weight(
        float(_ANGLES[best % len(_ANGLES)]), low, high, float(_SHARPNESS[best // len(_ANGLES)])
    )


def recovered(
    stakes: Sequence[Stakes], sharpness: float = 1.0, seed: int = 0, draws: int = 200
) -> Iterator[tuple[float, float, float]]:
    """Yield known angles, and the range of 95 % of the estimates where they are true.

    The waits are those recorded; the road user that passes second is drawn.

    Args:
        stakes: Recorded stakes of each pair, whose order of passing is not used.
        sharpness: Sharpness of the drivers' choices that are drawn, 1/s.
        seed: Seed of the draws.
        draws: Number of times that the order of all pairs is drawn, for each angle.

    Yields:
        The true angle, 30, 45 and 60 degrees, and the quantiles of 2.5 and 97.5 % of the estimates,
        degrees.
    """
    own_wait, other_wait, _ = np.array(stakes, np.float64).T
    random = np.random.default_rng(seed)
    for angle in (30.0, 45.0, 60.0):
        gain = np.sin(np.radians(angle)) * other_wait - np.cos(np.radians(angle)) * own_wait
        chance = 1 / (1 + np.exp(-sharpness * gain))
        estimates = []
        for _ in range(draws):
            second = (random.random(len(own_wait)) < chance).astype(np.float64)
            best = _log_likelihoods(own_wait, other_wait, second).sum(axis=1).argmax()
            estimates.append(_ANGLES[best % len(_ANGLES)])
        low, high = np.quantile(estimates, [0.025, 0.975]).tolist()
        yield angle, low, high
