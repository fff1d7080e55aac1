"""Where a policy does well and where not: regret and competence by stratum; nothing is decided."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from socialiq.audit.outcomes import Evidence
from socialiq.audit.safety_floor import events_of
from socialiq.social.angle import exact_weights
from socialiq.social.score import score
from socialiq.statistics.tests import Difference, Share, paired_difference, wilson
from socialiq.types import RewardPair

FEWEST = 2  # episodes of a stratum that a difference can be tested in


@dataclass(frozen=True)
class Stratum:
    """A policy in the episodes of one label.

    Attributes:
        stratification: For instance "density".
        label: For instance "4 or more".
        episodes: How many.
        regret: Towards the reference that looks best over all episodes, with a two-sided Student
            interval; None if there are fewer than two episodes. Intervals are of each stratum by
            itself: of many, some miss.
        shares: Of each criterion of competence, with two-sided Wilson intervals.
    """

    stratification: str
    label: str
    episodes: int
    regret: Difference | None
    shares: dict[str, Share]


def by_stratum(
    evidence: Evidence, angle: float, reference: str, confidence: float = 0.95
) -> tuple[Stratum, ...]:
    """Break the evidence down by every stratification.

    The reference is the same in every stratum, so that regrets, weighted by episodes, add up to
    the whole one.

    Args:
        evidence: Policy and references.
        angle: Declared, degrees.
        reference: Name of the one to compare with: `RegretTest.best`.
        confidence: Of the intervals.
    """
    best = next(one for one in evidence.references if one.name == reference)
    weights = exact_weights(angle)
    theirs, ours = (
        np.asarray(score(weights, RewardPair(*one.totals.T))) for one in (best, evidence.policy)
    )
    policy, found = evidence.policy, []
    events = events_of(policy)
    for stratification, labels in evidence.strata.items():
        for label in np.unique(labels).tolist():
            rows = labels == label
            count = int(rows.sum())
            enough = count >= FEWEST
            regret = paired_difference(theirs[rows], ours[rows], confidence) if enough else None
            shares = {
                name: wilson(int(happened[rows].sum()), count, confidence)
                for name, happened in events.items()
            }
            found.append(Stratum(stratification, label, count, regret, shares))
    return tuple(found)
