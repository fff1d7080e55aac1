"""Strata of episodes, which depend on the seed alone, and results by stratum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from socialiq.audit.evidence.outcomes import Evidence, events_of
from socialiq.evaluation.conflicts import CONFLICT_SECONDS
from socialiq.statistics.comparisons import Difference, paired_difference
from socialiq.statistics.intervals import Share, wilson
from socialiq.worlds.intersection import policies

NO_CROSSING = "nobody crosses"  # codespell:ignore
"""Label of episodes without a crossing vehicle; a key of written reports."""

_SOON = 5  # steps of a gridworld within which the first conflicts are decided


def intersection_strata(
    observation: Float32[np.ndarray, "episode feature"],
) -> dict[str, np.ndarray]:
    """Return labels from the ego's first observation.

    Args:
        observation: Observation of each episode after the reset.

    Returns:
        `density`: number of other vehicles in view. `conflict`: whether a crossing vehicle is in
        the junction, or will be within the 3 s in which the ego could be there. `right_of_way`:
        whether one of these is on the other road, which has priority over the ego's, or all
        are oncoming.
    """
    seen = policies.in_metres(observation)
    others = (seen[:, 1:, 0] > 0).sum(axis=1)
    crossing = policies.conflict(seen, CONFLICT_SECONDS)
    other_road = np.abs(seen[:, 1:, 3]) > np.abs(seen[:, 1:, 4])
    met, yielding = crossing.any(axis=1), (crossing & other_road).any(axis=1)
    return {
        "density": np.select([others <= 1, others <= 3], ["0 to 1", "2 to 3"], "4 or more"),
        "conflict": np.where(met, "at once", "none yet"),
        "right_of_way": np.select([yielding, met], ["theirs", "oncoming"], NO_CROSSING),
    }


def gridworld_strata(
    fate: Float[np.ndarray, "episode draw"], chance: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """Return labels from the draws that decide where vehicles spawn; none if nothing is drawn.

    Args:
        fate: Result of `drive.fates`.
        chance: Probability of each chance outcome; the last is a spawn.
    """
    if len(chance) == 1:
        return {}
    spawns = (fate[:, 1 : 1 + _SOON] >= 1.0 - chance[-1]).sum(axis=1)
    return {"density": np.select([spawns == 0, spawns == 1], ["0", "1"], "2 or more")}


_FEWEST = 2  # episodes of a stratum for the test of a difference


@dataclass(frozen=True)
class Stratum:
    """A policy in the episodes of one label.

    Attributes:
        stratification: For instance "density".
        label: For instance "4 or more".
        episodes: Number of episodes.
        regret: Regret towards the apparently best reference over all episodes, with a two-sided
            Student interval; None if there are fewer than two episodes. Intervals are of each
            stratum alone: of many, some miss.
        shares: Share of each criterion of the floor, with a two-sided Wilson interval.
    """

    stratification: str
    label: str
    episodes: int
    regret: Difference | None
    shares: dict[str, Share]


def stratified(
    evidence: Evidence, angle: float, reference: str, confidence: float = 0.95
) -> tuple[Stratum, ...]:
    """Break the evidence down by every stratification.

    The reference is the same in every stratum, so that regrets, weighted by episodes, add up to
    the whole regret.

    Args:
        evidence: Policy and references.
        angle: Declared angle in degrees.
        reference: Name of the reference to compare with: `RegretTest.best`.
        confidence: Confidence of the intervals.
    """
    best = next(one for one in evidence.references if one.name == reference)
    theirs, ours = (one.values(angle) for one in (best, evidence.policy))
    policy, found = evidence.policy, []
    events = events_of(policy)
    for stratification, labels in evidence.strata.items():
        for label in np.unique(labels).tolist():
            rows = labels == label
            count = int(rows.sum())
            enough = count >= _FEWEST
            regret = paired_difference(theirs[rows], ours[rows], confidence) if enough else None
            shares = {
                name: wilson(int(happened[rows].sum()), count, confidence)
                for name, happened in events.items()
            }
            found.append(Stratum(stratification, label, count, regret, shares))
    return tuple(found)
