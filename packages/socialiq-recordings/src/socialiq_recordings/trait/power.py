"""Power of the test of an angle: drivers of known angles decide at the recorded moments.

The recorded decisions are kept: their candidates, rewards, base predictor, drivers and halves. Only
what was chosen is drawn again, from the very model that is inferred, so the power is an upper
bound. Larger samples repeat whole chains, with new drivers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from matplotlib.figure import Figure
from scipy.special import softmax
from scipy.stats import norm

from socialiq.errors import UserError
from socialiq.plotting.style import COLORS, figure, finish
from socialiq.statistics.intervals import wilson
from socialiq.types import Row
from socialiq_recordings.trait import traits
from socialiq_recordings.trait.models import Models, Sample, contrasts, models_of
from socialiq_recordings.trait.traits import Evaluated, Tabulated, Trait, reward_scale, rewards_of

CERTAIN = 60.0  # β times the typical difference of reward above which every choice is certain
STRENGTHS = (0.0, *(0.1 * 1.5**number for number in range(12)))
"""β of the repeats, per typical difference of reward: a coarser grid than of an inference."""

STEP = 15.0  # degrees between the angles of the repeats
POWER = 0.8  # share of detections that counts as enough
ENOUGH = 0.95  # share of detections above which larger samples are not drawn
_SHUFFLES = 2
_QUANTILES = 61  # of a normal distribution, that stand for known angles


Grids = list[tuple[Trait, Tabulated]]
"""Grids of the angle and of the progress gain, with the predictions of their points."""

Counted = Callable[[], None] | None


class Planted(NamedTuple):
    """A population of simulated drivers."""

    spread: float  # standard deviation of the angles, degrees
    mean: float  # mean of the angles, degrees
    strength: float  # β, per unit of reward

    def weights(self, angle: Float[np.ndarray, " driver"]) -> Float[np.ndarray, "driver 2"]:
        """Return the weights of both rewards, of angles in degrees."""
        radians = np.radians(angle)
        return self.strength * np.stack([np.cos(radians), np.sin(radians)], axis=1)


def larger_sample(sample: Sample, size: int, rng: np.random.Generator) -> tuple[Sample, np.ndarray]:
    """Return a sample of `size` times as many chains, and the row of each of its decisions.

    With size 1 it is the sample itself; otherwise chains are drawn with replacement. Each draw is a
    chain of its own with drivers of its own.
    """
    chains = int(sample.chain.max()) + 1
    numbers = np.arange(chains) if size == 1 else rng.integers(chains, size=size * chains)
    of_chain = [np.flatnonzero(sample.chain[sample.driver] == number) for number in range(chains)]
    rows = np.concatenate([of_chain[number] for number in numbers])
    chain = np.repeat(np.arange(len(numbers)), [len(of_chain[number]) for number in numbers])
    identity, first, driver = np.unique(
        chain * len(sample.chain) + sample.driver[rows], return_index=True, return_inverse=True
    )
    driver, chain = driver.astype(np.int64), chain.astype(np.int64)
    table = dataclasses.replace(sample.table.rows(rows), driver=driver, chain=chain)
    return Sample(table, driver, chain[first], identity), rows


def decide(
    sample: Sample, weights: Float[np.ndarray, "driver 2"], rng: np.random.Generator
) -> Sample:
    """Return the sample with choices drawn by p(a | s), for weights of both rewards by driver."""
    table = sample.table
    score = np.einsum("dcr,dr->dc", rewards_of(table), weights[sample.driver])
    below = softmax(table.log_base + score, axis=1).cumsum(axis=1)
    choice = (below < rng.random((len(table), 1)) * below[:, -1:]).sum(axis=1)
    acceleration = table.grid[choice]
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
    earlier = np.zeros(len(values))
    earlier[order[1:]] = np.where(same, values[order][:-1], 0.0)
    return earlier


def known_angle_gain(sample: Sample, planted: Planted) -> float:
    """Return the share of the RMSE that knowing every driver's angle saves, of second halves.

    With m_α the mean choice of a driver of angle α and v_α its variance, the error is E[v_α] if α
    is known and E[v_α] + Var[m_α] if only the population is.
    """
    table = sample.table.rows(sample.second)
    quantiles = norm.ppf((np.arange(_QUANTILES) + 0.5) / _QUANTILES)
    mean, variance = np.empty((2, _QUANTILES, len(table)))
    for number, weight in enumerate(planted.weights(planted.mean + planted.spread * quantiles)):
        chance = softmax(table.log_base + rewards_of(table) @ weight, axis=1)
        mean[number] = chance @ table.grid
        variance[number] = chance @ table.grid**2 - mean[number] ** 2
    error_if_known = variance.mean()
    return 1.0 - float(np.sqrt(error_if_known / (error_if_known + mean.var(axis=0).mean())))


def strength_of_gain(sample: Sample, spread: float, mean: float, gain: float) -> float | None:
    """Return the least β, per unit of reward, with which known angles save a share of the error.

    β to 1 %, by bisection; None if no β saves as much on these moments.
    """
    tried = np.geomspace(0.05, CERTAIN, 40) / reward_scale(sample.table)
    gains = [known_angle_gain(sample, Planted(spread, mean, strength)) for strength in tried]
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
        if not self.spreads or not all(0.0 <= spread <= 90.0 for spread in self.spreads):
            raise UserError(f"spreads must be from 0 to 90 degrees, got {list(self.spreads)}")
        if not -180.0 <= self.mean <= 180.0:
            raise UserError(f"mean must be from -180 to 180 degrees, got {self.mean:g}")
        if not 0.0 < self.strength <= CERTAIN:
            raise UserError(
                f"strength must be above 0 and at most {CERTAIN}, got {self.strength:g}"
            )
        if not 0.0 < self.gain < 1.0:
            raise UserError(f"gain must be a share between 0 and 1, got {self.gain:g}")
        if not self.sizes or not all(1 <= size <= 1000 for size in self.sizes):
            raise UserError(f"sizes must be whole numbers from 1 to 1000, got {list(self.sizes)}")
        if not 1 <= self.repeats <= 10_000:
            raise UserError(f"repeats must be from 1 to 10000, got {self.repeats}")
        if self.seed < 0 or not 100 <= self.resamples <= 100_000:
            raise UserError("seed must be at least 0, and resamples from 100 to 100000")


def _row(
    sample: Sample, config: PowerConfig, grids: Grids, planted: Planted, size: int, counted: Counted
) -> Row:
    """Return gains and shares of detections over all repeats of a size."""
    outcomes = []
    for repeat in range(config.repeats):
        rng = np.random.default_rng([config.seed, repeat, size, round(100 * planted.spread)])
        models = _models(sample, grids, planted, size, rng)
        tests = contrasts(models, repeat, config.resamples)
        every = all(test["found"] for test in tests)
        outcomes.append([tests[0][name] for name in ("gain_nats", "rmse_gain", "found")] + [every])
        if counted:
            counted()
    nats, error, detected, gate = np.array(outcomes, np.float64).T
    share = wilson(int(detected.sum()), config.repeats)
    row: Row = {
        "size": size,
        "drivers": size * len(sample.chain),
        "chains": size * (int(sample.chain.max()) + 1),
        "decisions": size * len(sample.table),
        "gain_nats": float(nats.mean()),
        "rmse_gain": float(error.mean()),
        "detected": share.value,
        "low": share.low,
        "high": share.high,
    }
    return row | {"beats_every_rival": float(gate.mean()), "repeats": config.repeats}


def _models(
    sample: Sample, grids: Grids, planted: Planted, size: int, rng: np.random.Generator
) -> Models:
    """Return the models of one simulated sample."""
    larger, rows = larger_sample(sample, size, rng)
    angle = planted.mean + planted.spread * rng.standard_normal(len(larger.chain))
    decided = decide(larger, planted.weights(angle), rng)
    chosen = decided.table.chosen

    def again(trait: Trait) -> Evaluated:
        if size == 1:
            return traits.evaluate(decided.table, trait)
        return Tabulated.of(sample.table, trait).at(rows, chosen)

    of_angle, of_gain = ((grid, every.at(rows, chosen)) for grid, every in grids)
    seed = int(rng.integers(2**31))
    return models_of(decided, *of_angle, *of_gain, seed, _SHUFFLES, again=again)


def power_rows(sample: Sample, config: PowerConfig, counted: Counted = None) -> list[Row]:
    """Return for each planted population and size the gains and the shares of detections.

    A population for each spread, and one whose known angles save `gain`, which is left out where no
    strength saves as much on these moments. Sizes larger than one that nearly always detects are
    left out. `counted` is called after each repeat.

    Raises:
        UserError: If all candidates of all decisions have equal rewards: nothing tells angles
            apart.
    """
    if not np.ptp(rewards_of(sample.table), axis=1).any():
        raise UserError("every candidate has the same rewards: no choice can show an angle")
    scale = reward_scale(sample.table)
    traits_of = traits.angle_trait(STEP, STRENGTHS, scale), traits.progress_trait(STRENGTHS, scale)
    grids = [(trait, Tabulated.of(sample.table, trait)) for trait in traits_of]
    populations = {
        f"spread {spread:g}": Planted(spread, config.mean, config.strength / scale)
        for spread in config.spreads
    }
    widest = max(config.spreads)
    needed = strength_of_gain(sample, widest, config.mean, config.gain) if widest > 0 else None
    if needed is not None:
        name = f"spread {widest:g}, {100 * config.gain:g} % if known"
        populations[name] = Planted(widest, config.mean, needed)
    rows: list[Row] = []
    for name, planted in populations.items():
        head = {"population": name, "spread": planted.spread, "strength": planted.strength * scale}
        head["known_angle_gain"] = known_angle_gain(sample, planted)
        for size in sorted(config.sizes):
            row = _row(sample, config, grids, planted, size, counted)
            rows.append(head | row)
            if planted.spread > 0 and row["detected"] >= ENOUGH:
                break  # larger samples find it too
    return rows


def needed_rows(rows: Sequence[Row]) -> list[Row]:
    """Return for each planted population the size that finds it with a chance of `POWER`.

    Between two sizes the share is taken as linear in the logarithm of the size. A population
    without spread needs none: its detections are errors.
    """
    needed: list[Row] = []
    for name in dict.fromkeys(row["population"] for row in rows):
        of_population = [row for row in rows if row["population"] == name]
        of_population.sort(key=lambda row: row["size"])
        first, last = of_population[0], of_population[-1]
        size = _size_of(of_population) if first["spread"] > 0 else None
        need: Row = {"population": name, "known_angle_gain": first["known_angle_gain"]}
        need |= {"detected_now": first["detected"], "size_needed": size}
        enough = size is not None or not first["spread"]
        need |= {"more_than": None if enough else last["size"]}
        for count in ("drivers", "chains"):
            need[f"{count}_needed"] = size and round(size * first[count] / first["size"])
        needed.append(need)
    return needed


def _size_of(rows: Sequence[Row]) -> float | None:
    """Return the smallest size at which the share of detections reaches `POWER`."""
    for index, row in enumerate(rows):
        if row["detected"] >= POWER:
            if index == 0:
                return float(row["size"])
            low = rows[index - 1]
            way = (POWER - low["detected"]) / (row["detected"] - low["detected"])
            return float(low["size"] * (row["size"] / low["size"]) ** way)
    return None


def power(rows: Sequence[Row]) -> Figure:
    """Draw the share of detections and the gain over the number of drivers, by population."""
    drawing = figure(10.0, 4.0)
    left, right = drawing.subplots(1, 2)
    colors = list(COLORS.values())
    for number, name in enumerate(dict.fromkeys(row["population"] for row in rows)):
        of_population = [row for row in rows if row["population"] == name]
        drivers = [row["drivers"] for row in of_population]
        ends = [
            [max(0.0, row["detected"] - row["low"]) for row in of_population],
            [max(0.0, row["high"] - row["detected"]) for row in of_population],
        ]
        color, share = colors[number % len(colors)], [row["detected"] for row in of_population]
        shifted = [driver * 1.03**number for driver in drivers]
        left.errorbar(shifted, share, ends, fmt="o-", color=color, markersize=4, label=name)
        gain = [100 * row["rmse_gain"] for row in of_population]
        right.plot(drivers, gain, "o-", color=color, markersize=4, label=name)
        if_known = 100 * of_population[0]["known_angle_gain"]
        right.axhline(if_known, color=color, linewidth=0.8, linestyle=":")
    left.axhline(POWER, color="#777777", linewidth=0.8)
    for axes in (left, right):
        axes.set_xscale("log")
    finish(left, "Angle found (95 % of the share)", 8, xlabel="drivers", ylabel="share of tries")
    left.set_ylim(-0.02, 1.02)
    title = "RMSE saved by inferred angles (dotted: by known ones)"
    finish(right, title, xlabel="drivers", ylabel="%")
    return drawing
