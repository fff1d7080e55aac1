"""Power of the test of an angle: drivers of known angles decide at the recorded moments.

The recorded decisions are kept: their candidates, rewards, base predictor, drivers and halves. Only
what was chosen is drawn again, from the very model that is inferred: the power is an upper bound.
Larger samples repeat whole chains, with new drivers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from scipy.special import softmax

from socialiq.errors import UserError
from socialiq.recordings.prediction.choices import ChoiceTable
from socialiq.recordings.trait.choice_model import Evaluated, evaluate, reward_scale, rewards_of
from socialiq.recordings.trait.contrasts import contrasts
from socialiq.recordings.trait.models import Models, Sample, models_of
from socialiq.recordings.trait.traits import Trait, angle_trait, progress_trait
from socialiq.statistics.intervals import wilson
from socialiq.types import Row

STRENGTHS = (0.0, *(0.1 * 1.5**number for number in range(12)))
"""β of the repeats, per typical difference of reward: a coarser grid than of an inference."""

STEP = 15.0
"""Degrees between the angles of the repeats."""

POWER = 0.8
"""Share of detections that counts as enough."""

ENOUGH = 0.95
"""Share of detections above which larger samples are not drawn."""

_SHUFFLES = 2
_CERTAIN = 60.0  # β times the typical difference: above, every choice is certain


@dataclass(frozen=True)
class PowerConfig:
    """Configuration of simulated drivers.

    Attributes:
        spreads: Standard deviations of planted angles, degrees.
        mean: Mean of planted angles, degrees.
        strength: Planted β, per typical difference of reward between candidates.
        gain: Share of the error that knowing every angle saves, in the last planted population.
        sizes: Multiples of the sample at hand.
        repeats: Simulated samples of each size.
        seed: Of the first repeat.
        resamples: Of each test.
    """

    spreads: tuple[float, ...] = (0.0, 20.0, 35.0)
    mean: float = 30.0
    strength: float = 1.0
    gain: float = 0.1
    sizes: tuple[int, ...] = (1, 4, 16, 64)
    repeats: int = 40
    seed: int = 0
    resamples: int = 500

    def __post_init__(self) -> None:
        """Check every option."""
        if not self.spreads or not all(0.0 <= one <= 90.0 for one in self.spreads):
            raise UserError(f"spreads must be from 0 to 90 degrees, got {list(self.spreads)}")
        if not -180.0 <= self.mean <= 180.0:
            raise UserError(f"mean must be from -180 to 180 degrees, got {self.mean:g}")
        if not 0.0 < self.strength <= _CERTAIN:
            raise UserError(
                f"strength must be above 0 and at most {_CERTAIN}, got {self.strength:g}"
            )
        if not 0.0 < self.gain < 1.0:
            raise UserError(f"gain must be a share between 0 and 1, got {self.gain:g}")
        if not self.sizes or not all(1 <= one <= 1000 for one in self.sizes):
            raise UserError(f"sizes must be whole numbers from 1 to 1000, got {list(self.sizes)}")
        if not 1 <= self.repeats <= 10_000:
            raise UserError(f"repeats must be from 1 to 10000, got {self.repeats}")
        if self.seed < 0 or not 100 <= self.resamples <= 100_000:
            raise UserError("seed must be at least 0, and resamples from 100 to 100000")


class Planted(NamedTuple):
    """A population of simulated drivers.

    Attributes:
        spread: Standard deviation of the angles, degrees.
        mean: Mean of the angles, degrees.
        strength: β, per unit of reward.
    """

    spread: float
    mean: float
    strength: float

    def weights(self, angle: Float[np.ndarray, " driver"]) -> Float[np.ndarray, "driver 2"]:
        """Return the weights of both rewards, of angles in degrees."""
        radians = np.radians(angle)
        return self.strength * np.stack([np.cos(radians), np.sin(radians)], axis=1)


def larger_sample(sample: Sample, size: int, rng: np.random.Generator) -> tuple[Sample, np.ndarray]:
    """Return a sample of `size` times as many chains, and the row of each of its decisions.

    With size 1 it is the sample itself; otherwise chains are drawn with replacement. Each draw is a
    chain of its own with drivers of its own.

    Args:
        sample: The sample at hand.
        size: How many times as many chains.
        rng: Generator of the draws.
    """
    chains = int(sample.chain.max()) + 1
    drawn = np.arange(chains) if size == 1 else rng.integers(chains, size=size * chains)
    of_chain = [np.flatnonzero(sample.chain[sample.driver] == one) for one in range(chains)]
    rows = np.concatenate([of_chain[one] for one in drawn])
    place = np.repeat(np.arange(len(drawn)), [len(of_chain[one]) for one in drawn])
    number = place * len(sample.chain) + sample.driver[rows]
    identity, first, driver = np.unique(number, return_index=True, return_inverse=True)
    table = _with_rows(sample.table, rows, driver, place)
    return Sample(table, driver.astype(np.int64), place[first], identity), rows


def _with_rows(
    table: ChoiceTable, rows: np.ndarray, driver: np.ndarray, chain: np.ndarray
) -> ChoiceTable:
    columns = {name: one[rows] for name, one in table.arrays().items() if name != "grid"}
    return dataclasses.replace(
        table, **(columns | {"driver": driver.astype(np.int64), "chain": chain.astype(np.int64)})
    )


def decide(
    sample: Sample,
    weights: Float[np.ndarray, "driver 2"],
    rng: np.random.Generator,
) -> Sample:
    """Return the sample with choices drawn by p(a | s), for weights of each driver.

    Args:
        sample: The decisions.
        weights: Of r_env and r_social, by driver.
        rng: Generator of the draws.
    """
    table = sample.table
    score = np.einsum("dcr,dr->dc", rewards_of(table), weights[sample.driver])
    below = softmax(table.log_base + score, axis=1).cumsum(axis=1)
    drawn = (below < rng.random((len(table), 1)) * below[:, -1:]).sum(axis=1)
    acceleration = table.grid[drawn]
    off = acceleration - np.exp(table.log_base) @ table.grid
    residual = before(off, sample.driver, table.time)
    table = dataclasses.replace(table, acceleration=acceleration, residual=residual)
    return sample._replace(table=table)


def before(
    values: Float[np.ndarray, " decision"],
    driver: Int64[np.ndarray, " decision"],
    time: Float[np.ndarray, " decision"],
) -> Float[np.ndarray, " decision"]:
    """Return the value of each driver's decision before, in time; 0 at the first."""
    order = np.lexsort([time, driver])
    same = driver[order][1:] == driver[order][:-1]
    found = np.zeros(len(values))
    found[order[1:]] = np.where(same, values[order][:-1], 0.0)
    return found


