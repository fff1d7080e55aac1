"""Losses with heavy tails: error rates of the regret test, and the episodes that a pass needs.

The regret of a policy towards one reference is the mean of its losses. The bootstrap knows only the
sample; the bounds by betting know the largest loss that is declared.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import norm

from socialiq import Ending
from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.verdict.regret import Regrets, exceeds, loss_bounds
from socialiq.types import Row
from socialiq_lab.audit_pool import ERROR, outcomes, shares
from socialiq_lab.study import StageCallback, silent, tracked

Draw = Callable[[np.random.Generator, float, tuple[int, int]], Float[np.ndarray, "audit episode"]]


@dataclass(frozen=True)
class Tail:
    """A family of losses below a limit."""

    margin: float  # margin of the declaration
    limit: float  # largest loss possible
    draw: Draw  # draws losses of a given mean, of shape (audits, episodes)


def scale_of(mean: float, limit: float, cut_mean: Callable[[float], float]) -> float:
    """Return the scale s for which min(s X, limit) has a given mean.

    Args:
        mean: Mean of the scaled and cut losses.
        limit: Largest loss.
        cut_mean: Returns the mean of min(X, t), given t.
    """
    low = 1e-9 * limit
    high = limit
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if middle * cut_mean(limit / middle) < mean else (low, middle)
    return low


SIGMA = 2.0  # of the lognormal tail
SHAPE = 1.5  # of the Pareto tail
_DEVIATION = 1.5  # of the light tails


def lognormal_cut(t: float) -> float:
    """Return the mean of min(X, t) for ln X normal with mean 0 and deviation `SIGMA`."""
    quantile = np.log(t) / SIGMA
    inside = np.exp(SIGMA**2 / 2) * norm.cdf(quantile - SIGMA)
    return float(inside + t * norm.sf(quantile))


def pareto_cut(t: float) -> float:
    """Return the mean of min(X, t) for P(X > x) = x^-`SHAPE` from 1 on."""
    if t <= 1.0:
        return t
    return (SHAPE - t ** (1.0 - SHAPE)) / (SHAPE - 1.0)


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
    return (mean + _DEVIATION * rng.normal(size=shape)).clip(-limit, limit)


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

TOO_LOW = 0.2  # declared share of the limit, where the declaration is false
SIZES = (250, 500, 1000, 2000, 4000, 8000)  # numbers of episodes in the table of the price
LONGER = 8  # factor of the episodes of a long audit
_TAILS = 6108  # makes these draws independent of others from the same seed


def error_rows(config: Any, on_stage: StageCallback = silent) -> list[Row]:
    """Return the shares of passes by each bound, with 99 % intervals, over audits of each case.

    Args:
        config: Configuration of the study.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each of `TAILS` and `TIMES`, with the shares `bootstrap` and `betting`.
    """
    cases = list(itertools.product(TAILS, TIMES))
    return [
        {
            "losses": name,
            "regret": label,
            "margins": TIMES[label],
            "largest_loss_in_margins": TAILS[name].limit / TAILS[name].margin,
        }
        | _passes(name, label, config.replications, config.episodes, config)
        for name, label in tracked(cases, on_stage, "heavy tails", "cases")
    ]


def price_rows(config: Any, on_stage: StageCallback = silent) -> list[Row]:
    """Return the passes of policies well within their margin by number of episodes, with intervals.

    Args:
        config: Configuration of the study.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each of `TAILS` and `SIZES`, with the shares `bootstrap` and `betting`.
    """
    audits = max(1, config.replications // 8)
    cases = list(itertools.product(TAILS, SIZES))
    return [
        {"losses": name, "episodes": episodes}
        | _passes(name, "well within", audits, episodes, config)
        for name, episodes in tracked(cases, on_stage, "price", "cases")
    ]


def long_audit_rows(config: Any) -> list[Row]:
    """Return the shares of wrong passes by betting in audits `LONGER` times as long.

    Args:
        config: Configuration of the study.

    Returns:
        A row for each of `TAILS`, whose true regret is the margin.
    """
    rows: list[Row] = []
    audits = config.replications
    episodes = LONGER * config.episodes
    for name, tail in TAILS.items():
        losses = _drawn(name, "at the margin", audits, episodes, config.first_seed)
        passed, _ = decisions_by_betting(losses, tail.margin, tail.limit)
        rows.append({"losses": name, "episodes": episodes} | shares(audits, betting=passed))
    return rows


def false_bound_rows(config: Any) -> list[Row]:
    """Return the decisions on policies that declare too low a largest loss.

    The policies are those of `error_rows` whose regret is the margin.

    Args:
        config: Configuration of the study.

    Returns:
        A row for each of `TAILS`: the share that `passed`, and the share in which a loss beyond the
        declared one is `seen`.
    """
    rows: list[Row] = []
    audits = config.replications
    for name, tail in TAILS.items():
        losses = _drawn(name, "at the margin", audits, config.episodes, config.first_seed)
        passed, broken = decisions_by_betting(losses, tail.margin, TOO_LOW * tail.limit)
        label = {"losses": name, "possible": tail.limit, "declared": TOO_LOW * tail.limit}
        rows.append(label | shares(audits, passed=passed, seen=broken))
    return rows


def _drawn(name: str, regret: str, audits: int, episodes: int, seed: int) -> np.ndarray:
    tail = TAILS[name]
    number = list(TAILS).index(name)
    times = TIMES[regret]
    rng = np.random.default_rng([_TAILS, seed, number, round(100 * times), episodes])
    return tail.draw(rng, times * tail.margin, (audits, episodes))


def _passes(name: str, regret: str, audits: int, episodes: int, config: Any) -> Row:
    """Return the shares of passes by both bounds."""
    losses = _drawn(name, regret, audits, episodes, config.first_seed)
    tail = TAILS[name]
    usual = passes_by_bootstrap(losses, tail.margin, config.first_seed, config.resamples)
    guarded, _ = decisions_by_betting(losses, tail.margin, tail.limit)
    return shares(audits, bootstrap=usual, betting=guarded)


def passes_by_bootstrap(
    losses: Float[np.ndarray, "audit episode"], margin: float, seed: int, resamples: int
) -> int:
    """Return the number of audits whose upper bound by the bootstrap is within the margin.

    Args:
        losses: Losses of the policy towards one reference, (audit, episode).
        margin: Margin of the declaration, reward of an episode.
        seed: Seed of the resamples of the first audit; audit k has seed + k.
        resamples: Number of bootstrap resamples.
    """
    count = 0
    for number, row in enumerate(losses):
        still = np.zeros(len(row))
        arrived = np.full(len(row), Ending.ARRIVAL)
        policy, reference = (
            outcomes(name, np.stack([env, still], axis=1), arrived, still)
            for name, env in (("policy", -row), ("reference", still))
        )
        evidence = Evidence("made up", np.arange(len(row)), policy, (reference,), {})
        highs = Regrets(evidence, seed + number, resamples).highs(0.0, ERROR)
        count += bool(highs[0] <= margin)
    return count


def decisions_by_betting(
    losses: Float[np.ndarray, "audit episode"], margin: float, declared: float
) -> tuple[int, int]:
    """Return the numbers of passes and of fails with a declared largest loss.

    Args:
        losses: Losses of the policy towards one reference, (audit, episode).
        margin: Margin of the declaration, reward of an episode.
        declared: Declared largest loss of an episode.

    Returns:
        Number of passes, and number of fails. An audit fails if a loss exceeds the declared one.
    """
    compared = np.ones(len(losses), bool)
    broken = np.array([exceeds(float(row.max()), declared) for row in losses])
    highs = loss_bounds(losses, compared, margin, declared, ERROR, ERROR / 2).highs
    return int(((highs <= margin) & ~broken).sum()), int(broken.sum())
