"""Stakeholders who want different angles: utilities, dominated settings, bargains (thesis 9.3).

A setting is a driver, or a dial at an angle. A utility adds measured quantities of an episode,
each times a declared factor. All settings drove the same episodes, which are resampled together.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from socialiq.errors import UserError
from socialiq.reading import read_toml
from socialiq.results_folder import from_csv
from socialiq.statistics.bootstrap import resample_rows
from socialiq.types import Ending, Row

RULES = "weighted_sum", "nash", "max_min"
"""Ways to choose a setting for all stakeholders."""

FACTORS = 0.25, 0.5, 2.0, 4.0
"""Multiples of a weight for which the choice is made again."""

_TIE = 1e-12


@dataclass(frozen=True)
class Stakeholder:
    """A party with an interest in measured quantities of an episode."""

    name: str
    weight: float
    factors: Mapping[str, float]
    """Utility of one unit of each quantity."""


class Episodes(NamedTuple):
    """Measured quantities of the same episodes of every setting."""

    settings: tuple[Row, ...]  # policy and angle
    quantities: Mapping[str, Float[np.ndarray, "setting episode"]]


class Judgement(NamedTuple):
    """Utilities with 95 % intervals, and how often a resample of the episodes agrees."""

    mean: Float[np.ndarray, "setting stakeholder"]
    low: Float[np.ndarray, "setting stakeholder"]
    high: Float[np.ndarray, "setting stakeholder"]
    dominated: Float[np.ndarray, " setting"]  # share of resamples
    chosen: Mapping[str, Float[np.ndarray, " setting"]]  # share of resamples, by rule


def read_stakeholders(path: Path) -> tuple[Stakeholder, ...]:
    """Read stakeholders from a TOML file: a table each, with `weight` and factors.

    Raises:
        UserError: If it is not such a file. A weight is never assumed.
    """
    stakeholders = []
    for name, content in read_toml(path).items():
        if not isinstance(content, dict):
            raise UserError(f"{path}: write [{name}] as a table, with weight and factors")
        for quantity, number in content.items():
            is_number = isinstance(number, int | float) and not isinstance(number, bool)
            if not is_number or not math.isfinite(number):
                raise UserError(f"{path}: {quantity} of [{name}] is not a finite number")
        factors = {quantity: float(factor) for quantity, factor in content.items()}
        weight = factors.pop("weight", math.nan)
        if not weight >= 0.0:
            raise UserError(f"{path}: [{name}] needs a weight of at least 0, as weight = 1.0")
        if not factors:
            raise UserError(f"{path}: [{name}] cares about nothing: add a factor, as r_env = 1.0")
        stakeholders.append(Stakeholder(name, weight, factors))
    if len(stakeholders) < 2:
        raise UserError(f"{path} has {len(stakeholders)} stakeholder(s): declare two or more")
    if not any(stakeholder.weight for stakeholder in stakeholders):
        raise UserError(f"{path}: every weight is 0, so nothing is preferred: raise one")
    return tuple(stakeholders)


def read_episodes(path: Path) -> Episodes:
    """Read episodes.csv of `socialiq effects` or `socialiq population`.

    In addition to its columns it has `delay` in all, `arrival`, `collision`, `timeout`,
    `gap_below_1_s`.

    Raises:
        UserError: If columns are missing, or settings drove different episodes.
    """
    rows = from_csv(path)
    missing = [name for name in ("policy", "angle", "seed") if name not in (rows or [{}])[0]]
    if missing:
        raise UserError(f"{path} has no column {missing[0]}: name episodes.csv of `effects --out`")
    by_setting: dict[tuple[Any, Any], list[Row]] = {}
    for row in rows:
        by_setting.setdefault((row["policy"], row["angle"]), []).append(row)
    first = [row["seed"] for row in rows[: len(next(iter(by_setting.values())))]]
    for (policy, angle), episodes in by_setting.items():
        if [row["seed"] for row in episodes] != first:
            raise UserError(f"{path}: {policy} {angle} did not drive the episodes of the others")
    columns = {
        name: np.array([[row[name] for row in episodes] for episodes in by_setting.values()])
        for name in rows[0]
    }
    numeric = {name: values for name, values in columns.items() if values.dtype.kind in "if"}
    quantities = {name: values.astype(float) for name, values in numeric.items() if name != "seed"}
    quantities |= dict(_derived(quantities))
    settings = tuple({"policy": policy, "angle": angle} for policy, angle in by_setting)
    return Episodes(settings, quantities)


def _derived(quantities: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the quantities that follow from columns of an episode."""
    delays = [values for name, values in quantities.items() if name.startswith("delay_")]
    if delays and "delay" not in quantities:
        yield "delay", np.sum(delays, axis=0)
    if "ending" in quantities:
        for kind in (Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT):
            yield kind.name.lower(), (quantities["ending"] == kind) * 1.0
    if "gap" in quantities:
        yield "gap_below_1_s", (quantities["gap"] < 1.0) * 1.0


