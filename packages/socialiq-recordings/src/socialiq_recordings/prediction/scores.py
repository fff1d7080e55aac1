"""Scores of driver models, and contrasts between them that are corrected together.

The list of contrasts is fixed before anything is predicted: on second halves, for each holdout and
kind of moment, every model against the better trivial one, every learned model against the fitted
IDM, and models that know more against what they extend.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64
from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, finish, head
from socialiq.statistics.clusters import cluster_mean, sign_flips
from socialiq.types import Row
from socialiq_recordings.conflicts.measures import known
from socialiq_recordings.prediction import learned
from socialiq_recordings.prediction.models import BASE, TRIVIAL

SUBSETS = ("all", "moving", "conflict")
"""All moments, those of moving vehicles, and those of moving vehicles in a conflict."""

SECOND_HALF = "second half"
PARTS = ("all", SECOND_HALF)
"""Moments of all drivers, or those in the second halves of drivers' conflicts. Models that learned
from a driver's first half are only scored on its second."""


class Predicted(NamedTuple):
    """Predictions of one model for the moments that a holdout tests.

    Attributes:
        model: Name.
        personal: Whether it learned from drivers' first halves.
        log_density: Of the observed acceleration.
        mean: Predicted acceleration, m/s².
        driven: Predicted distance after 3 s, m.
    """

    model: str
    personal: bool
    log_density: Float64[np.ndarray, " moment"]
    mean: Float64[np.ndarray, " moment"]
    driven: Float64[np.ndarray, " moment"]


class Held(NamedTuple):
    """Moments that a holdout tests, each once.

    Attributes:
        holdout: What is held out.
        acceleration: Observed, m/s².
        driven: Observed distance after 3 s, m; NaN if not seen.
        chain: Number of each moment's chain.
        vehicle: Number of each moment's driver.
        moving: Whether it moves.
        conflict: Whether it is in a conflict.
        second: Whether the moment is in the second half of the driver's conflicts.
        predicted: Of every model.
    """

    holdout: str
    acceleration: Float64[np.ndarray, " moment"]
    driven: Float64[np.ndarray, " moment"]
    chain: Int64[np.ndarray, " moment"]
    vehicle: Int64[np.ndarray, " moment"]
    moving: Bool[np.ndarray, " moment"]
    conflict: Bool[np.ndarray, " moment"]
    second: Bool[np.ndarray, " moment"]
    predicted: Sequence[Predicted]

    def mask(self, subset: str, part: str) -> Bool[np.ndarray, " moment"]:
        """Return the moments of a subset and a part."""
        kinds = {
            "all": np.ones(len(self.moving), bool),
            "moving": self.moving,
            "conflict": self.moving & self.conflict,
        }
        return kinds[subset] & (self.second | (part == "all"))


def scores(tested: Held, seed: int, resamples: int) -> list[Row]:
    """Return a row for each subset, part and model; an interval of one chain is None.

    Args:
        tested: Moments with predictions.
        seed: Of the resampling of chains.
        resamples: Number of resamples.
    """
    rows: list[Row] = []
    for subset in SUBSETS:
        for moments in PARTS:
            mask = tested.mask(subset, moments)
            models = [model for model in tested.predicted if moments != "all" or not model.personal]
            if mask.any():
                rows += _rows(tested, models, mask, (seed, resamples), subset, moments)
    return [{name: known(value) for name, value in row.items()} for row in rows]


def _rows(
    tested: Held,
    models: Sequence[Predicted],
    mask: Bool[np.ndarray, " moment"],
    drawn: tuple[int, int],
    subset: str,
    part: str,
) -> list[Row]:
    chain = tested.chain[mask]
    best = better_trivial(models, mask)
    in_view = mask & np.isfinite(tested.driven)
    rows = []
    for model in models:
        surprise = cluster_mean(-model.log_density[mask], chain, *drawn)
        squared = cluster_mean((model.mean - tested.acceleration)[mask] ** 2, chain, *drawn)
        row: Row = {
            "holdout": tested.holdout,
            "moments": subset,
            "part": part,
            "model": model.model,
            "n": int(mask.sum()),
            "drivers": len(np.unique(tested.vehicle[mask])),
            "chains": surprise.clusters,
            "surprise": surprise.mean,
            "surprise_low": surprise.low,
            "surprise_high": surprise.high,
            "rmse": float(np.sqrt(squared.mean)),
            "rmse_low": float(np.sqrt(squared.low)),
            "rmse_high": float(np.sqrt(squared.high)),
        }
        rows.append(
            row
            | _displacement(tested, model, in_view, drawn)
            | _gain(model, best, mask, chain, drawn)
        )
    return rows


def better_trivial(
    models: Sequence[Predicted], mask: Bool[np.ndarray, " moment"]
) -> Predicted | None:
    """Return the trivial model that predicts some moments better; None without any.

    Args:
        models: All models.
        mask: The moments.
    """
    trivial = [model for model in models if model.model in TRIVIAL]
    return max(trivial, key=lambda one: one.log_density[mask].mean()) if trivial else None


