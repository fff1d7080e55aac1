"""Power of the test of an angle: drivers of known angles decide at the recorded moments.

Choices are drawn from the very model that is inferred (`trait.planted`), so the power is an upper
bound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from socialiq.errors import UserError
from socialiq.plotting.style import COLORS, figure, finish
from socialiq.statistics.intervals import wilson
from socialiq.types import Row
from socialiq_recordings.trait.choice_model import (
    Evaluated,
    Tabulated,
    evaluate,
    reward_scale,
    rewards_of,
)
from socialiq_recordings.trait.models import Models, Sample, contrasts, models_of
from socialiq_recordings.trait.planted import (
    CERTAIN,
    Planted,
    decide,
    known_angle_gain,
    larger_sample,
    strength_of_gain,
)
from socialiq_recordings.trait.traits import Trait, angle_trait, progress_trait

STRENGTHS = (0.0, *(0.1 * 1.5**number for number in range(12)))
"""β of the repeats, per typical difference of reward: a coarser grid than of an inference."""

STEP = 15.0
"""Degrees between the angles of the repeats."""

POWER = 0.8
"""Share of detections that counts as enough."""

ENOUGH = 0.95
"""Share of detections above which larger samples are not drawn."""

_SHUFFLES = 2


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


class Simulator:
    """Repeats of a planted population on the decisions of a sample.

    Args:
        sample: The sample at hand.
        config: The configuration.
    """

    def __init__(self, sample: Sample, config: PowerConfig) -> None:
        self._sample, self._config = sample, config
        self._grids = Grids.of(sample)
        self._angle, self._gain = (Tabulated.of(sample.table, trait) for trait in self._grids)

    def models(self, planted: Planted, size: int, seed: Sequence[int]) -> Models:
        """Return the models of one simulated sample."""
        rng = np.random.default_rng(seed)
        sample, rows = larger_sample(self._sample, size, rng)
        angle = planted.mean + planted.spread * rng.standard_normal(len(sample.chain))
        planted_sample = decide(sample, planted.weights(angle), rng)
        chosen = planted_sample.table.chosen

        def again(trait: Trait) -> Evaluated:
            if size == 1:
                return evaluate(planted_sample.table, trait)
            return Tabulated.of(self._sample.table, trait).at(rows, chosen)

        return models_of(
            planted_sample,
            self._grids.angle,
            self._angle.at(rows, chosen),
            self._grids.gain,
            self._gain.at(rows, chosen),
            int(rng.integers(2**31)),
            _SHUFFLES,
            again=again,
        )

    def row(self, planted: Planted, size: int, counted: Callable[[], None] | None = None) -> Row:
        """Return gains and shares of detections over all repeats of a size."""
        config, outcomes = self._config, []
        for repeat in range(config.repeats):
            seed = [config.seed, repeat, size, round(100 * planted.spread)]
            tests = contrasts(self.models(planted, size, seed), repeat, config.resamples)
            every = all(test["found"] for test in tests)
            outcomes.append(
                [tests[0][name] for name in ("gain_nats", "rmse_gain", "found")] + [every]
            )
            if counted:
                counted()
        nats, error, detected, gate = np.array(outcomes, np.float64).T
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
    named_populations = [
        (f"spread {spread:g}", Planted(spread, config.mean, strength)) for spread in config.spreads
    ]
    widest = max(config.spreads)
    needed = strength_of_gain(sample, widest, config.mean, config.gain) if widest > 0 else None
    if needed is not None:
        name = f"spread {widest:g}, {100 * config.gain:g} % if known"
        named_populations.append((name, Planted(widest, config.mean, needed)))
    return named_populations


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
        gain_if_known = known_angle_gain(sample, planted)
        head = {"population": name, "spread": planted.spread, "strength": planted.strength * scale}
        for size in sorted(config.sizes):
            row = simulator.row(planted, size, counted)
            rows.append(head | {"known_angle_gain": gain_if_known} | row)
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
        of_population = sorted(
            (row for row in rows if row["population"] == name), key=lambda r: r["size"]
        )
        size = _size_of(of_population) if of_population[0]["spread"] > 0 else None
        first, last = of_population[0], of_population[-1]
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
    for index, row in enumerate(rows):
        if row["detected"] >= POWER:
            if index == 0:
                return float(row["size"])
            low = rows[index - 1]
            way = (POWER - low["detected"]) / (row["detected"] - low["detected"])
            return float(low["size"] * (row["size"] / low["size"]) ** way)
    return None


def power(rows: Sequence[Row]) -> Figure:
    """Draw the share of detections and the gain over the number of drivers, by population.

    Args:
        rows: Rows of `power.csv`.
    """
    drawing = figure(10.0, 4.0)
    left, right = drawing.subplots(1, 2)
    names = list(dict.fromkeys(row["population"] for row in rows))
    colors = list(COLORS.values())
    for number, name in enumerate(names):
        of_population = [row for row in rows if row["population"] == name]
        drivers = [row["drivers"] for row in of_population]
        share = [row["detected"] for row in of_population]
        ends = [
            [max(0.0, row["detected"] - row["low"]) for row in of_population],
            [max(0.0, row["high"] - row["detected"]) for row in of_population],
        ]
        color = colors[number % len(colors)]
        shifted = [driver * 1.03**number for driver in drivers]
        left.errorbar(shifted, share, ends, fmt="o-", color=color, markersize=4, label=name)
        gain = [100 * row["rmse_gain"] for row in of_population]
        right.plot(drivers, gain, "o-", color=color, markersize=4, label=name)
        right.axhline(
            100 * of_population[0]["known_angle_gain"], color=color, linewidth=0.8, linestyle=":"
        )
    left.axhline(POWER, color="#777777", linewidth=0.8)
    for axes in (left, right):
        axes.set_xscale("log")
    finish(left, "Angle found (95 % of the share)", 8, xlabel="drivers", ylabel="share of tries")
    left.set_ylim(-0.02, 1.02)
    finish(
        right,
        "RMSE saved by inferred angles (dotted: by known ones)",
        xlabel="drivers",
        ylabel="%",
    )
    return drawing
