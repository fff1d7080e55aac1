"""Contrasts between driver models on the same held-out moments, all of them corrected together.

The list is fixed before anything is predicted: on second halves, for each holdout and kind of
moment, every model against the better trivial one, every learned model against the fitted IDM, and
models that know more against what they extend.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from socialiq.statistics.clusters import cluster_mean, sign_flips
from socialiq.types import Row
from socialiq_recordings.prediction import dial, learned
from socialiq_recordings.prediction.models import BASE, TRIVIAL
from socialiq_recordings.prediction.scores import SUBSETS, Held, Predicted, better_trivial

FITTED = "IDM, fitted"

ERROR = 0.05
"""Chance that any contrast is decided though there is no difference."""

EXTENDED = {
    "IDM, by driver": FITTED,
    "IDM, last residual": FITTED,
    BASE: "boosting",
    dial.AT_ANGLE: learned.CLONE,
    dial.BY_DRIVER: dial.AT_ANGLE,
}
"""Models that know more than another, and this other."""

_PART = "second half"


def contrasts(tested: Sequence[Held], seed: int, resamples: int) -> list[Row]:
    """Return a row for each contrast: gain in nats a moment, interval by chain, p, corrected p.

    Args:
        tested: Moments with predictions, of each holdout.
        seed: Of the resampling of chains.
        resamples: Number of resamples, and of drawn patterns of signs.
    """
    chains = np.unique(np.concatenate([one.chain for one in tested])) if tested else np.zeros(0)
    rows, sums = [], []
    for held in tested:
        for subset in SUBSETS:
            mask = held.mask(subset, _PART)
            place = np.searchsorted(chains, held.chain[mask])
            for one, other in _pairs(held, mask):
                gain = (one.log_density - other.log_density)[mask]
                found = cluster_mean(gain, held.chain[mask], seed, resamples)
                sums.append(np.bincount(place, gain, len(chains)))
                row: Row = {"holdout": held.holdout, "moments": subset, "model": one.model}
                row |= {"over": other.model, "n": int(mask.sum()), "chains": found.clusters}
                known = found.clusters > 1
                row |= {"gain": found.mean, "low": found.low if known else None}
                rows.append(row | {"high": found.high if known else None})
    if not rows:
        return []
    tests = sign_flips(np.array(sums), seed, resamples)
    for row, p, corrected in zip(rows, tests.p.tolist(), tests.corrected.tolist(), strict=True):
        row |= {"p": p, "p_corrected": corrected, "found": corrected <= ERROR}
    return rows


def _pairs(held: Held, mask: np.ndarray) -> list[tuple[Predicted, Predicted]]:
    """Return the pairs of models that are compared on some moments."""
    if not mask.any():
        return []
    by = {one.model: one for one in held.predicted}
    trivial = better_trivial(held.predicted, mask)
    found = []
    for name, one in by.items():
        rivals = [trivial.model] if trivial and name not in TRIVIAL else []
        rivals += [FITTED] if name in ("boosting", BASE, *learned.LEARNED) else []
        rivals += [EXTENDED[name]] if name in EXTENDED else []
        found += [(one, by[other]) for other in rivals if other in by]
    return found
