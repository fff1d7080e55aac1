"""Zeros of dials: one dial's angles in terms of another, and populations on a common scale.

Each trained dial is left out in turn: its policies drive, and the other dials are the family that
is the model. So does a dial of another recipe, with all of them as the family. How far the zero of
a family is off is measured between its own dials, and widens the intervals of its angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.stats import norm

from socialiq.storage import read_json
from socialiq.types import Row
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import groups, mean
from studies.angle_trait.common_scale import Realised
from studies.angle_trait.config import CONFIDENCE
from studies.angle_trait.zeros_config import CALIBRATED, PLAIN, Config
from studies.angle_trait.zeros_figure import draw_zeros
from studies.angle_trait.zeros_jobs import FOUND, folder_of, plan

_FINE = 0.1  # grid of widened intervals, degrees


def compute_tables(config: Config, context: Context) -> Findings:
    """Return what dials realise, their projections on each other, and the populations."""

    def found(stage: str, name: str) -> Any:
        return read_json(context.work / folder_of(stage, name) / FOUND)

    realised = [
        {"dial": name, "angle": angle, "r_env": env, "r_social": social}
        for name in config.names
        for angle, env, social in zip(*found("realised", name), strict=True)
    ]
    driving = (*config.family_of(""), PLAIN)
    zeros = [row for name in driving for row in found("zeros", name)]
    populations: list[Row] = []
    drivers: list[Row] = []
    for name in driving:
        off = zero_spread(zeros, config.family_of(name))
        for spread in config.spreads:
            head = {"driver": name, "spread_planted": spread}
            made = found(f"populations/{spread:g}", name)
            each = _drivers(made, off)
            populations.append(head | {"zero_spread": off} | _population(made, each))
            drivers += [head | one for one in each]
    pooled = _populations_pooled(populations)
    tables = {
        "realised": realised,
        "zeros": zeros,
        "zeros_pooled": _zeros_pooled(zeros),
        "populations": populations,
        "pooled": pooled,
        "drivers": drivers,
    }
    return Findings(tables, _summary(pooled))


def zero_spread(zeros: Sequence[Row], family: Sequence[str]) -> float:
    """Return the root mean square of likeliest less matched angles between dials of a family."""
    of = [row for row in zeros if row["driver"] in family and row["model"] in family]
    return float(np.sqrt(np.mean([(row["likeliest"] - row["matched"]) ** 2 for row in of])))


def _zeros_pooled(zeros: Sequence[Row]) -> list[Row]:
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


def _drivers(made: dict[str, Any], off: float) -> list[Row]:
    """Return each driver's planted and inferred angle, with and without the zero's spread."""
    rows, common = [], np.array(made["common"])
    planted = zip(made["planted"], made["planted_common"], made["posterior"], strict=True)
    for number, (own, truth, chance) in enumerate(planted):
        wide = widened(common, np.array(chance), off, CONFIDENCE)
        narrow = widened(common, np.array(chance), 0.0, CONFIDENCE)
        rows.append(
            {
                "number": number,
                "planted": own,
                "planted_common": truth,
                **wide._asdict(),
                "narrow_low": narrow.low,
                "narrow_high": narrow.high,
            }
        )
    return rows


def _population(made: dict[str, Any], each: list[Row]) -> Row:
    """Return how a population is recovered, and what its angles predict."""
    tests, reference = made["tests"], Realised(*(np.array(one) for one in made["reference"]))
    return {
        **_recovery(each, reference),
        **{f"over {one['angle_over']}": one["gain_nats"] for one in tests},
        "p_holm": tests[0]["p_holm"],
        "found": float(tests[0]["found"]),
        "beats_every_rival": float(all(one["found"] for one in tests)),
    }


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


def _populations_pooled(populations: list[Row]) -> list[Row]:
    """Return means over left-out dials, and the dial of another recipe alone."""
    labelled = [
        row | {"drivers": PLAIN if row["driver"] == PLAIN else "left out"} for row in populations
    ]
    keys = ("drivers", "spread_planted")
    return [
        dict(zip(keys, values, strict=True))
        | {"populations": len(group)}
        | {name: mean(group, name) for name in group[0] if name not in (*keys, "driver")}
        for values, group in groups(labelled, *keys).items()
    ]


def _summary(pooled: list[Row]) -> dict[str, Any]:
    names = ("zero_spread", "correlation", "error", "error_own", "covered", "beats_every_rival")
    return {
        f"{row['drivers']}, spread {row['spread_planted']:g}": {name: row[name] for name in names}
        for row in pooled
    }


_SHOWN = (
    "drivers",
    "spread_planted",
    "zero_spread",
    "correlation",
    "mean_common",
    "mean_inferred",
    "error",
    "error_own",
    "covered",
    "covered_narrow",
    "found",
    "beats_every_rival",
)


def view(results: Results) -> list[View]:
    """Return the means of zeros and of populations."""
    pooled = [{name: row[name] for name in _SHOWN} for row in results.tables["pooled"]]
    zeros = results.tables["zeros_pooled"]
    return [
        View(zeros, "Likeliest angle of another dial, less the planted and the matched one"),
        View(pooled, "A family of dials on their common scale: means over populations"),
    ]


def draw(results: Results) -> dict[str, Figure]:
    """Draw what angles realise, projections, and recovered angles."""
    tables = results.tables
    return {"zeros": draw_zeros(tables["realised"], tables["zeros"], tables["drivers"])}


STUDY = Study(
    name="angle-zeros",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view,
    jobs=plan,
)
