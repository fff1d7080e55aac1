"""Prediction of recorded drivers: every model on every holdout.

Folds hold out moments, vehicles or sites, and leak none of them.

- moments: models learn from the first part of each recording, or of several that overlap, and
  predict the second: drivers may be known, moments are not.
- vehicles: chains of recordings are held out, so that no vehicle and no moment is on both sides.
  A single chain is cut into blocks of time; a vehicle belongs to the block in which it appears, and
  models learn from vehicles that are never in view together with one of the block.
- sites: all recordings of a site are held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.learners.settings import check_seed
from socialiq.types import Row
from socialiq_recordings.identity.identify import identify
from socialiq_recordings.prediction import learned, scores
from socialiq_recordings.prediction.following import FITTED, fit_population
from socialiq_recordings.prediction.models import MODELS, TRIVIAL, Task, residuals, rollout
from socialiq_recordings.prediction.situations import Situations, grouped, situations_of
from socialiq_recordings.recording import Recording

Holdout = Literal["moments", "vehicles", "sites"]
HOLDOUTS: tuple[Holdout, ...] = get_args(Holdout)

PARTS = 5  # largest number of folds of vehicles
LEAST = 20
"""Fewest moments from which models are fitted, and fewest vehicles that are cut into blocks."""

_BREAK = 1e5  # s without a moment between recordings that have none in common


class Fold(NamedTuple):
    """Moments to learn from and moments to predict."""

    holdout: Holdout  # what is held out
    name: int  # number of the part
    train: Bool[np.ndarray, " moment"]  # moments to learn from
    test: Bool[np.ndarray, " moment"]  # moments to predict


def possible(situations: Situations) -> tuple[Holdout, ...]:
    """Return what can be held out of some moments."""
    holdouts = []
    for holdout in HOLDOUTS:
        try:
            folds(situations, holdout)
        except UserError:
            continue
        holdouts.append(holdout)
    return tuple(holdouts)


def folds(situations: Situations, holdout: Holdout) -> list[Fold]:
    """Return the folds of all moments.

    Raises:
        UserError: If there are too few; the line says what is missing.
    """
    one_of("holdout", holdout, HOLDOUTS)
    sites = np.unique(situations.site)
    if holdout == "sites" and len(sites) < 2:
        raise UserError(
            "these recordings show one site: add another place, or hold out vehicles or moments "
            "(--holdout)"
        )
    if holdout == "sites":
        tests = [situations.site == site for site in sites]
        result = [Fold("sites", number, ~test, test) for number, test in enumerate(tests)]
    else:
        result = _moments(situations) if holdout == "moments" else _vehicles(situations)
    short = [fold for fold in result if fold.train.sum() < LEAST]
    if short or not result:
        count = int(short[0].train.sum()) if short else 0
        raise UserError(
            f"holding out {holdout} leaves {count} moments to learn from, and {LEAST} are needed: "
            "add recordings, or hold out something else (--holdout)"
        )
    return result


def _moments(situations: Situations) -> list[Fold]:
    """Cut each stretch of time that recordings cover without a break in the middle."""
    cut, order = np.zeros(len(situations)), np.argsort(situations.time, kind="stable")
    breaks = np.flatnonzero(np.diff(situations.time[order]) > _BREAK) + 1
    for rows in np.split(order, breaks):
        cut[rows] = (situations.time[rows].min() + situations.time[rows].max() + 1.0) / 2
    # The acceleration of a moment to learn from ends before the first one to predict begins.
    return [Fold("moments", 0, situations.time + 1.0 <= cut, situations.time >= cut)]


def _vehicles(situations: Situations) -> list[Fold]:
    """Hold out chains; of a single one blocks of time, without vehicles that meet the block's."""
    if len(np.unique(situations.chain)) > 1:
        group = grouped(situations.chain, PARTS)
        return [
            Fold("vehicles", number, group != number, group == number)
            for number in range(int(group.max()) + 1)
        ]
    vehicles, driver = np.unique(situations.vehicle, return_inverse=True)
    if len(vehicles) < LEAST:
        raise UserError(
            f"these recordings share their vehicles, {len(vehicles)} in all, and vehicles are held "
            f"out of at least {LEAST}: add recordings; held-out moments alone can be predicted "
            "(socialiq data predict --holdout moments)"
        )
    first = np.full(len(vehicles), np.inf)
    np.minimum.at(first, driver, situations.time)
    block = np.argsort(np.argsort(first, kind="stable"), kind="stable") * PARTS // len(vehicles)
    result = []
    for number in range(PARTS):
        test = (block == number)[driver]
        # The seconds of the block's moments, and those before and after them.
        seconds = np.floor(situations.time[test])[:, None] + np.array([-1.0, 0.0, 1.0])
        met = np.zeros(len(vehicles), bool)
        np.logical_or.at(met, driver, np.isin(np.floor(situations.time), seconds))
        result.append(Fold("vehicles", number, ~met[driver] & ~test, test))
    return result


