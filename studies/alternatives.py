"""Alternative places of the prior (thesis appendix B), trained in the 7x7 world.

The thesis argues against the Bellman shift (B.1) and against reweighting (B.2) without running
them. This study trains both, beside the reward regularization and the shifted χ², over a range of
strengths.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import MODES, trajectory_datasets
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import StaticConfig
from socialiq.plotting.style import figure, plain
from socialiq.types import Row
from socialiq_lab.gridworld_runs import Ground, grid_of, pooled, rows_of, train_runs
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, StageCallback, Study, view_of
from socialiq_lab.tables import column, matching, nested

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
"""Places of the prior, by name in the tables."""

_COLORS = ("#2166ac", "#888888", "#1b7837", "#e08214", "#c23b22")


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds, each with its own data set."""
    strengths: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    """λ; for reweighting 1/τ_w, which multiplies R(α) there."""
    episodes_each: int = 60
    """Episodes of each expert."""
    updates: int = presets.GRID.updates
    """Gradient steps."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train each integration at every angle, strength and seed; evaluate exactly."""
    ground = Ground.of("crossing7")
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    rows: list[Row] = []
    for name in INTEGRATIONS:
        rows += _policy_rows(ground, config, name, datasets, context.on_stage)
    means = pooled(rows, ("integration", "strength", "target_angle", "readout"))
    keys = ("integration", "readout", "target_angle", "strength")
    summary = nested(means, *keys, keep=("angle", "regret", "arrival"))
    return Findings({"policies": rows, "pooled": means}, summary)


def _policy_rows(
    ground: Ground,
    config: Config,
    name: str,
    datasets: Sequence[Demonstrations],
    on_stage: StageCallback,
) -> list[Row]:
    angles = list(MODES.values())
    runs = [
        dataclasses.replace(run, reweight_temperature=1.0 / run.strength)
        for run in grid_of(angles, config.strengths, config.seeds, presets.TABLE_C1_NUMBERS)
    ]
    static = dataclasses.replace(INTEGRATIONS[name], updates=config.updates)
    trained = train_runs(ground, static, runs, datasets, on_stage(f"7x7, {name}"))
    rows: list[Row] = []
    for number, run in enumerate(runs):
        label = {"integration": name, "strength": run.strength, "target_angle": run.angle}
        rows += rows_of(ground, [trained.policy(number)], run.angle, label, [run.seed])
    return rows


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw regret against strength in a panel for each target angle; greedy full, soft dashed."""
    rows = results.tables["pooled"]
    angles = sorted({row["target_angle"] for row in rows})
    names = list(dict.fromkeys(row["integration"] for row in rows))
    drawn = figure(4.2 * len(angles), 4.2)
    panels = drawn.subplots(1, len(angles), sharex=True)
    for axes, angle in zip(panels, angles, strict=True):
        for name, color in zip(names, _COLORS, strict=True):
            for readout, line in (("greedy", "-"), ("soft", "--")):
                curve = matching(rows, integration=name, target_angle=angle, readout=readout)
                label = name if readout == "greedy" else None
                points = column(curve, "strength"), column(curve, "regret")
                axes.plot(*points, line, marker=".", color=color, label=label)
        axes.set_xscale("log")
        axes.set(xlabel="λ (reweighting: 1/τ_w)", ylabel="regret at the target")
        axes.set_title(f"target {angle:g}° (full: greedy, dashed: soft)", fontsize=10)
        plain(axes)
    panels[0].legend(frameon=False, fontsize=8)
    return {"regret": drawn}


STUDY = Study(
    name="alternatives",
    Config=Config,
    tables=compute_tables,
    figures=draw_figures,
    view=view_of("pooled"),
)