def known_angle_gain(sample: Sample, planted: Planted, draws: int = 61) -> float:
    """Return the share of the RMSE that knowing every driver's angle saves, of second halves.

    With m_α the mean choice of a driver of angle α and v_α its variance, the error is E[v_α] if α
    is known and E[v_α] + Var[m_α] if only the population is.

    Args:
        sample: The decisions.
        planted: The population.
        draws: Number of angles, at quantiles of a normal distribution.
    """
    from scipy.stats import norm

    table = sample.table.rows(sample.second)
    angle = planted.mean + planted.spread * norm.ppf((np.arange(draws) + 0.5) / draws)
    mean, variance = np.empty((2, draws, len(table)))
    for place, weight in enumerate(planted.weights(angle)):
        chance = softmax(table.log_base + rewards_of(table) @ weight, axis=1)
        mean[place] = chance @ table.grid
        variance[place] = chance @ table.grid**2 - mean[place] ** 2
    known = variance.mean()
    return 1.0 - float(np.sqrt(known / (known + mean.var(axis=0).mean())))


def strength_of_gain(sample: Sample, spread: float, mean: float, gain: float) -> float | None:
    """Return the least β, per unit of reward, with which known angles save a share of the error.

    Args:
        sample: The decisions.
        spread: Of the angles, degrees.
        mean: Of the angles, degrees.
        gain: The share.

    Returns:
        β to 1 %, by bisection; None if no β saves as much on these moments.
    """
    scale = reward_scale(sample.table)
    tried = np.geomspace(0.05, _CERTAIN, 40) / scale
    gains = [known_angle_gain(sample, Planted(spread, mean, one)) for one in tried]
    enough = np.flatnonzero(np.array(gains) >= gain)
    if len(enough) == 0:
        return None
    high = float(tried[enough[0]])
    low = float(tried[enough[0] - 1]) if enough[0] else 0.0
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        if known_angle_gain(sample, Planted(spread, mean, middle)) >= gain:
            high = middle
        else:
            low = middle
    return high