ALL_MODELS = (*MODELS, *learned.LEARNED)  # names of all models


@dataclass(frozen=True)
class Config:
    """Settings of the prediction."""

    holdouts: tuple[Holdout, ...] = ()  # what is held out; nothing: all that recordings allow
    models: tuple[str, ...] = ALL_MODELS  # names of models; the trivial ones are always added
    training: learned.Training = field(default_factory=learned.Training)  # of our learners
    seed: int = 0  # of training and resampling
    resamples: int = 2000  # of chains

    def __post_init__(self) -> None:
        """Refuse unknown names."""
        for holdout in self.holdouts:
            one_of("holdout", holdout, HOLDOUTS)
        for model in self.models:
            if model not in ALL_MODELS:  # some names have a comma, so that each is quoted
                names = ", ".join(f"'{name}'" for name in ALL_MODELS)
                raise UserError(f"unknown model '{one_line(model, 80)}': choose from {names}")
        check_seed(self.seed)
        if not 100 <= self.resamples <= 100_000:
            raise UserError(f"resamples must be from 100 to 100000, got {self.resamples}")


@dataclass(frozen=True, eq=False)
class Prediction:
    """Scores of all models."""

    scores: list[Row]  # a row for each holdout, subset, part and model
    folds: list[Row]  # a row for each fold: sizes, fitted IDM, mean κ of the dial
    contrasts: list[Row]  # a row for each contrast between models, corrected together


def situations(recordings: Sequence[Recording], drop: bool = True) -> Situations:
    """Return the situations of recordings that are identified first, as `situations_of`."""
    return situations_of(recordings, identify(recordings), drop)


def predict(situations: Situations, config: Config) -> Prediction:
    """Fit every model on every fold of all moments, predict what is held out, and score it.

    Raises:
        UserError: If what is to be held out can't be.
    """
    holdouts = dict.fromkeys(config.holdouts or possible(situations))
    if not holdouts:
        folds(situations, "moments")  # its line says what is missing
    all_folds = [fold for holdout in holdouts for fold in folds(situations, holdout)]
    names = [name for name in ALL_MODELS if name in (*TRIVIAL, *config.models)]
    half = situations.half()
    tasks = [_task(situations, half, fold, config.seed) for fold in all_folds]
    policies = learned.trained(tasks, config.training, names)
    outputs: dict[str, list[list[scores.Predicted]]] = {holdout: [] for holdout in holdouts}
    sizes = []
    for fold, task, policies_of in zip(all_folds, tasks, policies, strict=True):
        fitted = {name: MODELS[name](task) for name in names if name in MODELS} | policies_of
        test, last = situations.rows(fold.test), residuals(task.idm, situations)[fold.test]
        predictions = []
        for name, model in fitted.items():
            forecast = model.forecast(test, last)
            density = model.spread.log_density(forecast, test.acceleration, test.moving)
            columns = density, forecast.mean, rollout(model, task.idm, test, last)
            predictions.append(scores.Predicted(name, model.personal, *columns))
        outputs[fold.holdout].append(predictions)
        row: Row = {
            "holdout": fold.holdout,
            "fold": fold.name,
            "train": int(fold.train.sum()),
            "test": len(test),
            "test_drivers": len(np.unique(test.vehicle)),
            "test_chains": len(np.unique(test.chain)),
        }
        row |= dict(zip(FITTED, np.exp(task.idm).tolist(), strict=True))
        for model in fitted.values():
            row |= model.inferred
        sizes.append(row)
    tested = []
    for holdout, by_fold in outputs.items():
        of_holdout = [fold for fold in all_folds if fold.holdout == holdout]
        rows = np.concatenate([np.flatnonzero(fold.test) for fold in of_holdout])
        order = np.argsort(rows, kind="stable")
        models = []
        for same in zip(*by_fold, strict=True):
            columns = (
                np.concatenate([getattr(prediction, name) for prediction in same])[order]
                for name in ("log_density", "mean", "driven")
            )
            models.append(scores.Predicted(same[0].model, same[0].personal, *columns))
        second = half[rows[order]] == 1
        tested.append(scores.Held(holdout, situations.rows(rows[order]), second, models))
    draws = config.seed, config.resamples
    rows = [row for held in tested for row in scores.scores(held, *draws)]
    return Prediction(rows, sizes, scores.contrasts(tested, *draws))


def _task(situations: Situations, half: np.ndarray, fold: Fold, seed: int) -> Task:
    train = situations.rows(fold.train)
    idm = fit_population(train)
    last = residuals(idm, situations)
    is_own = (half == 0) & np.isin(situations.vehicle, np.unique(situations.vehicle[fold.test]))
    first = half[fold.train] == 0
    return Task(train, last[fold.train], first, situations.rows(is_own), idm, seed)
