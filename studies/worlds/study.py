"""Exact facts about the two gridworlds and their experts (thesis 5.1, 5.2, Fig 6.3)."""

import dataclasses
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq import score, tabulate, weights
from socialiq.evaluation.exact import Metrics, Optimum, evaluate_exactly
from socialiq.evaluation.rollout import MODES, demonstrations_by_mode, rollout_table
from socialiq.learners.iq_learn import config as presets
from socialiq.mdp.solve import greedy_policy, value_iteration
from socialiq.results_folder import Results
from socialiq.social.angle import angle_of, exact_weights
from socialiq.statistics.comparisons import cohens_d
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.pictures import filmstrip, picture
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import Variant, expert_policy
from socialiq_lab.gridworld_runs import sequence
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import options_name

VARIANTS = declaration("worlds")["variants"]
"""Changed options of each named reading of a world."""


def compute_tables(config: Any, context: Context) -> Findings:  # noqa: ARG001
    """Enumerate and solve every named variant of both worlds.

    Args:
        config: Configuration of the study; `episodes` and the first seed are read.
        context: Not used.

    Returns:
        Tables of both worlds, and the summary.
    """
    table = tabulate(make_grid("crossing7"))
    tables = {
        "crossing5_readings": [_crossing5_row(options) for options in VARIANTS["crossing5"]],
        "crossing5_ties": _tie_rows(),
        "crossing7_readings": [_crossing7_row(options) for options in VARIANTS["crossing7"]],
        "crossing7_front": _front_rows(table),
        "crossing7_separability": _separability(table, config.episodes, config.seeds[0]),
    }
    experts = {mode: _stationary(table, angle)._asdict() for mode, angle in MODES.items()}
    steps = sum(metrics["length"] for metrics in experts.values())
    variants = tables["crossing7_readings"]
    five = _world_summary(tabulate(make_grid("crossing5"))) | {
        "experts": tables["crossing5_readings"][0],
        "exact_trigonometry": tables["crossing5_ties"][2],
    }
    seven = _world_summary(table) | {
        "slots": 2,
        "spawn_probability": table.world.options.spawn_probability,
        "experts": experts,
        "share_of_transitions": {mode: row["length"] / steps for mode, row in experts.items()},
        "optimal_angles_by_reading": {
            row["reading"]: {mode: row[f"{mode}_angle"] for mode in MODES} for row in variants
        },
        "optimum_angle_by_angle": {
            f"{row['angle']:g}": row["angle_of_optimum"] for row in tables["crossing7_front"]
        },
        "largest_collision": max(variants[0][f"{mode}_collision"] for mode in MODES),
        "separability": {
            f"{row['first']}_{row['second']}": {"env": row["d_env"], "social": row["d_social"]}
            for row in tables["crossing7_separability"]
        },
    }
    numbers = dataclasses.asdict(presets.TABLE_C1_NUMBERS) | dataclasses.asdict(presets.TABLE_C1)
    kinds = {"poc": presets.POC, "grid": presets.GRID, "lambda-sweep": presets.SWEEP}
    settings = {
        "table_c1": numbers,
        "strengths_of_the_sweep": len(presets.SWEEP_STRENGTHS),
        "target_kinds": {name: preset.target_kind for name, preset in kinds.items()},
    }
    names = ("crossing5", "crossing7")
    options = {name: dataclasses.asdict(make_grid(name).options) for name in names}
    summary = {"crossing5": five, "crossing7": seven, "options": options, "presets": settings}
    return Findings(tables, summary)


def _crossing5_row(options: dict[str, str]) -> Row:
    table = tabulate(make_grid("crossing5", **options))
    experts = {mode: sequence(table, expert_policy(table, a)) for mode, a in MODES.items()}
    return {"reading": options_name(options)} | experts