def utilities(
    episodes: Episodes, stakeholders: Sequence[Stakeholder]
) -> Float[np.ndarray, "setting episode stakeholder"]:
    """Return what each episode of a setting is worth to each stakeholder.

    Args:
        episodes: Measured quantities of the episodes of each setting.
        stakeholders: The stakeholders, with a factor for each quantity that counts to them.

    Raises:
        UserError: If a quantity was not measured, or is not finite in some episode.
    """
    columns = []
    for stakeholder in stakeholders:
        for name in stakeholder.factors:
            if name not in episodes.quantities:
                known = ", ".join(sorted(episodes.quantities))
                raise UserError(f"{stakeholder.name}: {name} was not measured: choose of {known}")
            if not np.isfinite(episodes.quantities[name]).all():
                raise UserError(f"{stakeholder.name}: {name} is not finite in every episode")
        columns.append(
            sum(factor * episodes.quantities[name] for name, factor in stakeholder.factors.items())
        )
    return np.stack(columns, axis=-1)


def judge(
    worth: Float[np.ndarray, "setting episode stakeholder"],
    weights: Float[np.ndarray, " stakeholder"],
    resamples: int = 1000,
    seed: int = 0,
) -> Judgement:
    """Return utilities, dominated settings and the choices by `RULES`.

    A setting is dominated if another is at least as good for all and better for one. The Nash
    point has the largest product of gains over each stakeholder's worst setting, to the power of
    its weight. The max-min point has the largest least utility, on a scale from each one's worst
    to its best setting.

    Args:
        worth: Utility of each episode of a setting to each stakeholder.
        weights: Weight of each stakeholder.
        resamples: Number of bootstrap resamples of episodes.
        seed: Seed of the bootstrap.
    """
    settings, episodes, _ = worth.shape
    means = np.concatenate(
        [worth[:, rows].mean(axis=2).swapaxes(0, 1) for rows in _blocks(episodes, resamples, seed)]
    )
    low, high = np.quantile(means, (0.025, 0.975), axis=0)
    choices = choose(means, weights)
    shares = {
        rule: np.bincount(choice, minlength=settings) / resamples
        for rule, choice in choices.items()
    }
    rows = means[:, :, None]
    columns = means[:, None]
    dominates = np.all(columns >= rows, axis=3) & np.any(columns > rows, axis=3)
    dominated = np.any(dominates, axis=2).mean(axis=0)
    return Judgement(worth.mean(axis=1), low, high, dominated, shares)


def choose(
    means: Float[np.ndarray, "resample setting stakeholder"],
    weights: Float[np.ndarray, " stakeholder"],
) -> dict[str, Int[np.ndarray, " resample"]]:
    """Return the setting that each rule chooses.

    Args:
        means: Mean utility of each setting to each stakeholder.
        weights: Weight of each stakeholder.

    Returns:
        Indices of the settings by name of the rule, of `RULES`; of equal settings the first.
    """
    worst = means.min(axis=1, keepdims=True)
    gains = means - worst
    reach = np.maximum(gains.max(axis=1, keepdims=True), _TIE)
    scores = (
        means @ weights,
        (np.log(np.maximum(gains / reach, _TIE)) * weights).sum(axis=2),
        (gains / reach).min(axis=2),
    )
    return {rule: score.argmax(axis=1) for rule, score in zip(RULES, scores, strict=True)}


def moved_weights(
    worth: Float[np.ndarray, "setting episode stakeholder"], stakeholders: Sequence[Stakeholder]
) -> Iterator[tuple[str, float, dict[str, int]]]:
    """Yield the choices after a change of each stakeholder's weight.

    Args:
        worth: Utility of each episode of a setting to each stakeholder.
        stakeholders: The stakeholders with their declared weights.

    Yields:
        The stakeholder's name, the factor of `FACTORS` by which its weight was multiplied, and the
        index of the setting that each of `RULES` chooses.
    """
    means = worth.mean(axis=1)[None]
    for number, stakeholder in enumerate(stakeholders):
        for factor in FACTORS:
            changed = list(stakeholders)
            changed[number] = replace(stakeholder, weight=factor * stakeholder.weight)
            choices = choose(means, weights_of(changed))
            yield stakeholder.name, factor, {rule: int(row[0]) for rule, row in choices.items()}


def weights_of(stakeholders: Sequence[Stakeholder]) -> Float[np.ndarray, " stakeholder"]:
    """Return the declared weights."""
    return np.array([stakeholder.weight for stakeholder in stakeholders])


def _blocks(episodes: int, resamples: int, seed: int) -> Iterator[np.ndarray]:
    """Yield rows of resamples in blocks that keep the utilities of a block below 100 MB."""
    for rows in resample_rows(episodes, resamples, seed):
        yield from np.array_split(rows, max(1, rows.size // 100_000))
