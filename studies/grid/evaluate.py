"""Exact tables of the 7x7 study beside the policies' metrics: experts, heatmaps, optima."""

from __future__ import annotations

import numpy as np

from socialiq.evaluation.exact import Readout, action_table, evaluate_exactly
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Row
from socialiq.worlds.tabular_policy import expert_policy
from socialiq_lab.gridworld_runs import Ground


def expert_rows(ground: Ground) -> list[Row]:
    """Return the experts (stationary, γ 0.99), each with the optimum of policies with a clock."""
    kept = ground.table.mdp.reachable()
    rows = []
    for mode, angle in MODES.items():
        metrics = evaluate_exactly(ground.part, expert_policy(ground.table, angle)[kept])
        best = ground.optimum.attainable.optimum(angle)
        rows.append(
            {"mode": mode, "target_angle": angle}
            | metrics._asdict()
            | {"regret": ground.optimum.regret(metrics, angle), "optimum_value": best.value}
        )
    return rows


def _policies_with_experts(
    ground: Ground, headline: dict[str, list[QPolicy]], readout: Readout
) -> dict[str, np.ndarray]:
    """Return action tables by name: experts, and trained policies averaged over their seeds."""
    kept = ground.table.mdp.reachable()
    tables = {
        f"expert {mode}": expert_policy(ground.table, angle)[kept] for mode, angle in MODES.items()
    }
    for name, policies in headline.items():
        each = [action_table(policy, ground.part, readout) for policy in policies]
        tables[name] = np.mean(each, axis=0)
    return tables


def heatmaps(ground: Ground, headline: dict[str, list[QPolicy]]) -> list[Row]:
    """Return P(STOP) in the cell before the conflict by the vehicles' positions (Figs 6.3, 6.4).

    `weighted` averages over states by the policy's visits and is empty where it has none;
    `unweighted` averages over all reachable states, also those that don't occur.
    """
    states = ground.part.states
    decision = states[:, 0] == 2
    rows = []
    for name, table in _policies_with_experts(ground, headline, "greedy").items():
        visits = _visits(ground, table)
        for y_1 in range(-1, 7):
            for y_2 in range(-1, 7):
                chosen = decision & (states[:, 2] == y_1) & (states[:, 4] == y_2)
                if not chosen.any():
                    continue
                weight = float(visits[chosen].sum())
                stop = table[chosen, 0]
                rows.append(
                    {
                        "policy": name,
                        "y_1": y_1,
                        "y_2": y_2,
                        "visits": weight,
                        "weighted": float(visits[chosen] @ stop) / weight if weight > 1e-9 else "",
                        "unweighted": float(stop.mean()),
                    }
                )
    return rows


def distances(ground: Ground, headline: dict[str, list[QPolicy]]) -> list[Row]:
    """Return P(STOP) before the conflict by the distance of the nearest approaching vehicle."""
    states = ground.part.states
    decision = states[:, 0] == 2
    gaps = np.where((states[:, [2, 4]] >= 0) & (states[:, [2, 4]] < 3), 3 - states[:, [2, 4]], 9)
    nearest = gaps.min(axis=1)
    rows = []
    for name, table in _policies_with_experts(ground, headline, "greedy").items():
        visits = _visits(ground, table)
        for distance in (1, 2, 3, 9):
            chosen = decision & (nearest == distance)
            weight = float(visits[chosen].sum())
            stops = float(visits[chosen] @ table[chosen, 0])
            rows.append(
                {
                    "policy": name,
                    "distance": distance if distance < 9 else "none approaching",
                    "visits": weight,
                    "stops": stops / weight if weight > 1e-9 else "",
                }
            )
    return rows


def _visits(ground: Ground, table: np.ndarray) -> np.ndarray:
    evaluation = horizon_evaluation(ground.part.mdp, table, ground.part.world.horizon)
    return evaluation.visits.sum(axis=1)


def attainable_rows(ground: Ground) -> list[Row]:
    """Return the optimum of each angle and the radius of mixtures."""
    rows = []
    for angle in range(0, 91, 5):
        best = ground.optimum.attainable.optimum(float(angle))
        rows.append(
            {
                "angle": angle,
                "optimum_r_env": best.point.env,
                "optimum_r_social": best.point.social,
                "optimum_value": best.value,
                "radius": ground.optimum.attainable.radius(float(angle)),
            }
        )
    return rows
