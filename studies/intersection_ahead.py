"""Online planning beside the egoist's network in the intersection: which of the two is the limit?

Experts that read a set of vehicles drive with and without online planning
(`evaluation.online_planning`), over training seeds. The atlas' egoist also drives in other traffic
than it assumes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from socialiq.errors import UserError
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.online_planning import RolloutPolicy
from socialiq.learners.config import check_counts
from socialiq.nn.q_policy import QPolicy, ValuePolicy
from socialiq.plotting.style import head
from socialiq.types import Row
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection.episodes import BEST, EPISODES, EpisodesRun, save_episodes
from socialiq_lab.intersection.experts import evaluations, set_expert
from socialiq_lab.intersection.plots import Runs, dots
from socialiq_lab.intersection.rows import (
    SHARES,
    VIEW_OF_SHARES,
    curves,
    egoist_summary,
    evaluated,
    policy_rows,
    times,
)
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, Study
from socialiq_lab.tables import paired_differences

STAGES = {"plain": "experts", "ahead": "ahead", "foresight": "foresight"}
"""Stage of the network alone, with online planning, and with one look at the true future."""
LABELS = {
    "experts": "network alone",
    "ahead": "online planning",
    "foresight": "one look at the future",
}
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
        """Refuse empty sizes."""
        check_counts(self, ("set_steps", "draws", "decisions", "episodes"))
        if not self.seeds:
            raise UserError("name at least one seed")


@dataclass(frozen=True)
class AheadRun(EpisodesRun):
    """Episodes of one policy, with or without online planning."""

    angle: float
    draws: int
    decisions: int
    """0 leaves the network alone."""
    doubt: float
    driver: str = BEST
    """File in the input's folder, or without an input a name of the atlas."""
    readouts: tuple[str, ...] = ("greedy",)
    believed: Options = field(default_factory=Options)
    """Traffic that it assumes."""


def drive(
    config: AheadRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode."""
    folders = list(inputs.values())
    network = QPolicy.load(folders[0] / BEST) if folders else atlas.load(config.driver)
    policy: ValuePolicy | RolloutPolicy = network
    if config.decisions:
        policy = RolloutPolicy(
            network, config.believed, config.angle, config.draws, config.decisions, config.doubt
        )
    episodes = episodes_of(Batch(config.options, 128), policy, config.seeds)
    save_episodes(folder / "greedy.safetensors", episodes)
    on_progress(1.0)


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    experts = [set_expert("egoistic", seed, config.set_steps) for seed in config.seeds]
    planning = (
        Job(
            job.name.replace("experts/", "evaluation/ahead/"),
            drive,
            _run(config, job.config.numbers.angle, config.decisions),
            (job.name,),
            cost=60.0,
        )
        for job in experts
    )
    return [*_in_traffic(config), *experts, *evaluations(experts, config.episodes), *planning]


def _run(config: Config, angle: float, decisions: int, **changes: Any) -> AheadRun:
    return AheadRun(
        angle, config.draws, decisions, config.doubt, episodes=config.episodes, **changes
    )


def _in_traffic(config: Config) -> Iterator[Job]:
    """The atlas' trio in the traffic that it assumes, and its egoist in other traffic."""
    for traffic, options in TRAFFIC.items():
        for mode, angle in MODES.items():
            if traffic != "as_believed" and mode != "egoistic":
                continue
            for kind, decisions in (("plain", 0), ("ahead", config.decisions)):
                run = _run(config, angle, decisions, driver=f"set_{mode}", options=options)
                name = f"evaluation/atlas/{mode}/{traffic}/{kind}"
                yield Job(name, drive, run, cost=60.0 if decisions else 3.0)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    rows = {name: row for (name, _), row in policy_rows(evaluated(jobs, work)).items()}
    egoists = {
        kind: [rows[f"{stage}/set/egoistic/{seed}"] for seed in config.seeds]
        for kind, stage in STAGES.items()
    }
    compared = ("collision", "arrival", "r_env", "r_social")
    tables = {
        "policies": list(rows.values()),
        "differences": paired_differences(egoists["ahead"], egoists["plain"], *compared),
        "curves": curves(jobs, work),
        "times": times(jobs, work),
    }
    return Findings(tables, _summary(config, rows, egoists, tables["differences"]))


def _summary(
    config: Config,
    rows: Mapping[str, Row],
    egoists: Mapping[str, Sequence[Row]],
    differences: Sequence[Row],
) -> dict[str, Any]:
    """Summarize the egoists, the atlas' policies, the differences and the settings."""
    of_atlas = {name: row for name, row in rows.items() if name.startswith("atlas/")}
    return egoist_summary(egoists, (*SHARES, "r_env", "r_social")) | {
        "atlas": {name.removeprefix("atlas/"): row for name, row in of_atlas.items()},
        "differences": {row["metric"]: row for row in differences},
        "settings": dataclasses.asdict(set_expert("egoistic", 0, config.set_steps).config),
    }


def draw(results: Results) -> dict[str, Figure]:
    """Draw all figures of the study: the egoists, and the atlas' egoist in other traffic."""
    rows = {row["policy"]: row for row in results.tables["policies"]}
    egoists: Runs = [
        ([label, str(seed)], rows[f"{stage}/set/egoistic/{seed}"])
        for stage, label in LABELS.items()
        for seed in results.config["seeds"]
    ]
    elsewhere: Runs = [
        ([f"{traffic.replace('_', ' ')}: {label}"], rows[f"atlas/egoistic/{traffic}/{kind}"])
        for traffic in TRAFFIC
        for kind, label in (("plain", "network alone"), ("ahead", "online planning"))
    ]
    title = "Intersection: the egoist that sees a set"
    other = "Intersection: the atlas' egoist among other drivers"
    return {
        "egoists": _dots(results, egoists, title, "; dot: a seed, bar: mean"),
        "elsewhere": _dots(results, elsewhere, other),
    }


def _dots(results: Results, runs: Runs, title: str, note: str = "") -> Figure:
    drawn = dots(runs, 3.0, results.summary["target"])
    about = f"{runs[0][1]['episodes']} episodes each; dashed: what a good egoist should reach"
    head(drawn, f"{title}\n{about}{note}")
    return drawn


STUDY = Study(
    name="intersection-ahead",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=VIEW_OF_SHARES,
)
