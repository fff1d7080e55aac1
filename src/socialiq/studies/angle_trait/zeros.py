"""Zeros of dials: one dial's angles in terms of another, and populations on a common scale.

Each trained dial is left out in turn: its policies drive, and the other dials are the family that
is the model. So does a dial of another recipe, with all of them as the family. How far the zero of
a family is off is measured between its own dials, and widens the intervals of its angles.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import norm

from socialiq.experiments.intersection.episodes import DIAL as DIAL_FILE
from socialiq.experiments.study import Context, counter
from socialiq.experiments.tables import groups, mean
from socialiq.nn.dial_policy import DialPolicy
from socialiq.recordings.trait.contrasts import contrasts
from socialiq.recordings.trait.models import Models
from socialiq.studies.angle_trait.common_scale import Realised, mean_of
from socialiq.studies.angle_trait.config import (
    CALIBRATED,
    CONFIDENCE,
    DIAL,
    OTHER_DIAL,
    PLAIN,
    Config,
)
from socialiq.studies.angle_trait.driving import Decided, Population, drive
from socialiq.studies.angle_trait.ensemble import Member, common_angle, fit_dials, likeliest
from socialiq.studies.angle_trait.plan import folder_of
from socialiq.types import Row

_STEP = 5.0  # of angles of a common scale, degrees
_PLANTED = 15.0  # distance of the angles that are projected, degrees
_SCALE, _ZEROS, _POPULATIONS = 0, 100_000, 200_000  # first episodes of each table
_FINE = 0.1  # grid of widened intervals, degrees


def common_tables(config: Config, context: Context) -> dict[str, list[Row]]:
    """Return the tables of the trained dials, none without training seeds."""
    if not config.dials:
        return {}
    members = _members(config, context)
    zeros = _zeros(config, members, context)
    populations, drivers = _populations(config, members, zeros, context)
    return {
        "realised": _realised(members),
        "zeros": zeros,
        "zeros_pooled": _zeros_pooled(zeros),
        "common": populations,
        "common_pooled": _common_pooled(populations),
        "common_drivers": drivers,
    }


def family_of(config: Config, driver: str) -> list[str]:
    """Return the names of the dials that are the model of a driver of some dial."""
    return [str(seed) for seed in config.dials if str(seed) != driver]


def _members(config: Config, context: Context) -> dict[str, Member]:
    """Return all dials by name, with what each realises."""
    dials = {
        str(seed): DialPolicy.load(context.work / folder_of(seed) / DIAL_FILE)
        for seed in config.dials
    }
    dials |= {PLAIN: DialPolicy.load(DIAL), CALIBRATED: DialPolicy.load(OTHER_DIAL)}
    count, found = counter(context.on_stage, "realised rewards", len(dials), "dials"), {}
    for name, dial in dials.items():
        first = config.first_common + _SCALE
        found[name] = Member(dial, Realised.of(dial, config.scale_episodes, first, _STEP))
        count(len(found))
    return found


def _realised(members: Mapping[str, Member]) -> list[Row]:
    return [
        {"dial": name, "angle": angle, "r_env": env, "r_social": social}
        for name, one in members.items()
        for angle, env, social in zip(*(column.tolist() for column in one.realised), strict=True)
    ]


def _zeros(config: Config, members: Mapping[str, Member], context: Context) -> list[Row]:
    """Return the projections of each dial's angles on every other dial."""
    rows: list[Row] = []
    count = counter(context.on_stage, "zeros", len(members), "dials")
    for number, (name, one) in enumerate(members.items()):
        planted = np.arange(one.dial.low, one.dial.high + 1e-9, _PLANTED)
        first = config.first_common + _ZEROS + number * len(planted) * config.zero_episodes
        population = Population("dial", planted, 0.0)
        decided = drive(population, one.dial, config.zero_episodes, first)
        social = one.realised.social_at(planted)
        for other, model in members.items():
            if other == name:
                continue
            matched = model.realised.angle_of(social)
            found = likeliest(decided, config.zero_episodes, model.dial, model.realised.angle)
            rows += [
                {"driver": name, "model": other, "planted": a, "r_social": s, "matched": m} | row
                for a, s, m, row in zip(
                    *(x.tolist() for x in (planted, social, matched)), found, strict=True
                )
            ]
        count(number + 1)
    return rows


