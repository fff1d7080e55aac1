"""Is the expert's network the limit? The egoist of two networks, and a trio that sees a set.

The thesis' experts read a flat list of vehicles. Here others see them as a set, from the ego, and
are trained as that likes it; what of this makes the difference is the part `views` of the
intersection study.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from socialiq.errors import UserError
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection import atlas_files
from socialiq.experiments.intersection.experts import (
    EXPERT_STEPS,
    SHARES,
    TARGET,
    evaluations,
    expert_name,
    flat_expert,
    on_highway,
    reaches,
    set_expert,
)
from socialiq.experiments.intersection.jobs import EPISODES, HIGHWAY_EPISODES
from socialiq.experiments.intersection.rows import curves, highway, played, policy_row, times
from socialiq.experiments.jobs import Job
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import paired_row, spread, with_holm
from socialiq.types import Row

NETWORKS = ("flat", "set")


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (40, 41, 42, 43, 44)
    """Training seeds of the egoists; the first one's trio that sees a set goes into the atlas."""
    flat_steps: int = EXPERT_STEPS
    """Environment steps of an expert that reads the flat list (thesis 5.2)."""
    set_steps: int = 2_400_000
    """Environment steps of an expert that sees a set; it updates four times as often."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the intersection study's own."""
    highway_episodes: int = HIGHWAY_EPISODES
    """Episodes of each policy of the atlas on the real highway-env; 0 leaves that out."""

    def __post_init__(self) -> None:
        """Refuse what makes no run."""
        for name in ("flat_steps", "set_steps", "episodes"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not self.seeds or self.highway_episodes < 0:
            raise UserError("name at least one seed, and highway_episodes of 0 or more")


def plan(config: Config) -> list[Job]:
    """Every job, each after its inputs."""
    experts = [set_expert("egoistic", seed, config.set_steps) for seed in config.seeds]
    experts += [set_expert(m, config.seeds[0], config.set_steps) for m in MODES if m != "egoistic"]
    experts += [flat_expert("egoistic", seed, config.flat_steps) for seed in config.seeds]
    driven = on_highway(members(config), config.highway_episodes)
    return [*experts, *evaluations(experts, config.episodes), *driven]


def members(config: Config) -> dict[str, str]:
    """Folder of the job of each policy of the atlas, by its name there."""
    return {f"set_{mode}": expert_name("set", mode, config.seeds[0]) for mode in MODES}


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    rows = {(one.name, one.readout): policy_row(one) for one in played(jobs, work)}
    egoists = _egoists(config, rows)
    tables = {
        "policies": list(rows.values()),
        "differences": _differences(egoists) if len(config.seeds) > 1 else [],
        "curves": curves(jobs, work),
        "highway": highway(jobs, work),
        "times": times(jobs, work),
    }
    files = atlas_files.files("intersection-networks", members(config), work, rows)
    return Findings(tables, _summary(config, rows, egoists, tables), files)


def _egoists(config: Config, rows: Mapping[tuple[str, str], Row]) -> dict[str, list[Row]]:
    """Rows of the egoists of each network, by seed."""
    return {
        network: [rows[expert_name(network, "egoistic", seed), "greedy"] for seed in config.seeds]
        for network in NETWORKS
    }


def _differences(egoists: Mapping[str, list[Row]]) -> list[Row]:
    """Set against flat, paired over training seeds, Holm over all rows."""
    found: list[Row] = []
    for name in ("collision", "arrival", "r_env"):
        seen, listed = ([row[name] for row in egoists[network]] for network in ("set", "flat"))
        found.append(paired_row({"metric": name}, seen, listed))
    return with_holm(found)


def _summary(
    config: Config,
    rows: Mapping[tuple[str, str], Row],
    egoists: Mapping[str, list[Row]],
    tables: Mapping[str, list[Row]],
) -> dict[str, Any]:
    """Egoists over their seeds, how many reach the target, and the trio that sees a set."""
    found: dict[str, Any] = {"egoists": {}, "target": TARGET}
    for network, mine in egoists.items():
        group: dict[str, Any] = {"seeds": len(mine), "reach_target": sum(map(reaches, mine))}
        found["egoists"][network] = group | {name: spread(mine, name) for name in SHARES}
    found["trio"] = {name: rows[job, "greedy"] for name, job in members(config).items()}
    found["differences"] = {row["metric"]: row for row in tables.get("differences", [])}
    found["settings"] = {
        "flat": dataclasses.asdict(flat_expert("egoistic", 0, config.flat_steps).config),
        "set": dataclasses.asdict(set_expert("egoistic", 0, config.set_steps).config),
    }
    return found
