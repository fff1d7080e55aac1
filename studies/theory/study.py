"""Statements and predictions of the theory against exact minima and trained networks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from socialiq.errors import UserError
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.prediction import NEXT_VALUES
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.types import Row
from socialiq_lab.study import Context, Findings, StageCallback
from socialiq_lab.tables import column, groups
from studies.theory import small_strength as lines
from studies.theory import statements, training
from studies.theory.statements import Case
from studies.theory.training import flip_counts, growth, trained_summary


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds, each with its own data set."""
    angles: tuple[float, ...] = statements.ANGLES
    """α in degrees of the exact part in the gridworlds; networks are trained at 0 degrees."""
    random_worlds: int = 6
    """Number of random worlds, of seeds 0, 1, ..., beside the gridworlds."""
    target_kinds: tuple[str, ...] = training.TARGETS
    """Targets of the trained networks' prior."""
    units: tuple[float, ...] = (0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
    """λ ‖T_⊥‖ of the trained networks, the same for every target."""
    lengths: tuple[float, ...] = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
    """λ of the exact episode lengths."""
    episodes_each: int = 60
    """Episodes of each expert in a data set."""
    updates: int = 3000
    """Gradient steps."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Solve the exact problems, train networks, and compare both with the theory."""
    if not config.seeds or config.random_worlds < 1:
        raise UserError("the study theory needs a seed and a random world at least")
    worlds = statements.gridworlds()
    grids = statements.grid_cases(worlds, angles=config.angles)
    randoms = statements.random_cases(range(config.random_worlds))
    tables = _statements(worlds, grids, randoms)
    tables |= _small_strengths(worlds, grids, randoms, config)
    tables |= _training(config, context.on_stage)
    return Findings(tables, _summary(tables, len(config.seeds)))


def _statements(
    worlds: dict[str, Any], grids: list[Case], randoms: list[Case]
) -> dict[str, list[Row]]:
    """Return the tables of the statements that hold at any λ."""
    plain = [case for case in grids + randoms if case.target_kind == "instantaneous"]
    chosen = [case for case in grids if case.world == "crossing7" and case.angle == 0.0]
    angles = list(dict.fromkeys(case.angle for case in grids))
    seeds = range(len({case.world for case in randoms}))
    alternatives = {
        name: statements.grid_cases(worlds, (name,), angles)
        + statements.random_cases(seeds, (name,))
        for name in ("advantage", "own_advantage", "to_go")
    }
    return {
        "minima": statements.minimum_rows(grids + randoms),
        "rewards": statements.reward_rows(chosen),
        "primal": statements.primal_rows(chosen),
        "shaping": statements.shaping_rows(plain, alternatives),
        "zero": statements.zero_rows(
            [case for case in plain if case.angle == 0.0]  # λ = 0 has no angle
        ),
        "offline": statements.offline_rows(grids + randoms),
    }


def _small_strengths(
    worlds: dict[str, Any],
    grids: list[Case],
    randoms: list[Case],
    config: Config,
) -> dict[str, list[Row]]:
    """Return the tables of the statements for small λ."""
    chosen = [case for case in grids if case.world == "crossing7" and case.angle == 0.0]
    flips = [row for way in NEXT_VALUES for row in lines.flip_rows(grids + randoms, way)]
    lengths = [
        row
        for temperature in (1.0, lines.COLD)
        for row in lines.length_rows(
            worlds["crossing7"], config.angles, config.lengths, temperature
        )
    ]
    return {
        "path": lines.path_rows(chosen, (lines.COLD, 0.1, 1.0)),
        "slopes": lines.slope_rows(grids + randoms),
        "flips": flips,
        "lengths": lengths,
    }


def _training(config: Config, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Train networks in the 7x7 world; return them with their predictions."""
    ground = Ground.of("crossing7")
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    plan = training.Plan(config.target_kinds, config.units, config.seeds, config.updates)
    runs, firsts = training.trained_rows(ground, plan, datasets, on_stage)
    return {
        "predicted": training.predicted_rows(ground, config.target_kinds),
        "trained": runs,
        "first_flips": firsts,
    }


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
        "slopes": {
            "cases": len(slopes),
            "least_ratio": min(slopes),
            "largest_ratio": max(slopes),
        },
        "flips": {way: flip_counts(tables["flips"], way) for way in NEXT_VALUES},
        "lengths": growth(tables["lengths"]),
        "training": trained_summary(tables),
    }
