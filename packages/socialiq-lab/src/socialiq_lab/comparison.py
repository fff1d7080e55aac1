"""Parts that comparisons of methods share: worlds and data, demonstrators as references, means."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation.exact import Ground, Metrics, evaluate_exactly, mean_of
from socialiq.evaluation.rollout import MODES
from socialiq.types import Row
from socialiq.worlds.enumerate import expert_policy
from socialiq_lab.tables import column, groups, mean, spread

GRIDWORLDS = ("crossing5", "crossing7")
WORLDS = (*GRIDWORLDS, "intersection")

EPISODES_EACH = {"crossing5": 1, "crossing7": 60}
"""Episodes of each expert, as in the worlds' own studies; the 5x5 world is deterministic."""


def check_choices(
    config: Any,
    method_names: tuple[str, ...],
    development: Sequence[int],
    seeds: Sequence[int],
    worlds: tuple[str, ...] = WORLDS,
) -> None:
    """Refuse unknown worlds and methods, empty options, and seeds used twice.

    Args:
        config: Configuration of a comparison, with `worlds` and `methods`.
        method_names: Names of all methods.
        development: Seeds on which settings are chosen.
        seeds: Seeds of the table.
        worlds: Names of all worlds.

    Raises:
        UserError: The line names what to change.
    """
    for world in config.worlds:
        one_of("world", world, worlds)
    for method in config.methods:
        one_of("method", method, method_names)
    for name, value in vars(config).items():
        if isinstance(value, tuple) and not value:
            raise UserError(f"{name} must name at least one")
    if len({*config.worlds}) < len(config.worlds):
        raise UserError("a world is named twice: name each once")
    if {*development} & {*seeds}:
        raise UserError("a seed of development can't be a seed of the table: name others")


def nearest_mode(angle: float) -> str:
    """Return the mode of the nearest angle; of two equally near ones the more egoistic."""
    return min(MODES, key=lambda mode: abs(MODES[mode] - angle))


def of_modes(data: Demonstrations, modes: Sequence[str]) -> Demonstrations:
    """Return the episodes of these modes."""
    numbers = [number for number, name in enumerate(data.mode_names) if name in modes]
    return data.select(np.flatnonzero(np.isin(data.episode_modes, numbers)))


def references(world: str, angles: Sequence[float]) -> list[Row]:
    """Return the regrets of each demonstrator, and of value iteration, at each angle.

    A learner that only chooses among the demonstrators can't be better than the best of them.
    """
    ground = Ground.of(world)
    reachable = ground.table.mdp.reachable()

    def regret(of: float, at: float) -> float:
        metrics = evaluate_exactly(ground.part, expert_policy(ground.table, of)[reachable])
        return ground.optimum.regret(metrics, at)

    return [
        {"world": world, "target_angle": angle, "value_iteration": regret(angle, angle)}
        | {mode: regret(mode_angle, angle) for mode, mode_angle in MODES.items()}
        for angle in angles
    ]


def choose(rows: Sequence[Row], setting: str) -> dict[tuple[str, str], Any]:
    """Return, for each world and method, the setting with the greatest mean J(α).

    J*(α) is the same for all settings, so this is also the least mean regret. Of equal ones the
    first is chosen.

    Args:
        rows: Rows of the development seeds, settings in the order of their grid.
        setting: Column of the setting.
    """
    chosen: dict[tuple[str, str], Any] = {}
    for (world, method), group in groups(rows, "world", "method").items():
        values = {
            setting_value: round(mean(of_setting, "value"), 9)
            for (setting_value,), of_setting in groups(group, setting).items()
        }
        chosen[world, method] = max(values, key=values.__getitem__)
    return chosen


def means(rows: Sequence[Row], keys: Sequence[str], also: Sequence[str] = ()) -> list[Row]:
    """Return means over seeds; α̂ is that of the mean totals, low and high are of single seeds.

    Args:
        rows: Rows of single policies, with metrics, `value` and `regret`.
        keys: Columns by which rows belong together.
        also: Further columns to average.
    """
    pooled: list[Row] = []
    for values, group in groups(rows, *keys).items():
        metrics = mean_of([Metrics(*(row[name] for name in Metrics._fields)) for row in group])
        pooled.append(
            dict(zip(keys, values, strict=True))
            | {"seeds": len(group)}
            | metrics._asdict()
            | _spread(group, "value")
            | _spread(group, "regret")
            | {name: mean_or_none(group, name) for name in also}
        )
    return pooled


def overall(pooled: Sequence[Row], keys: Sequence[str]) -> list[Row]:
    """Return mean J(α), mean regret and worst regret of each method over all target angles.

    Regrets are empty where the optimum is unknown.

    Args:
        pooled: Rows of `means`.
        keys: Columns by which rows belong together, without the angle.
    """
    rows = []
    for values, group in groups(pooled, *keys).items():
        row = dict(zip(keys, values, strict=True)) | {"angles": len(group)}
        row |= {name: mean_or_none(group, name) for name in ("value", "regret")}
        has_regret = group[0]["regret"] != ""
        rows.append(row | {"worst_regret": max(column(group, "regret")) if has_regret else ""})
    return rows


def mean_or_none(group: Sequence[Row], name: str) -> float | str:
    """Return the mean of a column, "" where it is empty."""
    return "" if group[0][name] == "" else mean(group, name)


def _spread(group: Sequence[Row], name: str) -> Row:
    if any(row[name] == "" for row in group):
        return {name: "", f"{name}_low": "", f"{name}_high": ""}
    ends = spread(group, name)
    return {name: ends["mean"], f"{name}_low": ends["low"], f"{name}_high": ends["high"]}
