"""Statements and predictions of the theory against exact minima and trained networks."""

from typing import Any

from socialiq import UserError
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.prediction import NEXT_VALUES
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.types import Row
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, groups
from studies.theory import small_strength, statements, training


def compute_tables(config: Any, context: Context) -> Findings:
    """Solve the exact problems, train networks, and compare both with the theory."""
    if not config.seeds or config.random_worlds < 1:
        raise UserError("the study theory needs a seed and a random world at least")
    worlds, seeds = statements.gridworlds(), range(config.random_worlds)

    def cases(*kinds: str) -> list[statements.Case]:
        grids = statements.grid_cases(worlds, kinds, config.angles)
        return grids + statements.random_cases(seeds, kinds)

    grids = statements.grid_cases(worlds, angles=config.angles)
    every = grids + statements.random_cases(seeds)
    plain = [case for case in every if case.target_kind == "instantaneous"]
    chosen = [case for case in grids if case.world == "crossing7" and case.angle == 0.0]
    alternatives = {name: cases(name) for name in ("advantage", "own_advantage", "to_go")}
    cold, seven = small_strength.COLD, worlds["crossing7"]
    ground = Ground.of("crossing7")
    data = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    runs, firsts = training.trained_rows(ground, config, data, context.on_stage)
    tables = {
        "minima": statements.minimum_rows(every),
        "rewards": statements.reward_rows(chosen),
        "primal": statements.primal_rows(chosen),
        "shaping": statements.shaping_rows(plain, alternatives),
        "zero": statements.zero_rows([case for case in plain if case.angle == 0.0]),
        "offline": statements.offline_rows(every),
        "path": small_strength.path_rows(chosen, (cold, 0.1, 1.0)),
        "slopes": small_strength.slope_rows(every),
        "flips": [row for way in NEXT_VALUES for row in small_strength.flip_rows(every, way)],
        "lengths": [
            row
            for temperature in (1.0, cold)
            for row in small_strength.length_rows(seven, config.angles, config.lengths, temperature)
        ],
        "predicted": training.predicted_rows(ground, config.target_kinds),
        "trained": runs,
        "first_flips": firsts,
    }
    return Findings(tables, _summary(tables, len(config.seeds)))


def _summary(tables: dict[str, list[Row]], seeds: int) -> dict[str, Any]:
    """Largest errors of each statement, ratios, counts and lengths."""

    def largest(table: str, name: str) -> float:
        return float(max(column(tables[table], name)))

    changes = {
        change: column(rows, "log10_difference")
        for (change,), rows in groups(tables["shaping"], "change").items()
    }
    slopes = [row["measured"] / row["predicted"] for row in tables["slopes"] if row["predicted"]]
    return {
        "seeds": seeds,
        "minima": len(tables["minima"]),
        "log10_closed_error": largest("minima", "log10_closed_error"),
        "log10_duality_gap": largest("minima", "log10_duality_gap"),
        "largest_correction": largest("minima", "largest_correction"),
        "primal_gained": largest("primal", "gained"),
        "log10_offline_error": largest("offline", "log10_error"),
        "shaping": {
            change: {"log10_largest": max(values), "log10_least": min(values)}
            for change, values in changes.items()
        },
        "zero": {
            "from_baseline": {row["world"]: row["largest_difference"] for row in tables["zero"]},
            "log10_from_baseline_sixth": largest("zero", "log10_from_baseline_sixth"),
        },
        "slopes": {"cases": len(slopes), "least_ratio": min(slopes), "largest_ratio": max(slopes)},
        "flips": {way: training.flip_counts(tables["flips"], way) for way in NEXT_VALUES},
        "lengths": training.growth(tables["lengths"]),
        "training": training.trained_summary(tables),
    }
