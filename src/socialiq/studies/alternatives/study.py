"""Alternative places of the prior (thesis appendix B), trained in the 7x7 world.

The thesis argues against the Bellman shift (B.1) and against reweighting (B.2) without running
them. Here they are, beside the reward regularization and the shifted χ², over a range of strengths.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from socialiq.evaluation.expert_demonstrations import MODES, trajectory_datasets
from socialiq.experiments.gridworld_runs import Ground, pooled, rows_of, train_runs
from socialiq.experiments.study import Context, Findings, StageCallback
from socialiq.experiments.tables import nested
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import StaticConfig
from socialiq.types import Row

KEYS = ("integration", "strength", "target_angle", "readout")

INTEGRATIONS: dict[str, StaticConfig] = {
    "reward": presets.GRID,
    "bellman_shift, term 1": dataclasses.replace(presets.GRID, prior="bellman_shift"),
    "bellman_shift, terms 1 and 3": dataclasses.replace(
        presets.GRID, prior="bellman_shift", shift_term_3=True
    ),
    "reweighting": dataclasses.replace(presets.GRID, prior="reweighting"),
    "shifted_chi2, instantaneous": dataclasses.replace(
        presets.GRID, prior="shifted_chi2", target_kind="instantaneous"
    ),
}


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds, each with a data set of its own."""
    strengths: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    """λ; for reweighting 1/τ_w, which is what multiplies R(α) there."""
    episodes_each: int = 60
    """Episodes of each expert."""
    updates: int = presets.GRID.updates
    """Gradient steps."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train each integration at every angle, strength and seed; evaluate exactly."""
    ground = Ground.of("crossing7")
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    rows: list[Row] = []
    for name, structure in INTEGRATIONS.items():
        rows += _rows(ground, config, name, structure, datasets, context.on_stage)
    tables = {"policies": rows, "pooled": pooled(rows, KEYS)}
    return Findings(tables, _summary(tables))


def _rows(
    ground: Ground,
    config: Config,
    name: str,
    structure: StaticConfig,
    datasets: list[Any],
    on_stage: StageCallback,
) -> list[Row]:
    runs = [
        (angle, strength, dataset, seed)
        for angle in MODES.values()
        for strength in config.strengths
        for dataset, seed in enumerate(config.seeds)
    ]
    numbers = [
        dataclasses.replace(
            presets.TABLE_C1_NUMBERS,
            angle=angle,
            strength=strength,
            reweight_temperature=1.0 / strength,
            seed=seed,
            dataset=dataset,
        )
        for angle, strength, dataset, seed in runs
    ]
    structure = dataclasses.replace(structure, updates=config.updates)
    trained = train_runs(ground, structure, numbers, datasets, on_stage(f"7x7, {name}"))
    rows: list[Row] = []
    for run, (angle, strength, _, seed) in enumerate(runs):
        label = {"integration": name, "strength": strength, "target_angle": angle}
        rows += rows_of(ground, [trained.policy(run)], angle, label, [seed])
    return rows


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Pooled angle and regret by integration, readout, target angle and strength."""
    keys = ("integration", "readout", "target_angle", "strength")
    return nested(tables["pooled"], *keys, keep=("angle", "regret", "arrival"))