class Grids(NamedTuple):
    """Both traits on the grids of the repeats."""

    angle: Trait
    gain: Trait

    @staticmethod
    def of(sample: Sample) -> Grids:
        """Return the grids for the rewards of a sample."""
        scale = reward_scale(sample.table)
        return Grids(
            angle_trait(STEP, strengths=STRENGTHS, scale=scale),
            progress_trait(STRENGTHS, scale=scale),
        )


class Tabulated(NamedTuple):
    """Predictions of every candidate at every decision and grid point of a trait.

    Attributes:
        log_p: By decision, candidate, shared number and value.
        mean: By decision, shared number and value.
    """

    log_p: Float[np.ndarray, "decision candidate shared value"]
    mean: Float[np.ndarray, "decision shared value"]

    @staticmethod
    def of(table: ChoiceTable, trait: Trait) -> Tabulated:
        """Evaluate all candidates once, so that repeats only look them up."""
        each = [
            evaluate(dataclasses.replace(table, acceleration=np.full(len(table), candidate)), trait)
            for candidate in table.grid
        ]
        return Tabulated(np.stack([one.log_likelihood for one in each], axis=1), each[0].mean)

    def at(self, rows: np.ndarray, chosen: Int64[np.ndarray, " decision"]) -> Evaluated:
        """Return the predictions of some rows for what was chosen there."""
        return Evaluated(self.log_p[rows, chosen], self.mean[rows])


class Simulator:
    """Repeats of a planted population on the decisions of a sample.

    Args:
        sample: The sample at hand.
        config: The configuration.
    """

    def __init__(self, sample: Sample, config: PowerConfig) -> None:
        self._sample, self._config = sample, config
        self._grids = Grids.of(sample)
        self._angle, self._gain = (Tabulated.of(sample.table, one) for one in self._grids)

    def models(self, planted: Planted, size: int, seed: Sequence[int]) -> Models:
        """Return the models of one simulated sample."""
        rng = np.random.default_rng(seed)
        sample, rows = larger_sample(self._sample, size, rng)
        angle = planted.mean + planted.spread * rng.standard_normal(len(sample.chain))
        drawn = decide(sample, planted.weights(angle), rng)
        chosen = drawn.table.chosen
        return models_of(
            drawn,
            self._grids.angle,
            self._angle.at(rows, chosen),
            self._grids.gain,
            self._gain.at(rows, chosen),
            int(rng.integers(2**31)),
            _SHUFFLES,
        )

    def row(self, planted: Planted, size: int, counted: Callable[[], None] | None = None) -> Row:
        """Return gains and shares of detections over all repeats of a size."""
        config, found = self._config, []
        for repeat in range(config.repeats):
            seed = [config.seed, repeat, size, round(100 * planted.spread)]
            tests = contrasts(self.models(planted, size, seed), repeat, config.resamples)
            every = all(one["found"] for one in tests)
            found.append([tests[0][name] for name in ("gain_nats", "rmse_gain", "found")] + [every])
            if counted:
                counted()
        nats, error, detected, gate = np.array(found, np.float64).T
        share = wilson(int(detected.sum()), config.repeats)
        return {
            "size": size,
            "drivers": size * len(self._sample.chain),
            "chains": size * (int(self._sample.chain.max()) + 1),
            "decisions": size * len(self._sample.table),
            "gain_nats": float(nats.mean()),
            "rmse_gain": float(error.mean()),
            "detected": share.value,
            "low": share.low,
            "high": share.high,
            "beats_every_rival": float(gate.mean()),
            "repeats": config.repeats,
        }