def zero_spread(zeros: list[Row], family: list[str]) -> float:
    """Return the root mean square of likeliest less matched angles between dials of a family."""
    of = [row for row in zeros if row["driver"] in family and row["model"] in family]
    return float(np.sqrt(np.mean([(row["likeliest"] - row["matched"]) ** 2 for row in of])))


def _zeros_pooled(zeros: list[Row]) -> list[Row]:
    """Return mean and root mean square of what projections miss, by kinds of driver and model."""

    def kind(name: str) -> str:
        return name if name in (PLAIN, CALIBRATED) else "trained"

    labelled = [
        row | {"drivers": kind(row["driver"]), "models": kind(row["model"])} for row in zeros
    ]
    found = []
    for (drivers, models), group in groups(labelled, "drivers", "models").items():
        row: Row = {"drivers": drivers, "models": models, "angles": len(group)}
        for name, value, truth in (
            ("by_action", "by_action", "planted"),
            ("own", "likeliest", "planted"),
            ("matched", "likeliest", "matched"),
        ):
            off = np.array([one[value] - one[truth] for one in group])
            row |= {f"{name}_mean": off.mean(), f"{name}_rms": np.sqrt((off**2).mean())}
        found.append(row)
    return found


class Widened(NamedTuple):
    """Mean and interval of an angle whose zero is uncertain, degrees."""

    angle: float
    low: float
    high: float


def widened(
    common: Float[np.ndarray, " value"],
    chance: Float[np.ndarray, " value"],
    spread: float,
    confidence: float,
) -> Widened:
    """Return mean and interval of equal tails of a posterior plus a normal error of the zero.

    Each grid point stands for the even distribution over its step; ends are cut off at the grid's.

    Args:
        common: Grid of angles at equal distances, degrees.
        chance: Posterior.
        spread: Standard deviation of the zero, degrees; 0 for none.
        confidence: Of the interval.
    """
    step = float(common[1] - common[0])
    deviation = float(np.hypot(spread, step / np.sqrt(12.0)))
    at = np.arange(common[0] - 5 * deviation, common[-1] + 5 * deviation, _FINE)
    below = norm.cdf((at[:, None] - common) / deviation) @ (chance / chance.sum())
    low, high = np.interp([(1 - confidence) / 2, (1 + confidence) / 2], below, at)
    inside = np.clip([low, high], common[0], common[-1])
    return Widened(float(common @ chance / chance.sum()), *inside.tolist())


def _populations(
    config: Config, members: Mapping[str, Member], zeros: list[Row], context: Context
) -> tuple[list[Row], list[Row]]:
    """Drive populations of every dial, and infer with the others as the family."""
    driving = [*family_of(config, ""), PLAIN]
    count = counter(context.on_stage, "populations", len(driving) * len(config.spreads), "")
    rows: list[Row] = []
    drivers: list[Row] = []
    size = config.drivers * max(config.lengths)
    for number, (name, spread) in enumerate((a, b) for a in driving for b in config.spreads):
        first, dial = config.first_common + _POPULATIONS + number * size, members[name].dial
        drawn = config.mean + spread * np.random.default_rng(first).standard_normal(config.drivers)
        planted = drawn.clip(dial.low, dial.high)
        decided = drive(Population("dial", planted, 0.0), dial, max(config.lengths), first)
        for row, each in _inferred(config, members, zeros, name, decided, planted, first):
            head = {"driver": name, "spread_planted": spread, "episodes": row["episodes"]}
            rows.append(head | row)
            drivers += [head | one for one in each]
        count(number + 1)
    return rows, drivers


