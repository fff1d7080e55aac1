"""Exact tables, summary and figures of the 7x7 study, which complete the policies' metrics."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.evaluation import exact, rollout
from socialiq.evaluation.stops import stop_rows, visited
from socialiq.plotting.style import COLORS, Mark, ring
from socialiq.plotting.thesis import stop_maps
from socialiq.results_folder import Results, where
from socialiq.types import Row
from socialiq.worlds.tabular_policy import expert_policy
from socialiq_lab.declared import State
from socialiq_lab.study import View

KEYS = ("method", "mixture", "target_kind", "strength", "target_angle", "readout")
THESIS_ANGLES = {"baseline": 152.0, "egoistic": -42.0, "prosocial": 39.0, "altruistic": 152.0}


def expert_rows(state: State) -> list[Row]:
    """Return the experts (stationary, γ 0.99), each with the optimum of policies with a clock."""
    ground = state.ground
    reachable = ground.table.mdp.reachable()
    rows = []
    for mode, angle in rollout.MODES.items():
        metrics = exact.evaluate_exactly(ground.part, expert_policy(ground.table, angle)[reachable])
        best = ground.optimum.attainable.optimum(angle)
        rows.append(
            {"mode": mode, "target_angle": angle}
            | metrics._asdict()
            | {"regret": ground.optimum.regret(metrics, angle), "optimum_value": best.value}
        )
    return rows


def _is_of_figure(row: Row, config: Any) -> bool:
    """Whether a policy is the baseline, or a target of the first kind and strength."""
    settings = row["method"], row["target_kind"], row["strength"]
    first = "reward_regularized", config.target_kinds[0], config.strengths[0]
    is_shown = settings in (("baseline", "none", 0.0), first)
    return is_shown and row["mixture"] == "equal_trajectories"


def _visited(state: State) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield name, action table and visits of experts, and of the figures' policies over seeds."""
    ground = state.ground
    names = {angle: mode for mode, angle in rollout.MODES.items()}
    tables = {
        f"expert {mode}": [expert_policy(ground.table, angle)[ground.table.mdp.reachable()]]
        for mode, angle in rollout.MODES.items()
    }
    for learned in state.policies:
        if _is_of_figure(learned.label, state.config):
            is_baseline = learned.label["method"] == "baseline"
            name = "baseline" if is_baseline else names[learned.label["target_angle"]]
            table = exact.action_table(learned.policy, ground.part, "greedy")
            tables.setdefault(name, []).append(table)
    for name, of_seeds in tables.items():
        yield name, *visited(ground.part, np.mean(of_seeds, axis=0))


def heatmap_rows(state: State) -> list[Row]:
    """Return P(STOP) by the vehicles' places of each policy (Figs 6.3, 6.4)."""
    reachable = state.ground.part
    return [row for policy in _visited(state) for row in stop_rows(reachable, *policy)]


def distance_rows(state: State) -> list[Row]:
    """Return P(STOP) before the conflict by the distance of the nearest approaching vehicle."""
    states = state.ground.part.states
    gaps = np.where((states[:, [2, 4]] >= 0) & (states[:, [2, 4]] < 3), 3 - states[:, [2, 4]], 9)
    rows = []
    for name, table, visits in _visited(state):
        for distance in (1, 2, 3, 9):
            chosen = (states[:, 0] == 2) & (gaps.min(axis=1) == distance)
            weight = float(visits[chosen].sum())
            stops = float(visits[chosen] @ table[chosen, 0]) / weight if weight > 1e-9 else ""
            label = {"policy": name, "distance": distance if distance < 9 else "none approaching"}
            rows.append(label | {"visits": weight, "stops": stops})
    return rows


def attainable_rows(state: State) -> list[Row]:
    """Return the optimum of each angle and the radius of mixtures."""
    attainable = state.ground.optimum.attainable
    rows = []
    for angle in range(0, 91, 5):
        best = attainable.optimum(float(angle))
        rows.append(
            {
                "angle": angle,
                "optimum_r_env": best.point.env,
                "optimum_r_social": best.point.social,
                "optimum_value": best.value,
                "radius": attainable.radius(float(angle)),
            }
        )
    return rows


