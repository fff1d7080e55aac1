"""Scores of driver models, and contrasts between them that are corrected together.

The list of contrasts is fixed before anything is predicted: on second halves, for each holdout and
kind of moment, every model against the better trivial one, every learned model against the fitted
IDM, and models that know more against what they extend.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, finish, head
from socialiq.statistics.clusters import cluster_mean, sign_flips
from socialiq.types import Row
from socialiq_recordings.conflicts.measures import finite_or_none
from socialiq_recordings.prediction import learned
from socialiq_recordings.prediction.models import BASE, TRIVIAL
from socialiq_recordings.prediction.situations import Situations

SUBSETS = ("all", "moving", "conflict")
"""All moments, those of moving vehicles, and those of moving vehicles in a conflict."""

SECOND_HALF = "second half"
PARTS = ("all", SECOND_HALF)
"""Moments of all drivers, or those in the second halves of drivers' conflicts. Models that learned
from a driver's first half are only scored on its second."""


class Predicted(NamedTuple):
    """Predictions of one model for the moments that a holdout tests."""

    model: str  # name
    personal: bool  # whether it learned from drivers' first halves
    log_density: Float64[np.ndarray, " moment"]  # of the observed acceleration
    mean: Float64[np.ndarray, " moment"]  # predicted acceleration, m/s²
    driven: Float64[np.ndarray, " moment"]  # predicted distance after 3 s, m


class Held(NamedTuple):
    """Moments that a holdout tests, each once."""

    holdout: str  # what is held out
    moments: Situations  # the moments
    # whether each is in the second half of the driver's conflicts
    second: Bool[np.ndarray, " moment"]
    predicted: Sequence[Predicted]  # of every model

    def mask(self, subset: str, half: str) -> Bool[np.ndarray, " moment"]:
        """Return the moments of a subset and a part."""
        moving = self.moments.moving
        kinds = {"all": np.ones_like(moving), "moving": moving}
        kinds["conflict"] = moving & self.moments.conflict
        return kinds[subset] & (self.second | (half == "all"))


def scores(tested: Held, seed: int, resamples: int) -> list[Row]:
    """Return a row for each subset, part and model, with intervals from resampled chains.

    An interval of one chain is None.
    """
    rows: list[Row] = []
    for subset in SUBSETS:
        for half in PARTS:
            mask = tested.mask(subset, half)
            models = [model for model in tested.predicted if half != "all" or not model.personal]
            if mask.any():
                head = {"holdout": tested.holdout, "moments": subset, "part": half}
                best = _better_trivial(models, mask)
                rows += [
                    head | _scored(tested, model, best, mask, (seed, resamples)) for model in models
                ]
    return [{name: finite_or_none(value) for name, value in row.items()} for row in rows]


def _scored(
    tested: Held,
    model: Predicted,
    best: Predicted | None,
    mask: Bool[np.ndarray, " moment"],
    draws: tuple[int, int],
) -> Row:
    """Return surprise, error, gain over the better trivial model, displacement along the way."""
    moments = tested.moments
    chain, in_view = moments.chain[mask], mask & np.isfinite(moments.driven)
    surprise = cluster_mean(-model.log_density[mask], chain, *draws)
    squared = cluster_mean((model.mean - moments.acceleration)[mask] ** 2, chain, *draws)
    row: Row = {
        "model": model.model,
        "n": int(mask.sum()),
        "drivers": len(np.unique(moments.vehicle[mask])),
        "chains": surprise.clusters,
        "surprise": surprise.mean,
        "surprise_low": surprise.low,
        "surprise_high": surprise.high,
        "rmse": float(np.sqrt(squared.mean)),
        "rmse_low": float(np.sqrt(squared.low)),
        "rmse_high": float(np.sqrt(squared.high)),
    }
    row |= dict.fromkeys(("displacement", "displacement_low", "displacement_high"))
    row |= {"n_displacement": int(in_view.sum())}
    if in_view.any():
        off = np.abs(model.driven - moments.driven)[in_view]
        mean = cluster_mean(off, moments.chain[in_view], *draws)
        row |= {"displacement": mean.mean}
        row |= {"displacement_low": mean.low, "displacement_high": mean.high}
    if best is not None:
        gain = cluster_mean((model.log_density - best.log_density)[mask], chain, *draws)
        row |= {"over": best.model, "gain": gain.mean, "gain_low": gain.low, "gain_high": gain.high}
    return row