def _tie_rows() -> list[Row]:
    """Return the experts of the default 5x5 world by the treatment of ties and of cos 90°."""
    table = tabulate(make_grid("crossing5"))
    rows: list[Row] = []
    for trigonometry, pair in (("cos 90 = 6e-17", weights), ("cos 90 = 0", exact_weights)):
        for prefer in ("first", "last"):
            name = "Wait" if prefer == "first" else "Go"
            row: Row = {"trigonometry": trigonometry, "ties_to": name}
            for mode, angle in MODES.items():
                reward = score(pair(angle), table.mdp.rewards)
                q = value_iteration(table.mdp, reward, 0.99).q
                row[mode] = sequence(table, greedy_policy(q, prefer=prefer))
            rows.append(row)
    return rows


def _crossing7_row(options: dict[str, str]) -> Row:
    """Return angle, totals and collisions of the stationary optimum at the three angles."""
    table = tabulate(make_grid("crossing7", **options))
    row: Row = {"reading": options_name(options), "reachable": table.reachable_part().mdp.n_states}
    for mode, angle in MODES.items():
        metrics = _stationary(table, angle, "stochastic")
        columns = ("angle", "r_env", "r_social", "collision")
        row |= {f"{mode}_{name}": getattr(metrics, name) for name in columns}
    return row


def _stationary(table: Table, angle: float, variant: Variant = "deterministic") -> Metrics:
    """Return the exact metrics of the stationary optimum (γ 0.99) at an angle."""
    policy = expert_policy(table, angle, variant)[table.mdp.reachable()]
    return evaluate_exactly(table.reachable_part(), policy)


def _front_rows(table: Table) -> list[Row]:
    """Return, by angle, the optimum with a clock, the stationary one, and the largest radius."""
    attainable = Optimum(table.reachable_part()).attainable
    rows = []
    for angle in np.arange(0.0, 91.0, 5.0):
        best = attainable.optimum(angle)
        stationary = _stationary(table, angle, "stochastic")
        rows.append(
            {
                "angle": angle,
                "r_env": best.point.env,
                "r_social": best.point.social,
                "angle_of_optimum": angle_of(*best.point),
                "value": best.value,
                "stationary_angle": stationary.angle,
                "stationary_value": stationary.value(angle),
                "radius": attainable.radius(angle),
            }
        )
    return rows


def _separability(table: Table, episodes: int, seed: int) -> list[Row]:
    """Return Cohen's d of the experts' episode totals, pairwise (the analysis of Table A.2)."""
    pools = demonstrations_by_mode(table, dict.fromkeys(MODES, episodes), seed)
    totals = {mode: pool.totals() for mode, pool in pools.items()}
    pairs = (("egoistic", "prosocial"), ("prosocial", "altruistic"), ("egoistic", "altruistic"))
    return [
        {
            "first": first,
            "second": second,
            "d_env": cohens_d(totals[first].env, totals[second].env),
            "d_social": cohens_d(totals[first].social, totals[second].social),
        }
        for first, second in pairs
    ]


def _world_summary(table: Table) -> dict[str, Any]:
    """Return sizes and reward weights of a world."""
    return {
        "states": table.mdp.n_states,
        "reachable_states": table.reachable_part().mdp.n_states,
        "features": table.world.n_features,
        "actions": table.mdp.n_actions,
        "horizon": table.world.horizon,
        "weights": {**table.world.env_weights, **table.world.social_weights},
    }


def pictures(results: Results) -> dict[str, Figure]:
    """Draw the first state of each world (Figs 5.1, 5.2) and a seeded prosocial episode."""
    figures = {}
    for number, name in enumerate(("crossing5", "crossing7"), start=1):
        table = tabulate(make_grid(name))
        figures[f"fig_5_{number}"] = picture(table.world, table.world.start[0][0])
        policy = expert_policy(table, MODES["prosocial"])
        steps = rollout_table(table, policy, 1, results.config["seeds"][0]).transitions
        states = np.vstack([steps.observation, steps.next_observation[-1:]]).astype(int)
        figures[f"{name}_prosocial_episode"] = filmstrip(table.world, states.tolist())
    return figures