def _inferred(
    config: Config,
    members: Mapping[str, Member],
    zeros: list[Row],
    name: str,
    decided: Decided,
    planted: Float[np.ndarray, " driver"],
    seed: int,
) -> Iterator[tuple[Row, list[Row]]]:
    """Return a population's row and its drivers' rows, for each number of episodes."""
    names = family_of(config, name)
    family = [members[one] for one in names]
    reference, off = mean_of([one.realised for one in family]), zero_spread(zeros, names)
    for used in config.lengths:
        models = fit_dials(decided, max(config.lengths), used, family, seed, _STEP)
        angle = planted[models.sample.identity]
        truth = common_angle(members[name], angle, reference)
        each = _drivers(models, angle, truth, off)
        tests = contrasts(models, seed % 2**31)
        yield (
            {
                "episodes": used,
                "zero_spread": off,
                **_recovery(each, reference),
                **{f"over {one['angle_over']}": one["gain_nats"] for one in tests},
                "p_holm": tests[0]["p_holm"],
                "found": float(tests[0]["found"]),
                "beats_every_rival": float(all(one["found"] for one in tests)),
            },
            each,
        )


def _drivers(
    models: Models,
    planted: Float[np.ndarray, " driver"],
    truth: Float[np.ndarray, " driver"],
    off: float,
) -> list[Row]:
    """Return each driver's planted and inferred angle, with and without the zero's spread."""
    rows = []
    common, posterior = models.trait.value, models.angle.drivers.sum(axis=1)
    for number, chance in enumerate(posterior):
        wide = widened(common, chance, off, CONFIDENCE)
        narrow = widened(common, chance, 0.0, CONFIDENCE)
        rows.append(
            {
                "number": int(models.sample.identity[number]),
                "planted": float(planted[number]),
                "planted_common": float(truth[number]),
                **wide._asdict(),
                "narrow_low": narrow.low,
                "narrow_high": narrow.high,
            }
        )
    return rows


def _recovery(each: list[Row], reference: Realised) -> Row:
    """Return how inferred angles compare with planted ones on the common scale."""
    names = ("planted", "planted_common", "angle", "low", "high", "narrow_low", "narrow_high")
    column: dict[str, Any] = {name: np.array([row[name] for row in each]) for name in names}
    truth, found = column["planted_common"], column["angle"]
    varied = np.ptp(truth) > 0 and np.ptp(found) > 0
    social = reference.social_at(found) - reference.social_at(truth)
    return {
        "correlation": float(np.corrcoef(truth, found)[0, 1]) if varied else 0.0,
        "mean_planted": column["planted"].mean(),
        "mean_common": truth.mean(),
        "mean_inferred": found.mean(),
        "error": np.abs(found - truth).mean(),
        "error_own": np.abs(found - column["planted"]).mean(),
        "error_social": np.abs(social).mean(),
        "covered": np.mean((column["low"] <= truth) & (truth <= column["high"])),
        "covered_narrow": np.mean(
            (column["narrow_low"] <= truth) & (truth <= column["narrow_high"])
        ),
        "width": np.mean(column["high"] - column["low"]),
    }


def _common_pooled(populations: list[Row]) -> list[Row]:
    """Return means over left-out dials, and the dial of another recipe alone."""
    labelled = [
        row | {"drivers": PLAIN if row["driver"] == PLAIN else "left out"} for row in populations
    ]
    keys = ("drivers", "spread_planted", "episodes")
    return [
        dict(zip(keys, values, strict=True))
        | {"populations": len(group)}
        | {name: mean(group, name) for name in group[0] if name not in (*keys, "driver")}
        for values, group in groups(labelled, *keys).items()
    ]


def common_summary(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return what the claims may refer to; nothing without the tables."""
    names = ("zero_spread", "correlation", "error", "error_own", "covered", "beats_every_rival")
    return {
        f"common scale, {row['drivers']}, spread {row['spread_planted']:g}, "
        f"{row['episodes']} episodes": {name: row[name] for name in names}
        for row in tables.get("common_pooled", [])
    }