def _better_trivial(
    models: Sequence[Predicted], mask: Bool[np.ndarray, " moment"]
) -> Predicted | None:
    """Return the trivial model that predicts some moments better; None without any."""
    trivial = [model for model in models if model.model in TRIVIAL]
    return max(trivial, key=lambda model: model.log_density[mask].mean()) if trivial else None


FITTED = "IDM, fitted"

ERROR = 0.05  # chance that any contrast is decided though there is no difference
EXTENDED = {
    "IDM, by driver": FITTED,
    "IDM, last residual": FITTED,
    BASE: "boosting",
    learned.AT_ANGLE: learned.CLONE,
    learned.BY_DRIVER: learned.AT_ANGLE,
}
"""Models that know more than another, and this other."""


def contrasts(tested: Sequence[Held], seed: int, resamples: int) -> list[Row]:
    """Return a row for each contrast: gain in nats a moment, interval by chain, p, corrected p.

    `resamples` is the number of resampled chains, and of drawn patterns of signs.
    """
    every = [held.moments.chain for held in tested]
    chains = np.unique(np.concatenate(every)) if tested else np.zeros(0)
    rows, sums = [], []
    for held in tested:
        for subset in SUBSETS:
            mask = held.mask(subset, SECOND_HALF)
            of_chain = held.moments.chain[mask]
            chain = np.searchsorted(chains, of_chain)
            for model, rival in _pairs(held, mask):
                gain = (model.log_density - rival.log_density)[mask]
                mean = cluster_mean(gain, of_chain, seed, resamples)
                sums.append(np.bincount(chain, gain, len(chains)))
                row: Row = {"holdout": held.holdout, "moments": subset, "model": model.model}
                row |= {"over": rival.model, "n": int(mask.sum()), "chains": mean.clusters}
                several = mean.clusters > 1
                row |= {"gain": mean.mean, "low": mean.low if several else None}
                rows.append(row | {"high": mean.high if several else None})
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
    by = {model.model: model for model in held.predicted}
    trivial = _better_trivial(held.predicted, mask)
    pairs = []
    for name, prediction in by.items():
        rivals = [trivial.model] if trivial and name not in TRIVIAL else []
        rivals += [FITTED] if name in ("boosting", BASE, *learned.LEARNED) else []
        rivals += [EXTENDED[name]] if name in EXTENDED else []
        pairs += [(prediction, by[rival]) for rival in rivals if rival in by]
    return pairs


_SUBSETS_DRAWN = (
    ("moving", COLORS["prosocial"], "o", "moving vehicles"),
    ("conflict", COLORS["egoistic"], "D", "moving vehicles in a conflict within 5 s"),
)

_FARTHEST = 1.5  # nats; intervals beyond are cut
_FEWEST = 10  # moments; scores of fewer are not drawn


def gains(rows: Sequence[Row]) -> Figure:
    """Draw the gain of each model with its interval, a panel for each holdout."""
    holdouts = list(dict.fromkeys(row["holdout"] for row in rows))
    models = [m for m in dict.fromkeys(row["model"] for row in rows) if m not in TRIVIAL]
    drawing = figure(3.0 + 3.6 * len(holdouts), 1.8 + 0.33 * max(len(models), 1))
    panels = drawing.subplots(1, len(holdouts), sharey=True, squeeze=False)[0]
    for axes, holdout in zip(panels, holdouts, strict=True):
        axes.axvline(0.0, color="#777777", linewidth=0.8)
        second = [r for r in rows if r["holdout"] == holdout and r["part"] == SECOND_HALF]
        for kind, (subset, color, mark, label) in enumerate(_SUBSETS_DRAWN):
            of_subset = [r for r in second if r["moments"] == subset and r["n"] >= _FEWEST]
            placed = [row for row in of_subset if row["model"] in models]
            if not placed:
                axes.plot([], [], mark, color=color, markersize=4, label=label)  # in the legend
                continue
            at = np.array([models.index(row["model"]) for row in placed]) + (kind - 0.5) * 0.3
            gain, low, high = (
                np.clip(np.array([row[name] for row in placed], np.float64), -_FARTHEST, _FARTHEST)
                for name in ("gain", "gain_low", "gain_high")  # None becomes NaN
            )
            axes.hlines(at, low, high, color=color, linewidth=1.2)
            axes.plot(gain, at, mark, color=color, markersize=4, label=label)
        finish(axes, f"held-out {holdout}", xlabel="log-likelihood gained, nats a moment")
    panels[0].set_yticks(np.arange(len(models)), models, fontsize=8)
    panels[0].invert_yaxis()
    title = "Next second's acceleration against the better of constant speed and last acceleration"
    head(drawing, f"{title}; 95 % by chain", panels[0], columns=2)
    return drawing
