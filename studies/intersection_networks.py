"""The egoist's network in the intersection: a flat list of vehicles, or a set.

The thesis' experts read a flat list of vehicles. Here others read a set, relative to the ego, with
training settings for it. The part `views` of the intersection study separates these changes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from socialiq.errors import UserError
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.config import check_counts
from socialiq.plotting.style import COLORS, figure, head
from socialiq.types import Row
from socialiq_lab.intersection.driving import HIGHWAY_EPISODES
from socialiq_lab.intersection.episodes import EPISODES
from socialiq_lab.intersection.experts import (
    EXPERT_STEPS,
    atlas_files,
    evaluations,
    expert_name,
    flat_expert,
    on_highway,
    set_expert,
)
from socialiq_lab.intersection.plots import (
    dots,
    greedy_runs,
    learning_panel,
    seeds_and_episodes,
)
from socialiq_lab.intersection.rows import (
    VIEW_OF_SHARES,
    curves,
    egoist_summary,
    evaluated,
    highway,
    policy_rows,
    times,
)
from socialiq_lab.jobs import Job
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, Study
from socialiq_lab.tables import paired_differences

NETWORKS = ("flat", "set")
STAGES = {"experts": "", "foresight": ", one look ahead"}
"""Stages, and the suffix of their labels in the figure."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (40, 41, 42, 43, 44)
    """Training seeds of the egoists; the set trio of the first seed goes into the atlas."""
    flat_steps: int = EXPERT_STEPS
    """Environment steps of an expert that reads the flat list (thesis 5.2)."""
    set_steps: int = 2_400_000
    """Environment steps of an expert that reads a set; it updates four times as often."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the intersection study's own."""
    highway_episodes: int = HIGHWAY_EPISODES
    """Episodes of each policy of the atlas on the real highway-env; 0 leaves that out."""

    def __post_init__(self) -> None:
        """Refuse empty sizes."""
        check_counts(self, ("flat_steps", "set_steps", "episodes"))
        if not self.seeds or self.highway_episodes < 0:
            raise UserError("name at least one seed, and highway_episodes of 0 or more")


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    experts = [set_expert("egoistic", seed, config.set_steps) for seed in config.seeds]
    experts += [set_expert(m, config.seeds[0], config.set_steps) for m in MODES if m != "egoistic"]
    experts += [flat_expert("egoistic", seed, config.flat_steps) for seed in config.seeds]
    driven = on_highway(members(config), config.highway_episodes)
    return [*experts, *evaluations(experts, config.episodes), *driven]


def members(config: Config) -> dict[str, str]:
    """Return the folder of the job of each policy of the atlas, by its name there."""
    return {f"set_{mode}": expert_name("set", mode, config.seeds[0]) for mode in MODES}


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    rows = policy_rows(evaluated(jobs, work))
    egoists = {
        network: [rows[expert_name(network, "egoistic", seed), "greedy"] for seed in config.seeds]
        for network in NETWORKS
    }
    tables = {
        "policies": list(rows.values()),
        "differences": paired_differences(
            egoists["set"], egoists["flat"], "collision", "arrival", "r_env"
        ),
        "curves": curves(jobs, work),
        "highway": highway(jobs, work),
        "times": times(jobs, work),
    }
    files = atlas_files("intersection-networks", members(config), work, rows)
    return Findings(tables, _summary(config, rows, egoists, tables["differences"]), files)


def _summary(
    config: Config,
    rows: Mapping[tuple[str, str], Row],
    egoists: Mapping[str, Sequence[Row]],
    differences: Sequence[Row],
) -> dict[str, Any]:
    """Summarize the egoists, the trio that reads a set, the differences and the settings."""
    return egoist_summary(egoists) | {
        "trio": {name: rows[job, "greedy"] for name, job in members(config).items()},
        "differences": {row["metric"]: row for row in differences},
        "settings": {
            "flat": dataclasses.asdict(flat_expert("egoistic", 0, config.flat_steps).config),
            "set": dataclasses.asdict(set_expert("egoistic", 0, config.set_steps).config),
        },
    }


def draw(results: Results) -> dict[str, Figure]:
    """Draw all figures of the study."""
    return {"egoists": _egoists(results), "learning": _learning(results)}


def _egoists(results: Results) -> Figure:
    """Draw collisions and arrivals of every seed, with and without a look at the true future."""
    runs = [
        ([f"{parts[0]}{suffix}", *parts[1:]], row)
        for stage, suffix in STAGES.items()
        for parts, row in greedy_runs(results, stage)
        if parts[1] == "egoistic"
    ]
    drawn = dots(runs, 3.0, results.summary["target"])
    title = "Intersection: the egoist by network (dashed: what a good one should reach)"
    head(drawn, f"{title}\n{seeds_and_episodes(runs)} (dot: a seed, bar: mean)")
    return drawn


def _learning(results: Results) -> Figure:
    """Draw the value at the own angle by updates: the mean over seeds, and their range."""
    drawn = figure(9.1, 3.4)
    for axes, network in zip(drawn.subplots(1, 2, sharey=True), NETWORKS, strict=True):
        title = f"experts with the {network} network"
        learning_panel(axes, results, f"experts/{network}", list(COLORS)[1:], title)
    drawn.axes[0].set_ylabel("value at the own angle (reward)")
    seeds = len(results.config["seeds"])
    title = f"Intersection: learning curves; egoist: mean and range of {seeds} seeds"
    head(drawn, title, drawn.axes[1])
    return drawn


STUDY = Study(
    name="intersection-networks",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=VIEW_OF_SHARES,
)