def data_rows(state: State) -> list[Row]:
    """Return what each data set holds of each expert."""
    return [
        {
            "mixture": f"equal_{kind.partition(' ')[0]}",
            "dataset": number,
            "mode": mode,
            "episodes": episodes,
            "transitions": transitions,
            "share_of_transitions": transitions / data.n_transitions,
        }
        for kind, datasets in state.data.items()
        for number, data in enumerate(datasets)
        for mode, (episodes, transitions) in data.counts().items()
    ]


def summary(state: State) -> dict[str, Any]:
    """Return pooled metrics of the figures' policies and the experts, by name."""
    chosen: dict[str, dict] = {}
    names = {angle: mode for mode, angle in rollout.MODES.items()}
    for row in state.tables["pooled"]:
        if not _is_of_figure(row, state.config):
            continue
        values = {key: row[key] for key in row if key not in KEYS}
        if row["method"] == "baseline":
            entry = chosen.setdefault(f"baseline_{row['readout']}", values)
            entry[f"regret_at_{row['target_angle']:g}"] = row["regret"]
        else:
            chosen[f"{names[row['target_angle']]}_{row['readout']}"] = values
    return {"policies": chosen, "experts": {row["mode"]: row for row in state.tables["experts"]}}


def comparison(results: Results) -> list[Row]:
    """Return target angle and achieved angle, the thesis' and the optimum's, by policy."""
    rows: list[Row] = []
    for name, angle in {"baseline": None, **rollout.MODES}.items():
        entry = results.summary["policies"][f"{name}_greedy"]
        expert = results.summary["experts"].get(name, {})
        rows.append(
            {
                "policy": name,
                "target": "none" if angle is None else f"{angle:g}",
                "angle": entry["angle"],
                "thesis": THESIS_ANGLES[name],
                "optimum": expert.get("angle", ""),
                "regret": "" if angle is None else entry["regret"],
                "arrival": entry["arrival"],
                "timeout": entry["timeout"],
            }
        )
    return rows


def view(results: Results) -> list[View]:
    """Return the policies of the figures with the thesis' and the optimum's angles."""
    return [View(comparison(results), "angle in degrees; greedy, means over seeds, exact")]


def ring_figure(results: Results) -> dict[str, Figure]:
    """Draw Fig 6.2: the empirical angle of each policy, the thesis' as an open mark outside."""
    entries = {name: results.summary["policies"][f"{name}_greedy"] for name in COLORS}
    marks = []
    for name, entry in entries.items():
        thesis = THESIS_ANGLES[name]
        label = f"{name}: {entry['angle']:.1f}° (thesis {thesis:.0f}°)"
        marks.append(Mark(name, entry["angle"], label, thesis))
    seeds = entries["baseline"]["seeds"]
    title = "All policies but the prosocial one show the thesis' angle in the 7x7 world"
    title = f"{title}\n(greedy, {seeds} seeds; open marks: thesis)"
    return {"fig_6_2_ring": ring(marks, title)}


def map_figures(results: Results) -> dict[str, Figure]:
    """Draw Figs 6.3 and 6.4: where the experts and the learned policies stop."""
    titles = {
        "fig_6_3_experts": "above by the policy's visits, below over all reachable states",
        "fig_6_4_learned": "Where it comes, the egoistic learner does not stop, the altruistic one "
        "does (before the conflict; above: by visits, below: all reachable states)",
    }
    names = [f"expert {mode}" for mode in rollout.MODES], list(COLORS)
    rows = results.tables["heatmaps"]
    pictures = {
        figure: stop_maps(where(rows, {"policy": policies}), title)
        for (figure, title), policies in zip(titles.items(), names, strict=True)
    }
    return {figure: picture for figure, picture in pictures.items() if picture}