def _displacement(
    tested: Held, one: Predicted, seen: Bool[np.ndarray, " moment"], drawn: tuple[int, int]
) -> Row:
    """Return the mean distance at 3 s between predicted and observed positions along the way."""
    names = ("displacement", "displacement_low", "displacement_high")
    if not seen.any():
        return dict.fromkeys(names) | {"n_displacement": 0}
    off = np.abs(one.driven - tested.driven)[seen]
    mean = cluster_mean(off, tested.chain[seen], *drawn)
    return dict(zip(names, mean[:3], strict=True)) | {"n_displacement": int(seen.sum())}


def _gain(
    one: Predicted,
    best: Predicted | None,
    mask: Bool[np.ndarray, " moment"],
    chain: Int64[np.ndarray, " chosen"],
    drawn: tuple[int, int],
) -> Row:
    """Return the gain over the better trivial model, nats."""
    if best is None:
        return {}
    gain = cluster_mean((one.log_density - best.log_density)[mask], chain, *drawn)
    return {"over": best.model, "gain": gain.mean, "gain_low": gain.low, "gain_high": gain.high}


FITTED = "IDM, fitted"

ERROR = 0.05
"""Chance that any contrast is decided though there is no difference."""

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

    Args:
        tested: Moments with predictions, of each holdout.
        seed: Of the resampling of chains.
        resamples: Number of resamples, and of drawn patterns of signs.
    """
    chains = np.unique(np.concatenate([held.chain for held in tested])) if tested else np.zeros(0)
    rows, sums = [], []
    for held in tested:
        for subset in SUBSETS:
            mask = held.mask(subset, SECOND_HALF)
            chain = np.searchsorted(chains, held.chain[mask])
            for model, rival in _pairs(held, mask):
                gain = (model.log_density - rival.log_density)[mask]
                mean = cluster_mean(gain, held.chain[mask], seed, resamples)
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
    trivial = better_trivial(held.predicted, mask)
    pairs = []
    for name, prediction in by.items():
        rivals = [trivial.model] if trivial and name not in TRIVIAL else []
        rivals += [FITTED] if name in ("boosting", BASE, *learned.LEARNED) else []
        rivals += [EXTENDED[name]] if name in EXTENDED else []
        pairs += [(prediction, by[rival]) for rival in rivals if rival in by]
    return pairs


_SHOWN = (
    ("moving", COLORS["prosocial"], "o", "moving vehicles"),
    ("conflict", COLORS["egoistic"], "D", "moving vehicles in a conflict within 5 s"),
)

_FARTHEST = 1.5  # nats; intervals beyond are cut
_FEWEST = 10  # moments; scores of fewer are not drawn


def gains(rows: Sequence[Row]) -> Figure:
    """Draw the gain of each model with its interval, a panel for each holdout.

    Args:
        rows: Rows of `scores.csv`.
    """
    holdouts = list(dict.fromkeys(row["holdout"] for row in rows))
    models = [m for m in dict.fromkeys(row["model"] for row in rows) if m not in TRIVIAL]
    drawing = figure(3.0 + 3.6 * len(holdouts), 1.8 + 0.33 * max(len(models), 1))
    panels = drawing.subplots(1, len(holdouts), sharey=True, squeeze=False)[0]
    for axes, holdout in zip(panels, holdouts, strict=True):
        of_holdout = [r for r in rows if r["holdout"] == holdout and r["part"] == SECOND_HALF]
        _panel(axes, of_holdout, models)
        finish(axes, f"held-out {holdout}", xlabel="log-likelihood gained, nats a moment")
    panels[0].set_yticks(np.arange(len(models)), models, fontsize=8)
    panels[0].invert_yaxis()
    title = "Next second's acceleration against the better of constant speed and last acceleration"
    head(drawing, f"{title}; 95 % by chain", panels[0], columns=2)
    return drawing


def _panel(axes: Any, rows: Sequence[Row], models: Sequence[str]) -> None:
    axes.axvline(0.0, color="#777777", linewidth=0.8)
    for number_of_kind, (subset, color, mark, label) in enumerate(_SHOWN):
        chosen = {
            row["model"]: row for row in rows if row["moments"] == subset and row["n"] >= _FEWEST
        }
        placed = [(models.index(name), row) for name, row in chosen.items() if name in models]
        if not placed:
            axes.plot([], [], mark, color=color, markersize=4, label=label)  # in the legend
            continue
        at = np.array([number for number, _ in placed]) + (number_of_kind - 0.5) * 0.3
        gain, low, high = (
            np.array([row[name] for _, row in placed], np.float64)  # None becomes NaN
            for name in ("gain", "gain_low", "gain_high")
        )
        gain, low, high = (np.clip(values, -_FARTHEST, _FARTHEST) for values in (gain, low, high))
        axes.hlines(at, low, high, color=color, linewidth=1.2)
        axes.plot(gain, at, mark, color=color, markersize=4, label=label)
