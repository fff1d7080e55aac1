"""Prediction of recorded drivers: every model on every holdout, and the table of choices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64
from scipy.special import logsumexp

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.learners.settings import check_seed
from socialiq.types import Row
from socialiq_recordings.identity.identify import identify
from socialiq_recordings.prediction import learned
from socialiq_recordings.prediction.choices import ChoiceTable, rewards
from socialiq_recordings.prediction.density import Forecast
from socialiq_recordings.prediction.folds import HOLDOUTS, Fold, Holdout, folds, possible
from socialiq_recordings.prediction.following import FITTED, fit_population
from socialiq_recordings.prediction.models import (
    BASE,
    MODELS,
    TRIVIAL,
    Fitted,
    Residuals,
    Task,
    residuals,
    rollout,
)
from socialiq_recordings.prediction.scores import Held, Predicted, contrasts, scores
from socialiq_recordings.prediction.situations import Situations, situations_of
from socialiq_recordings.recording import Recording

ALL_MODELS = (*MODELS, *learned.LEARNED)
"""Names of all models."""

GRID = (-4.0, 3.0, 0.25)
"""m/s²; lowest and highest acceleration of the choices, and the step between them."""


@dataclass(frozen=True)
class Config:
    """Settings of the prediction.

    Attributes:
        holdouts: What is held out; nothing stands for all that the recordings allow.
        models: Names of models; the trivial ones are always added.
        training: Of our learners.
        seed: Of training and resampling.
        resamples: Of chains.
    """

    holdouts: tuple[Holdout, ...] = ()
    models: tuple[str, ...] = ALL_MODELS
    training: learned.Training = field(default_factory=learned.Training)
    seed: int = 0
    resamples: int = 2000

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
    """Scores of all models.

    Attributes:
        scores: A row for each holdout, subset, part and model.
        folds: A row for each fold: sizes, fitted IDM, mean κ of the dial.
        contrasts: A row for each contrast between models, corrected together.
    """

    scores: list[Row]
    folds: list[Row]
    contrasts: list[Row]


def situations(recordings: Sequence[Recording], drop: bool = True) -> Situations:
    """Return the situations of recordings that are identified first.

    Args:
        recordings: With road networks.
        drop: Whether vehicles that several recordings show are counted once.
    """
    return situations_of(recordings, identify(recordings), drop)


def predict(seen: Situations, config: Config) -> Prediction:
    """Fit every model on every fold, predict what is held out, and score it.

    Args:
        seen: All moments.
        config: Settings.

    Raises:
        UserError: If what is to be held out can't be.
    """
    holdouts = config.holdouts or possible(seen)
    if not holdouts:
        folds(seen, "moments")  # its line says what is missing
    all_folds = [fold for holdout in dict.fromkeys(holdouts) for fold in folds(seen, holdout)]
    names = [name for name in ALL_MODELS if name in (*TRIVIAL, *config.models)]
    half = seen.half()
    tasks = [_task(seen, half, fold, config.seed) for fold in all_folds]
    policies = learned.trained(tasks, config.training, names)
    outputs: dict[str, list[tuple[Fold, list[Predicted]]]] = {}
    sizes = []
    for fold, task, policies_of in zip(all_folds, tasks, policies, strict=True):
        fitted = {name: MODELS[name](task) for name in names if name in MODELS} | policies_of
        inferred = [model.inferred for model in fitted.values()]
        sizes.append(
            _fold_row(seen, fold, task) | {k: v for numbers in inferred for k, v in numbers.items()}
        )
        outputs.setdefault(fold.holdout, []).append((fold, _predicted(seen, fold, task, fitted)))
    tested = [_tested(seen, half, name, outputs_of) for name, outputs_of in outputs.items()]
    rows = [row for held in tested for row in scores(held, config.seed, config.resamples)]
    return Prediction(rows, sizes, contrasts(tested, config.seed, config.resamples))


def _task(seen: Situations, half: np.ndarray, fold: Fold, seed: int) -> Task:
    train = seen.rows(fold.train)
    idm = fit_population(train)
    last = residuals(idm, seen)
    own_first = (half == 0) & np.isin(seen.vehicle, np.unique(seen.vehicle[fold.test]))
    return Task(
        train,
        last[fold.train],
        half[fold.train] == 0,
        seen.rows(own_first),
        last[own_first],
        idm,
        seed,
    )


def _predicted(
    seen: Situations, fold: Fold, task: Task, fitted: dict[str, Fitted]
) -> list[Predicted]:
    test, last = seen.rows(fold.test), residuals(task.idm, seen)[fold.test]
    predictions = []
    for name, model in fitted.items():
        forecast = model.forecast(test, last)
        predictions.append(
            Predicted(
                name,
                model.personal,
                model.spread.log_density(forecast, test.acceleration, test.moving),
                forecast.mean,
                rollout(model, task.idm, test, last),
            )
        )
    return predictions


def _tested(
    seen: Situations, half: np.ndarray, holdout: str, each: list[tuple[Fold, list[Predicted]]]
) -> Held:
    """Return the predictions of all folds of a holdout, in the order of the moments."""
    rows = np.concatenate([np.flatnonzero(fold.test) for fold, _ in each])
    order = np.argsort(rows, kind="stable")
    moments = seen.rows(rows[order])
    models = []
    for same in zip(*(predictions for _, predictions in each), strict=True):
        columns = (
            np.concatenate([getattr(prediction, name) for prediction in same])[order]
            for name in ("log_density", "mean", "driven")
        )
        models.append(Predicted(same[0].model, same[0].personal, *columns))
    return Held(
        holdout,
        moments.acceleration,
        moments.driven,
        moments.chain,
        moments.vehicle,
        moments.moving,
        moments.conflict,
        half[rows[order]] == 1,
        models,
    )


def _fold_row(seen: Situations, fold: Fold, task: Task) -> Row:
    return {
        "holdout": fold.holdout,
        "fold": fold.name,
        "train": int(fold.train.sum()),
        "test": int(fold.test.sum()),
        "test_drivers": len(np.unique(seen.vehicle[fold.test])),
        "test_chains": len(np.unique(seen.chain[fold.test])),
        **dict(zip(FITTED, np.exp(task.idm).tolist(), strict=True)),
    }


def choices(seen: Situations, seed: int = 0) -> ChoiceTable:
    """Return every moment as a choice among accelerations, tilted by nothing but the base model.

    The base predictor of a moment was trained on other chains (`folds`, held-out vehicles).

    Args:
        seen: All moments.
        seed: Of the base predictor.

    Raises:
        UserError: If vehicles can't be held out.
    """
    low, high, step = GRID
    grid = np.arange(low, high + step / 2, step)
    half = seen.half()
    log_base, mean = np.full((len(seen), len(grid)), np.nan), np.zeros(len(seen))
    for fold in folds(seen, "vehicles"):
        task = _task(seen, half, fold, seed)
        model = MODELS[BASE](task)
        test, last = seen.rows(fold.test), residuals(task.idm, seen)[fold.test]
        log_base[fold.test] = on_grid(model, test, last, grid)
        mean[fold.test] = np.exp(log_base[fold.test]) @ grid
    before, pair = seen.previous(), rewards(seen, grid)
    off = seen.acceleration - mean
    return ChoiceTable(
        driver=seen.vehicle,
        chain=seen.chain,
        site=seen.site,
        time=seen.time,
        half=half,
        conflict=seen.conflict & seen.moving,
        moving=seen.moving,
        grid=grid,
        log_base=log_base,
        r_env=pair.env,
        r_social=pair.social,
        acceleration=seen.acceleration,
        residual=np.where(before >= 0, off[before], 0.0),
    )


def on_grid(
    model: Fitted,
    seen: Situations,
    residual: Residuals,
    grid: Float64[np.ndarray, " candidate"],
) -> Float64[np.ndarray, "moment candidate"]:
    """Return log-probabilities of the accelerations of a grid, in proportion to the density.

    Args:
        model: The model.
        seen: Situations.
        residual: Last residuals.
        grid: m/s².
    """
    made: Forecast = model.forecast(seen, residual)
    densities = [
        model.spread.log_density(made, np.full(len(seen), acceleration), seen.moving)
        for acceleration in grid
    ]
    log_density = np.stack(densities, axis=1)
    return log_density - logsumexp(log_density, axis=1, keepdims=True)