def populations(sample: Sample, config: PowerConfig) -> list[tuple[str, Planted]]:
    """Return the planted populations: each spread, and the one whose known angles save `gain`.

    The last is left out where no strength saves as much on these moments.
    """
    strength = config.strength / reward_scale(sample.table)
    found = [
        (f"spread {spread:g}", Planted(spread, config.mean, strength)) for spread in config.spreads
    ]
    widest = max(config.spreads)
    needed = strength_of_gain(sample, widest, config.mean, config.gain) if widest > 0 else None
    if needed is not None:
        name = f"spread {widest:g}, {100 * config.gain:g} % if known"
        found.append((name, Planted(widest, config.mean, needed)))
    return found


def power_rows(
    sample: Sample, config: PowerConfig, counted: Callable[[], None] | None = None
) -> list[Row]:
    """Return for each planted population and size the gains and the shares of detections.

    Args:
        sample: The sample at hand.
        config: The configuration.
        counted: Called after each repeat.

    Returns:
        Rows by population and size, without sizes larger than one that nearly always detects.

    Raises:
        UserError: If all candidates of all decisions have equal rewards: nothing tells angles
            apart.
    """
    if not np.ptp(rewards_of(sample.table), axis=1).any():
        raise UserError("every candidate has the same rewards: no choice can show an angle")
    simulator, scale = Simulator(sample, config), reward_scale(sample.table)
    rows: list[Row] = []
    for name, planted in populations(sample, config):
        known = known_angle_gain(sample, planted)
        head = {"population": name, "spread": planted.spread, "strength": planted.strength * scale}
        for size in sorted(config.sizes):
            row = simulator.row(planted, size, counted)
            rows.append(head | {"known_angle_gain": known} | row)
            if planted.spread > 0 and row["detected"] >= ENOUGH:
                break  # larger samples find it too
    return rows


def needed_rows(rows: Sequence[Row]) -> list[Row]:
    """Return for each planted population the size that finds it with a chance of `POWER`.

    Between two sizes the share is taken as linear in the logarithm of the size. A population
    without spread needs none: its detections are errors.

    Args:
        rows: Result of `power_rows`.
    """
    found: list[Row] = []
    for name in dict.fromkeys(row["population"] for row in rows):
        mine = sorted((row for row in rows if row["population"] == name), key=lambda r: r["size"])
        size = _size_of(mine) if mine[0]["spread"] > 0 else None
        first, last = mine[0], mine[-1]
        found.append(
            {
                "population": name,
                "known_angle_gain": first["known_angle_gain"],
                "detected_now": first["detected"],
                "size_needed": size,
                "more_than": None if size is not None or not first["spread"] else last["size"],
                "drivers_needed": size and round(size * first["drivers"] / first["size"]),
                "chains_needed": size and round(size * first["chains"] / first["size"]),
            }
        )
    return found


def _size_of(rows: Sequence[Row]) -> float | None:
    """Return the smallest size at which the share of detections reaches `POWER`."""
    for place, row in enumerate(rows):
        if row["detected"] >= POWER:
            if place == 0:
                return float(row["size"])
            low = rows[place - 1]
            way = (POWER - low["detected"]) / (row["detected"] - low["detected"])
            return float(low["size"] * (row["size"] / low["size"]) ** way)
    return None
