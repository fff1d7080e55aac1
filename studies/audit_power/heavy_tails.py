"""Losses with heavy tails: error rates of the regret test, and the episodes that a pass needs.

The regret of a policy towards one reference is the mean of its losses. The bootstrap knows only the
sample; the bounds by betting know the largest loss that is declared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import norm

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.verdict.bounds import Regrets, exceeds, loss_bounds
from socialiq.statistics.intervals import wilson
from socialiq.types import Ending, Row

ERROR = 0.05

Draw = Callable[[np.random.Generator, float, tuple[int, int]], Float[np.ndarray, "audit episode"]]


@dataclass(frozen=True)
class Tail:
    """A family of losses below a limit.

    Attributes:
        margin: Margin of the declaration.
        limit: Largest loss possible.
        draw: Draws losses of a given mean, of shape (audits, episodes).
    """

    margin: float
    limit: float
    draw: Draw


def scale_of(mean: float, limit: float, cut_mean: Callable[[float], float]) -> float:
    """Return the factor s for which min(s X, limit) has a mean, by bisection.

    Args:
        mean: Mean, below the limit.
        limit: Limit of the losses.
        cut_mean: Mean of min(X, t) by t.
    """
    low, high = 1e-9 * limit, limit
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if middle * cut_mean(limit / middle) < mean else (low, middle)
    return low


SIGMA = 2.0


def lognormal_cut(t: float) -> float:
    """Return the mean of min(X, t) for ln X normal with mean 0 and deviation `SIGMA`."""
    quantile = np.log(t) / SIGMA
    inside = np.exp(SIGMA**2 / 2) * norm.cdf(quantile - SIGMA)
    return float(inside + t * norm.sf(quantile))


SHAPE = 1.5


def pareto_cut(t: float) -> float:
    """Return the mean of min(X, t) for P(X > x) = x^-`SHAPE` from 1 on."""
    if t <= 1.0:
        return t
    return (SHAPE - t ** (1.0 - SHAPE)) / (SHAPE - 1.0)


DEVIATION = 1.5  # of the light tails


def _rare(rng: np.random.Generator, mean: float, shape: tuple[int, int]) -> np.ndarray:
    return np.where(rng.random(shape) < mean / 100.0, 100.0, 0.0)


def _lognormal(rng: np.random.Generator, mean: float, shape: tuple[int, int]) -> np.ndarray:
    limit = TAILS["lognormal, sigma 2"].limit
    sample = rng.lognormal(0.0, SIGMA, shape)
    return np.minimum(scale_of(mean, limit, lognormal_cut) * sample, limit)


def _pareto(rng: np.random.Generator, mean: float, shape: tuple[int, int]) -> np.ndarray:
    limit = TAILS["Pareto, shape 1.5"].limit
    sample = 1.0 + rng.pareto(SHAPE, shape)
    return np.minimum(scale_of(mean, limit, pareto_cut) * sample, limit)


def _normal(rng: np.random.Generator, mean: float, shape: tuple[int, int]) -> np.ndarray:
    limit = TAILS["normal"].limit
    # The limit is more than six deviations away on both sides: cutting changes no digit shown.
    return (mean + DEVIATION * rng.normal(size=shape)).clip(-limit, limit)


TAILS: Mapping[str, Tail] = {
    "100 in 0.2 % of episodes": Tail(0.2, 100.0, _rare),
    # Cut where about one episode in 10,000 reaches the limit, if the regret is the margin.
    "lognormal, sigma 2": Tail(0.25, 60.0, _lognormal),
    "Pareto, shape 1.5": Tail(0.25, 40.0, _pareto),
    "normal": Tail(0.25, 10.0, _normal),
}
"""Families of losses. For "100 in 0.2 %" the share of episodes follows the mean, for the others
the scale."""

TIMES = {"well within": 0.2, "at the margin": 1.0, "at 1.5 x the margin": 1.5}
"""True regret, in margins."""

TOO_LOW = 0.2
"""Declared share of the limit, where the declaration is false."""

SIZES = (250, 500, 1000, 2000, 4000, 8000)
"""Numbers of episodes in the table of the price."""

LONGER = 8
"""Factor of the episodes of a long audit."""

_TAILS = 6108  # makes these draws independent of others from the same seed

ProgressCallback = Callable[[int], None]


def error_rows(
    episodes: int,
    replications: int,
    seed: int,
    resamples: int = 1000,
    on_progress: ProgressCallback | None = None,
) -> list[Row]:
    """Return the shares of passes by each bound, with 99 % intervals.

    Args:
        episodes: Episodes of each audit.
        replications: Number of audits of each case.
        seed: Seed of all draws.
        resamples: Resamples of each bootstrap.
        on_progress: Called with the number of finished cases.
    """
    rows: list[Row] = []
    for name, tail in TAILS.items():
        for label, times in TIMES.items():
            losses = _drawn(name, times, replications, episodes, seed)
            usual = passes_by_bootstrap(losses, tail.margin, seed, resamples)
            guarded, _ = decisions_by_betting(losses, tail.margin, tail.limit)
            row: Row = {"losses": name, "regret": label, "margins": times}
            row |= {"largest_loss_in_margins": tail.limit / tail.margin}
            rows.append(row | _shares({"bootstrap": usual, "betting": guarded}, replications))
            if on_progress:
                on_progress(len(rows))
    return rows


def long_audit_rows(episodes: int, replications: int, seed: int) -> list[Row]:
    """Return the shares of wrong passes by betting in audits of `LONGER` times as many episodes.

    Short audits of heavy tails pass nothing, so that their errors say little.

    Args:
        episodes: Episodes of a usual audit.
        replications: Number of audits of each case.
        seed: Seed of all draws.
    """
    rows: list[Row] = []
    for name, tail in TAILS.items():
        losses = _drawn(name, TIMES["at the margin"], replications, LONGER * episodes, seed)
        passed, _ = decisions_by_betting(losses, tail.margin, tail.limit)
        row: Row = {"losses": name, "episodes": LONGER * episodes}
        rows.append(row | _shares({"betting": passed}, replications))
    return rows


def false_bound_rows(episodes: int, replications: int, seed: int) -> list[Row]:
    """Return the decisions on policies whose declared largest loss is too low.

    Args:
        episodes: Episodes of each audit.
        replications: Number of audits of each case.
        seed: Seed of all draws; the losses are those of `error_rows`.
    """
    rows: list[Row] = []
    for name, tail in TAILS.items():
        losses = _drawn(name, TIMES["at the margin"], replications, episodes, seed)
        passed, broken = decisions_by_betting(losses, tail.margin, TOO_LOW * tail.limit)
        row: Row = {"losses": name, "possible": tail.limit, "declared": TOO_LOW * tail.limit}
        rows.append(row | _shares({"passed": passed, "seen": broken}, replications))
    return rows


def price_rows(
    audits: int, seed: int, resamples: int = 1000, on_progress: ProgressCallback | None = None
) -> list[Row]:
    """Return the shares of passes of policies well within their margin, by number of episodes.

    Args:
        audits: Number of audits of each case.
        seed: Seed of all draws.
        resamples: Resamples of each bootstrap.
        on_progress: Called with the number of finished cases.
    """
    rows: list[Row] = []
    for name, tail in TAILS.items():
        for episodes in SIZES:
            losses = _drawn(name, TIMES["well within"], audits, episodes, seed)
            usual = passes_by_bootstrap(losses, tail.margin, seed, resamples)
            guarded, _ = decisions_by_betting(losses, tail.margin, tail.limit)
            row: Row = {"losses": name, "episodes": episodes}
            rows.append(row | _shares({"bootstrap": usual, "betting": guarded}, audits))
            if on_progress:
                on_progress(len(rows))
    return rows


def _drawn(name: str, times: float, audits: int, episodes: int, seed: int) -> np.ndarray:
    tail, number = TAILS[name], list(TAILS).index(name)
    rng = np.random.default_rng([_TAILS, seed, number, round(100 * times), episodes])
    return tail.draw(rng, times * tail.margin, (audits, episodes))


def _shares(counts: Mapping[str, int], audits: int) -> Row:
    row: Row = {}
    for name, count in counts.items():
        share = wilson(count, audits, 0.99)
        row |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
    return row


def passes_by_bootstrap(
    losses: Float[np.ndarray, "audit episode"], margin: float, seed: int, resamples: int
) -> int:
    """Return the number of audits whose upper bound by the bootstrap is within the margin."""
    count = 0
    for number, row in enumerate(losses):
        regrets = Regrets(_evidence(row), seed + number, resamples)
        count += bool(regrets.highs(0.0, ERROR)[0] <= margin)
    return count


def decisions_by_betting(
    losses: Float[np.ndarray, "audit episode"], margin: float, declared: float
) -> tuple[int, int]:
    """Return the numbers of passes and of fails with a declared largest loss.

    Audits are independent, so the bounds of all are computed at once, as of so many references.
    """
    compared = np.ones(len(losses), bool)
    broken = np.array([exceeds(float(row.max()), declared) for row in losses])
    highs = loss_bounds(losses, compared, margin, declared, ERROR, ERROR / 2).highs
    return int(((highs <= margin) & ~broken).sum()), int(broken.sum())


def _evidence(losses: Float[np.ndarray, " episode"]) -> Evidence:
    episodes, still = len(losses), np.zeros(len(losses))
    ending = np.full(episodes, Ending.ARRIVAL, np.int8)
    drivers = [
        Outcomes(
            name,
            np.stack([env, still], axis=1),
            ending,
            np.zeros_like(ending),
            np.ones(episodes, np.int64),
        )
        for name, env in (("policy", -losses), ("reference", still))
    ]
    return Evidence("made up", np.arange(episodes), drivers[0], (drivers[1],), {})
