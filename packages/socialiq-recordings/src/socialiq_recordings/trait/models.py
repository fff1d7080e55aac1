"""Predictions of the second half of drivers' conflicts from the first, by the angle and by rivals.

Of a driver's own chain nothing but its first half is used: the population comes from the first
halves of the other chains. Every model has the same decisions and the same base predictor:

- base: no reward.
- population: one angle for all drivers.
- angle: an angle by driver.
- progress gain: a weight of r_env by driver, which says nothing about others.
- last residual: the error of the base predictor that is known as the second half begins.
- running residual: its error at the decision before, which no other model knows.
- shuffled angle: the posterior of another driver's angle, in turn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from scipy.special import log_softmax

from socialiq.errors import UserError
from socialiq.statistics.clusters import cluster_mean, clusters_needed
from socialiq.statistics.comparisons import holm
from socialiq.types import Row
from socialiq_recordings.prediction.choices import ChoiceTable
from socialiq_recordings.trait import traits
from socialiq_recordings.trait.hierarchy import Inference, driver_log_likelihood, infer
from socialiq_recordings.trait.traits import Evaluated, Trait, evaluate

GAINS = np.linspace(-1.0, 1.0, 41)
"""κ of residuals: of a normal prediction the mean moves by κ times the residual."""

SHUFFLES = 20  # turns of the shuffled angle
_NARROWER = 4  # times that a grid is narrowed at most
_LEFT = 1e-4  # probability, over that of the likeliest point, above which a point of a grid is left


class Sample(NamedTuple):
    """Decisions in conflict of drivers with both halves."""

    table: ChoiceTable  # the decisions
    driver: Int64[np.ndarray, " decision"]  # number of each decision's driver, from 0
    chain: Int64[np.ndarray, " driver"]  # number of each driver's chain, from 0
    identity: Int64[np.ndarray, " driver"]  # each driver's number in the table

    @property
    def second(self) -> np.ndarray:
        """Whether each decision is of a second half: it is predicted, and nothing else."""
        return self.table.half == 1


def sample_of(table: ChoiceTable) -> Sample:
    """Return the decisions in conflict of the drivers that have some in either half.

    Raises:
        UserError: If there is no such driver.
    """
    table = table.rows(table.conflict)
    first, second = (np.unique(table.driver[table.half == half]) for half in (0, 1))
    with_both = np.intersect1d(first, second)
    if len(with_both) == 0:
        raise UserError(
            "no driver has decisions in conflict in both halves: longer recordings are needed"
        )
    table = table.rows(np.isin(table.driver, with_both))
    identity, first_row, driver = np.unique(table.driver, return_index=True, return_inverse=True)
    chain = np.unique(table.chain[first_row], return_inverse=True)[1]
    return Sample(table, driver.astype(np.int64), chain.astype(np.int64), identity)


class Models(NamedTuple):
    """Predictions of second halves, by model."""

    sample: Sample  # the decisions
    predictions: dict[str, Evaluated]  # by name, of the decisions of second halves
    angle: Inference  # the inferred angle


def fit_models(table: ChoiceTable, seed: int, step: float = 5.0) -> Models:
    """Infer every trait from first halves and predict second halves.

    `step` is that of the angles integrated over, degrees, before grids are narrowed to what first
    halves leave (`traits`). `seed` is that of the shuffling.

    Raises:
        UserError: If fewer than two drivers have decisions in conflict in both halves.
    """
    sample = sample_of(table)
    if len(sample.identity) < 2:
        raise UserError("one driver has decisions in both halves: at least two are needed")
    scale = traits.reward_scale(sample.table)
    angle, gain = traits.angle_trait(step, scale=scale), traits.progress_trait(scale=scale)
    second, driver = sample.second, sample.driver[sample.second]
    table = sample.table.rows(second)
    base = np.exp(table.log_base) @ table.grid
    chosen = np.take_along_axis(table.log_base, table.chosen[:, None], axis=1)[:, 0]
    alike, of_alike = _narrowed(sample, angle.alike())
    progress, of_progress = _narrowed(sample, gain)
    inferred, later = _narrowed(sample, angle)
    predictions = {
        "base": Evaluated(chosen, base),
        "population": predict(of_alike, alike.drivers, driver),
        "progress gain": predict(of_progress, progress.drivers, driver),
        "angle": predict(later, inferred.drivers, driver),
        **_residual_models(sample, alike),
    }
    rng, count = np.random.default_rng(seed), len(inferred.drivers)
    turns = []
    for _ in range(SHUFFLES):
        cycle = rng.permutation(count)  # each driver gets the next one's: no driver gets its own
        next_driver = np.empty(count, np.int64)
        next_driver[cycle] = np.roll(cycle, 1)
        turns.append(predict(later, inferred.drivers, next_driver[driver]))
    predictions["shuffled angle"] = Evaluated(
        np.mean([turn.log_likelihood for turn in turns], axis=0),
        np.mean([turn.mean for turn in turns], axis=0),
    )
    return Models(sample, predictions, inferred)


def _narrowed(sample: Sample, trait: Trait) -> tuple[Inference, Evaluated]:
    """Return what first halves say of a trait, on narrowed grids, and its points."""
    first, drivers = ~sample.second, len(sample.chain)
    narrower = 0
    while True:
        evaluated = evaluate(sample.table, trait)
        of_decision = evaluated.log_likelihood[first]
        log_likelihood = driver_log_likelihood(of_decision, sample.driver[first], drivers)
        inferred = infer(log_likelihood, sample.chain, trait)
        finer = trait.narrowed(*inferred.left(_LEFT)) if narrower < _NARROWER else None
        if finer is None:
            return inferred, evaluated.rows(sample.second)
        trait, narrower = finer, narrower + 1


def predict(
    evaluated: Evaluated,
    posterior: Float[np.ndarray, "driver shared value"],
    driver: Int64[np.ndarray, " decision"],
) -> Evaluated:
    """Return the predictions with the trait integrated out over each decision's own posterior.

    log Σ p(shared, z | first half) p(a | s, shared, z), and the mean under the same mixture.
    `driver` is the row of each decision's posterior.
    """
    weight = posterior[driver]
    within = np.einsum("dsv,dsv->d", weight, np.exp(evaluated.log_likelihood))
    mean = np.einsum("dsv,dsv->d", weight, evaluated.mean)
    return Evaluated(np.log(np.maximum(within, np.finfo(np.float64).tiny)), mean)


def _residual_models(sample: Sample, alike: Inference) -> dict[str, Evaluated]:
    """Return predictions by residuals r: p(a | s) proportional to p_pop(a | s) exp(κ r a / v)."""
    table, second = sample.table, sample.second
    rewards, fold = traits.rewards_of(table), alike.fold[sample.driver]
    # Log p of every candidate by the mean weights of the population of other chains.
    log_population = np.empty_like(table.log_base)
    for number, population in enumerate(alike.others):
        rows = fold == number
        weights = np.tensordot(population.driver_prior, population.trait.weights, 2)
        score = np.einsum("dcr,r->dc", rewards[rows], weights)
        log_population[rows] = log_softmax(table.log_base[rows] + score, axis=1)
    running = _tilted(log_population, table, table.residual)
    without = [~second & (fold != number) for number in range(len(alike.others))]
    of_others = np.array([running.log_likelihood[rows].sum(axis=0) for rows in without])
    weight = np.exp(of_others - of_others.max(axis=1, keepdims=True))
    posterior = (weight / weight.sum(axis=1, keepdims=True))[:, None, :]
    # Each driver's residual at the first decision of its second half: the earliest is written last.
    rows = np.flatnonzero(second)
    rows = rows[np.argsort(table.time[rows], kind="stable")][::-1]
    began = np.zeros(len(sample.chain))
    began[sample.driver[rows]] = table.residual[rows]
    last = _tilted(log_population, table, began[sample.driver])
    predictions = {}
    for name, tilted in (("last residual", last), ("running residual", running)):
        later = Evaluated(tilted.log_likelihood[second, None], tilted.mean[second, None])
        predictions[name] = predict(later, posterior, fold[second])
    return predictions


def _tilted(
    log_population: Float[np.ndarray, "decision candidate"],
    table: ChoiceTable,
    residual: Float[np.ndarray, " decision"],
) -> Evaluated:
    """Return predictions for each κ of `GAINS`, each (decision, gain)."""
    chance = np.exp(log_population)
    mean = chance @ table.grid
    variance = np.maximum(chance @ table.grid**2 - mean**2, 1e-6)
    tilt = np.einsum("d,k,c->dkc", residual / variance, GAINS, table.grid)
    log_p = log_softmax(log_population[:, None, :] + tilt, axis=2)
    chosen = np.take_along_axis(log_p, table.chosen[:, None, None], axis=2)[..., 0]
    return Evaluated(chosen, np.exp(log_p) @ table.grid)


RIVALS = ("population", "progress gain", "last residual", "running residual", "shuffled angle")
"""Models that the angle must be better than, and what it would show: that drivers differ, in what
they do about others, for longer than a moment, and each in its own way."""

ERROR = 0.05  # chance that any contrast is called a gain though none is


def scores(models: Models) -> list[Row]:
    """Return the mean log-likelihood and the error of every model, by model."""
    observed = models.sample.table.acceleration[models.sample.second]
    base = models.predictions["base"]
    return [
        {
            "model": name,
            "decisions": len(observed),
            "log_likelihood": float(prediction.log_likelihood.mean()),
            "gain_nats": float((prediction.log_likelihood - base.log_likelihood).mean()),
            "rmse": float(np.sqrt(np.mean((observed - prediction.mean) ** 2))),
        }
        for name, prediction in models.predictions.items()
    ]


def contrasts(models: Models, seed: int, resamples: int = 2000) -> list[Row]:
    """Return what the angle gains over each rival, with intervals by chain and Holm's correction.

    The differences of log-likelihoods are tested. Those of errors are given with intervals. `seed`
    is that of the resampling.
    """
    sample, angle, rows = models.sample, models.predictions["angle"], []
    chain = sample.chain[sample.driver[sample.second]]
    observed = sample.table.acceleration[sample.second]
    for name in RIVALS:
        rival = models.predictions[name]
        gain = cluster_mean(angle.log_likelihood - rival.log_likelihood, chain, seed, resamples)
        squared = [(observed - prediction.mean) ** 2 for prediction in (rival, angle)]
        less = cluster_mean(squared[0] - squared[1], chain, seed, resamples)
        row: Row = {"angle_over": name, "gain_nats": gain.mean, "low": gain.low, "high": gain.high}
        rmse_gain = 1.0 - float(np.sqrt(squared[1].mean() / squared[0].mean()))
        row |= {"p": gain.p, "rmse_gain": rmse_gain, "less_squared_error": less.mean}
        row |= {"error_low": less.low, "error_high": less.high, "decisions": len(observed)}
        rows.append(row | {"chains": gain.clusters})
    for row, p in zip(rows, holm([row["p"] for row in rows]).tolist(), strict=True):
        row |= {"p_holm": p, "found": bool(p <= ERROR and row["gain_nats"] > 0)}
    return rows


def chains_to_find_anything() -> int:
    """Return the fewest chains with which any contrast can be found at all."""
    return clusters_needed(ERROR, len(RIVALS))
