"""Online planning beside the egoist's network: which of the two limits it?

The experts that see a set of vehicles, over training seeds, drive with and without online planning
(`evaluation/thinking_ahead.py`). Whether this hangs on the belief in the right traffic is seen with
the atlas' egoist among other drivers than it believes in.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.online_planning import RolloutPolicy
from socialiq.evaluation.play import episodes_of
from socialiq.experiments.intersection.episodes import save_episodes
from socialiq.experiments.intersection.experts import (
    SHARES,
    TARGET,
    evaluations,
    reaches,
    set_expert,
)
from socialiq.experiments.intersection.jobs import BEST, EPISODES
from socialiq.experiments.intersection.rows import curves, played, policy_row, times
from socialiq.experiments.jobs import Job, ProgressCallback
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import paired_row, spread, with_holm
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Row
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options

DRIVERS = ("plain", "ahead", "foresight")
"""The network alone, with online planning, and with one look at the true future."""

TRAFFIC = {
    "as_believed": Options(),
    "varied_drivers": Options(population="thesis"),
    "connected_lanes": Options(connected_lanes=True),
}
"""Traffic in which the atlas' egoist drives; it always assumes the first."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results.

    Draws, decisions and doubt were chosen with the atlas' egoist on episodes 50,000,000 to
    50,000,999 and 51,000,000 to 51,000,999.
    """

    seeds: tuple[int, ...] = (40, 41, 42, 43, 44)
    """Training seeds of the egoists."""
    set_steps: int = 2_400_000
    """Environment steps of an expert."""
    draws: int = 16
    """States drawn for each observation."""
    decisions: int = 3
    """Decisions played out in each."""
    doubt: float = 1.0
    """Standard errors by which an action must beat the network's own."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the intersection study's own."""

    def __post_init__(self) -> None:
        """Refuse what makes no run."""
        for name in ("set_steps", "draws", "decisions", "episodes"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not self.seeds:
            raise UserError("name at least one seed")


@dataclass(frozen=True)
class AheadRun:
    """Episodes of one policy, with or without online planning."""

    angle: float
    draws: int
    decisions: int
    """0 leaves the network alone."""
    doubt: float
    driver: str = BEST
    """File in the input's folder, or without an input a name of the atlas."""
    readouts: tuple[str, ...] = ("greedy",)
    episodes: int = 2000
    first_seed: int = 20_000_000
    options: Options = field(default_factory=Options)
    """Traffic in which it drives."""
    believed: Options = field(default_factory=Options)
    """Traffic that it assumes."""


def drive(
    config: AheadRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Drive; writes what became of every episode."""
    policy: QPolicy | RolloutPolicy = atlas.load(config.driver) if not inputs else _input(inputs)
    if config.decisions and isinstance(policy, QPolicy):
        policy = RolloutPolicy(
            policy, config.believed, config.angle, config.draws, config.decisions, config.doubt
        )
    seeds = np.arange(config.first_seed, config.first_seed + config.episodes)
    episodes = episodes_of(Batch(config.options, 128), policy, seeds)
    save_episodes(folder / "greedy.safetensors", episodes)
    on_progress(1.0)


def _input(inputs: Mapping[str, Path]) -> QPolicy:
    (trained,) = inputs.values()
    return QPolicy.load(trained / BEST)


def plan(config: Config) -> list[Job]:
    """Every job, each after its inputs."""
    experts = [set_expert("egoistic", seed, config.set_steps) for seed in config.seeds]
    return [
        *_elsewhere(config),
        *experts,
        *evaluations(experts, config.episodes),
        *_thinking(config, experts),
    ]


def _thinking(config: Config, experts: Sequence[Job]) -> Iterator[Job]:
    for job in experts:
        name = job.name.removeprefix("experts/")
        run = AheadRun(
            job.config.numbers.angle, config.draws, config.decisions, config.doubt,
            episodes=config.episodes,
        )  # fmt: skip
        yield Job(f"evaluation/ahead/{name}", drive, run, (job.name,), cost=60.0)


def _elsewhere(config: Config) -> Iterator[Job]:
    """The atlas' trio in the traffic it believes in, and its egoist in other traffic."""
    for traffic, options in TRAFFIC.items():
        for mode, angle in MODES.items():
            if traffic != "as_believed" and mode != "egoistic":
                continue
            for kind, decisions in (("plain", 0), ("ahead", config.decisions)):
                run = AheadRun(
                    angle, config.draws, decisions, config.doubt, f"set_{mode}",
                    episodes=config.episodes, options=options,
                )  # fmt: skip
                name = f"evaluation/atlas/{mode}/{traffic}/{kind}"
                yield Job(name, drive, run, cost=60.0 if decisions else 3.0)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    rows = {one.name: policy_row(one) for one in played(jobs, work)}
    egoists = {kind: _egoists(config, rows, kind) for kind in DRIVERS}
    tables = {
        "policies": list(rows.values()),
        "differences": _differences(egoists) if len(config.seeds) > 1 else [],
        "curves": curves(jobs, work),
        "times": times(jobs, work),
    }
    return Findings(tables, _summary(config, rows, egoists, tables))


def _egoists(config: Config, rows: Mapping[str, Row], kind: str) -> list[Row]:
    stage = "experts" if kind == "plain" else kind
    return [rows[f"{stage}/set/egoistic/{seed}"] for seed in config.seeds]


def _differences(egoists: Mapping[str, list[Row]]) -> list[Row]:
    """Online planning against none, paired over training seeds, Holm over all rows."""
    found: list[Row] = []
    for name in ("collision", "arrival", "r_env", "r_social"):
        ahead, plain = ([row[name] for row in egoists[kind]] for kind in ("ahead", "plain"))
        found.append(paired_row({"metric": name}, ahead, plain))
    return with_holm(found)


def _summary(
    config: Config,
    rows: Mapping[str, Row],
    egoists: Mapping[str, list[Row]],
    tables: Mapping[str, list[Row]],
) -> dict[str, Any]:
    """Egoists over their seeds, how many reach the target, and the atlas' policies."""
    found: dict[str, Any] = {"egoists": {}, "target": TARGET, "atlas": {}}
    for kind, mine in egoists.items():
        group: dict[str, Any] = {"seeds": len(mine), "reach_target": sum(map(reaches, mine))}
        names = (*SHARES, "r_env", "r_social")
        found["egoists"][kind] = group | {name: spread(mine, name) for name in names}
    found["atlas"] = {
        name.removeprefix("atlas/"): row for name, row in rows.items() if name.startswith("atlas/")
    }
    found["differences"] = {row["metric"]: row for row in tables.get("differences", [])}
    found["settings"] = dataclasses.asdict(set_expert("egoistic", 0, config.set_steps).config)
    return found
