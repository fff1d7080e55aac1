"""Rows of a comparison's policies in gridworlds, and the tables and the figure that follow."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure

from socialiq.evaluation import exact
from socialiq.evaluation.exact import READOUTS, Ground
from socialiq.evaluation.rollout import MODES
from socialiq.plotting.style import SMALLEST, figure, head
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq.worlds.tabular_policy import expert_policy
from socialiq_lab import tables as table_operations
from socialiq_lab.comparison import GRIDWORLDS, Method
from socialiq_lab.comparison_runs import turned
from socialiq_lab.tables import column, groups, labelled, matching, mean


def chances(
    ground: Ground, policy: Any, angle: float, readout: exact.Readout
) -> Float[np.ndarray, "state action"]:
    """Return the action probabilities of a policy at an angle.

    Args:
        ground: The world, enumerated.
        policy: A policy, a dial (which has `at`), or tables of probabilities by angle.
        angle: Angle in degrees.
        readout: Action selection, one of `exact.READOUTS`.

    Returns:
        (state, action), one-hot for the greedy action.
    """
    at_angle = turned(policy, angle)
    if not isinstance(at_angle, np.ndarray):
        return exact.action_table(at_angle, ground.part, readout)
    greedy = np.eye(at_angle.shape[1])[at_angle.argmax(axis=1)]
    return greedy if readout == "greedy" else at_angle


def rows_of(
    ground: Ground, method: Method, label: Row, seed: int, policy: Any, angles: Sequence[float]
) -> list[Row]:
    """Return the exact metrics and the regret of a policy at each angle that it serves.

    Args:
        ground: The world, enumerated.
        method: The method, which says which action selections are evaluated.
        label: Columns of every row.
        seed: Training seed.
        policy: The policy, as in `chances`.
        angles: Angles in degrees.

    Returns:
        A row for each angle and action selection.
    """
    rows: list[Row] = []
    for angle, readout in itertools.product(angles, method.readouts):
        metrics = exact.evaluate_exactly(ground.part, chances(ground, policy, angle, readout))
        labels = {"target_angle": angle, "readout": readout, "seed": seed}
        regret = ground.optimum.regret(metrics, angle)
        values = {"value": metrics.value(angle), "regret": regret}
        rows.append(label | labels | metrics._asdict() | values)
    return rows


def references(world: str, angles: Sequence[float]) -> list[Row]:
    """Return the regrets of each demonstrator, and of value iteration, at each angle.

    A learner that only chooses among the demonstrators can't be better than the best of them.

    Args:
        world: Name of the gridworld.
        angles: Angles in degrees.

    Returns:
        A row for each angle, with the regret of value iteration and of each demonstrator.
    """
    ground = Ground.of(world)
    reachable = ground.table.mdp.reachable()

    def regret(of: float, at: float) -> float:
        metrics = exact.evaluate_exactly(ground.part, expert_policy(ground.table, of)[reachable])
        return ground.optimum.regret(metrics, at)

    return [
        {"world": world, "target_angle": angle, "value_iteration": regret(angle, angle)}
        | {mode: regret(mode_angle, angle) for mode, mode_angle in MODES.items()}
        for angle in angles
    ]


def tables_of(
    config: Any,
    fresh: list[Row],
    developed: Sequence[Row],
    keys: Sequence[str],
    also: Sequence[str] = (),
) -> dict[str, list[Row]]:
    """Return the tables that every comparison has.

    Args:
        config: Configuration of the comparison, with `worlds` and `angles`.
        fresh: Rows of the single policies of the table.
        developed: Rows of the policies among which settings were chosen.
        keys: Columns by which rows are put together, `target_angle` among them.
        also: Further columns whose means are taken.

    Returns:
        Tables `policies`, `pooled`, `overall`, `references` and `development`.
    """
    quantities = ("value", "regret")
    pooled = table_operations.pooled(fresh, keys, quantities, also)
    gridworlds = [world for world in config.worlds if world in GRIDWORLDS]
    return {
        "policies": fresh,
        "pooled": pooled,
        "overall": overall(pooled, [key for key in keys if key != "target_angle"]),
        "references": [row for world in gridworlds for row in references(world, config.angles)],
        "development": table_operations.pooled(developed, keys, quantities, also),
    }


def choose(rows: Sequence[Row], setting: str) -> dict[tuple[str, str], Any]:
    """Return, for each world and method, the setting with the greatest mean J(α).

    J*(α) is the same for all settings, so this is also the least mean regret.

    Args:
        rows: Rows of the development seeds.
        setting: Name of the column with the setting.

    Returns:
        The chosen value by world and method; of equal settings the first in the order of the rows.
    """
    chosen: dict[tuple[str, str], Any] = {}
    for (world, method), group in groups(rows, "world", "method").items():
        values = {
            setting_value: round(mean(of_setting, "value"), 9)
            for (setting_value,), of_setting in groups(group, setting).items()
        }
        chosen[world, method] = max(values, key=values.__getitem__)
    return chosen


def overall(pooled: Sequence[Row], keys: Sequence[str]) -> list[Row]:
    """Return mean J(α), mean regret and worst regret of each method over all target angles.

    Args:
        pooled: Table `pooled` of `tables_of`.
        keys: Columns by which rows are put together; the angle is not among them.

    Returns:
        A row for each combination of the keys. Regrets are empty where the optimum is unknown.
    """
    rows = []
    for label, group in labelled(pooled, *keys):
        row = label | {"angles": len(group)}
        row["value"] = mean(group, "value")
        has_regret = group[0]["regret"] != ""
        row["regret"] = mean(group, "regret") if has_regret else ""
        rows.append(row | {"worst_regret": max(column(group, "regret")) if has_regret else ""})
    return rows


TITLES = {"regret": "regret J*(α) - J(α)", "value": "mean total J(α)"}


def quantity(results: Results, world: str) -> str:
    """Return the name of the column that a figure shows.

    Args:
        results: Results with the tables of `tables_of`.
        world: Name of the world.

    Returns:
        "regret" where the optimum is known, else "value".
    """
    rows = matching(results.tables["pooled"], world=world)
    return "value" if "" in column(rows, "regret") else "regret"


def angle_figure(
    results: Results,
    world: str,
    labels: Mapping[str, str],
    readouts: Sequence[str] = READOUTS,
) -> Figure:
    """Draw a field for each method and angle: the mean over seeds, and the range if it differs.

    Args:
        results: Results with the tables of `tables_of`.
        world: Name of the world.
        labels: Name of each method in the figure.
        readouts: Action selections; each has a panel.
    """
    rows = matching(results.tables["pooled"], world=world)
    rows = [row for row in rows if row["readout"] in readouts]
    name = quantity(results, world)
    methods = list(dict.fromkeys(column(rows, "method")))
    angles = sorted(set(column(rows, "target_angle")))
    picture = figure(3.6 + 0.95 * len(angles), 1.4 + 0.46 * len(readouts) * len(methods))
    panels = np.ravel(picture.subplots(len(readouts), sharex=True, squeeze=False))
    values = column(rows, name)
    colors = matplotlib.colormaps["viridis"]
    norm = Normalize(min(values), max(values))
    if name == "regret":  # small regrets matter, and differ by orders of magnitude
        norm = PowerNorm(0.4, 0.0, max(max(values), 1e-6))
        colors = colors.reversed()
    image: Any = None
    for axes, readout in zip(panels, readouts, strict=True):
        field = np.full((len(methods), len(angles)), np.nan)
        for row in matching(rows, readout=readout):
            down = methods.index(row["method"])
            across = angles.index(row["target_angle"])
            field[down, across] = row[name]
            red, green, blue = colors(norm(row[name]))[:3]
            ink = "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
            shape = {"ha": "center", "va": "center", "fontsize": SMALLEST, "color": ink}
            axes.text(across, down, _number_and_range(row, name), **shape)
        image = axes.imshow(field, aspect="auto", norm=norm, cmap=colors)
        axes.set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
        axes.set_yticks(range(len(methods)), [labels[method] for method in methods])
        axes.set_title(readout, fontsize=10)
    panels[-1].set_xlabel("target angle (degrees)")
    label = f"{TITLES[name]} (units of reward)"
    bar = picture.colorbar(image, ax=list(panels), label=label, shrink=0.7, aspect=40)
    if name == "regret":
        bar.set_ticks([tick for tick in (0, 0.1, 0.5, 1, 2, 5, 10, 20) if tick <= max(values)])
    conclusion = _best(matching(rows, readout=readouts[0]), name, labels)
    cells = f"cells: mean of {rows[0]['seeds']} seeds, below it their range"
    head(picture, f"{world}, {readouts[0]}: {conclusion}; {cells}")
    return picture


def _best(rows: Sequence[Row], name: str, labels: Mapping[str, str]) -> str:
    """Return which methods have the best mean over the angles, to two digits, as a sentence."""
    means = {method: mean(group, name) for (method,), group in groups(rows, "method").items()}
    best = min(means.values()) if name == "regret" else max(means.values())
    ahead = [labels[method] for method, value in means.items() if abs(value - best) < 0.005]
    listed = " and ".join(ahead) if len(ahead) < 4 else f"{len(ahead)} of {len(means)} methods"
    kind = "least mean regret" if name == "regret" else "greatest mean value"
    return f"{listed} {'has' if len(ahead) == 1 else 'have'} the {kind}, {best:.2f}"


def _number_and_range(row: Row, name: str) -> str:
    value, low, high = (f"{row[key]:.2f}" for key in (name, f"{name}_low", f"{name}_high"))
    value, low, high = ("0" if text in ("0.00", "-0.00") else text for text in (value, low, high))
    differs = row[f"{name}_high"] - row[f"{name}_low"] >= 0.005
    return f"{value}\n{low} to {high}" if differs else value
