"""Plain networks of the intersection by direct policy iteration: the simulator in training alone.

Every run improves the atlas' expert at 0 or 45 degrees. The networks of several training seeds and
their ensemble drive the same episodes as the expert, alone and with one look at the true future.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from socialiq.errors import UserError
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.config import check_counts
from socialiq.learners.policy_iteration.config import Hyperparameters, StaticConfig
from socialiq.nn.ensemble import EnsemblePolicy, load_values
from socialiq.plotting.style import head
from socialiq.types import Row
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection.driving import (
    Evaluation,
    LookaheadRun,
    drive_with_lookahead,
    evaluate,
)
from socialiq_lab.intersection.episodes import LAST, EpisodesRun, save_episodes
from socialiq_lab.intersection.experts import atlas_files
from socialiq_lab.intersection.plots import Runs, dots
from socialiq_lab.intersection.policy_iteration import IterationRun, train_by_iteration
from socialiq_lab.intersection.rows import (
    SHARES,
    VIEW_OF_SHARES,
    curves,
    evaluated,
    policy_rows,
    times,
)
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, Study
from socialiq_lab.tables import spread

TRAINED = {mode: MODES[mode] for mode in ("egoistic", "prosocial")}
TARGETS = {
    "egoistic": {"arrival": 0.97, "collision": 0.025},
    "prosocial": {"arrival": 0.95, "collision": 0.01, "ego_struck": 0.003},
}
"""Aims, set before the study: at least so many arrivals, at most so much of the others."""
NUMBERS = Hyperparameters(learning_rate=4e-4, regression=0.0, exploration_fall=1e-6)
"""Settings of every run but angle and seed."""
STATES = 40
"""States of which an update compares all decisions by rollouts."""
FIRST_ROUNDS = 10
"""Updates' worth of states before the first update."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results.

    Settings of the training were chosen on training seeds from 100 and episodes from 50,000,000.
    """

    seeds: tuple[int, ...] = (80, 81, 82, 83, 84)
    """Training seeds."""
    modes: tuple[str, ...] = tuple(TRAINED)
    """Modes that are trained: egoistic (0 degrees) and prosocial (45 degrees)."""
    updates: int = 6_000
    """Gradient steps of a run."""
    episodes: int = 4000
    """Evaluation episodes of each policy, the same for all."""
    clock: bool = False
    """Whether the networks observe the time."""
    collision_weight: float = -2.0
    """Of the rollouts' r_env; evaluation has the scenario's, -2. A larger loss of a collision makes
    a policy that accepts more delay for the same risk."""

    def __post_init__(self) -> None:
        """Refuse empty sizes and unknown modes."""
        check_counts(self, ("updates", "episodes"))
        if not self.seeds or not self.modes or not set(self.modes) <= set(TRAINED):
            raise UserError(f"name at least one seed, and modes of {', '.join(TRAINED)}")


def run_of(config: Config, mode: str, seed: int) -> IterationRun:
    """Return the training of one network."""
    labels = Options(collision_weight=config.collision_weight)
    structure = StaticConfig(
        view="set",
        times=labels.decisions if config.clock else 0,
        hidden=(128, 128),
        batch_size=512,
        updates=config.updates,
        states_per_update=STATES,
        first_rounds=FIRST_ROUNDS,
        replay_capacity=400_000,
    )
    numbers = dataclasses.replace(NUMBERS, angle=TRAINED[mode], seed=seed)
    return IterationRun(structure, numbers, f"set_{mode}", labels=labels)


def network_name(mode: str, seed: int) -> str:
    """Return the folder of a network."""
    return f"networks/{mode}/{seed}"


@dataclass(frozen=True)
class Mean:
    """An ensemble; its members are the job's inputs."""


def join(
    _config: Mean, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the ensemble of the inputs' networks."""
    members = [load_values(trained / LAST) for trained in inputs.values()]
    EnsemblePolicy.of(members).save(folder / LAST)
    on_progress(1.0)


@dataclass(frozen=True)
class AtlasRun(EpisodesRun):
    """Episodes of a policy of the atlas."""

    driver: str
    readouts: tuple[str, ...] = ("greedy",)


def drive_atlas(
    config: AtlasRun, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode."""
    episodes = episodes_of(Batch(config.options, 256), atlas.load(config.driver), config.seeds)
    save_episodes(folder / "greedy.safetensors", episodes)
    on_progress(1.0)


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    return [job for mode in config.modes for job in _of_mode(config, mode)]


def _of_mode(config: Config, mode: str) -> Iterator[Job]:
    networks = [network_name(mode, seed) for seed in config.seeds]
    for name, seed in zip(networks, config.seeds, strict=True):
        yield Job(name, train_by_iteration, run_of(config, mode, seed), cost=150.0)
    yield Job(f"ensembles/{mode}", join, Mean(), tuple(networks), cost=1.0)
    plain = Evaluation(LAST, ("greedy",), episodes=config.episodes)
    for name in (*networks, f"ensembles/{mode}"):
        yield Job(f"evaluation/{name}", evaluate, plain, (name,), cost=5.0)
    ahead = LookaheadRun(TRAINED[mode], driver=LAST, episodes=config.episodes)
    for name in (networks[0], f"ensembles/{mode}"):
        yield Job(f"evaluation/foresight/{name}", drive_with_lookahead, ahead, (name,), cost=30.0)
    beside = AtlasRun(driver=f"set_{mode}", episodes=config.episodes)
    yield Job(f"evaluation/atlas/{mode}", drive_atlas, beside, cost=5.0)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    jobs, work = context.jobs, context.work
    rows = policy_rows(evaluated(jobs, work))
    tables = {
        "policies": list(rows.values()),
        "curves": curves(jobs, work, None),
        "times": times(jobs, work),
    }
    by_name = {name: row for (name, _), row in rows.items()}
    members = {f"iterated_{mode}": f"ensembles/{mode}" for mode in config.modes}
    files = atlas_files("intersection-policy-iteration", members, work, rows, LAST)
    return Findings(tables, _summary(config, by_name), files)


def _summary(config: Config, rows: Mapping[str, Row]) -> dict[str, Any]:
    """Summarize each mode: the seeds' spread, the ensemble, the true future, the atlas, the aim."""
    found: dict[str, Any] = {}
    for mode in config.modes:
        names = [network_name(mode, seed) for seed in config.seeds]
        found[mode] = {
            "networks": _spreads([rows[name] for name in names]),
            "first_with_foresight": rows[f"foresight/{names[0]}"],
            "ensemble": rows[f"ensembles/{mode}"],
            "ensemble_with_foresight": rows[f"foresight/ensembles/{mode}"],
            "atlas": rows[f"atlas/{mode}"],
            "target": TARGETS[mode],
            "seeds_that_reach_it": sum(reaches(mode, rows[name]) for name in names),
        }
    return found | {"settings": dataclasses.asdict(run_of(config, config.modes[0], 0))}


def reaches(mode: str, row: Row) -> bool:
    """Whether a policy reaches the aim of its mode."""
    at_most = {name: aim for name, aim in TARGETS[mode].items() if name != "arrival"}
    return row["arrival"] >= TARGETS[mode]["arrival"] and all(
        row[name] <= aim for name, aim in at_most.items()
    )


def _spreads(rows: Sequence[Row]) -> dict[str, Any]:
    return {name: spread(rows, name) for name in (*SHARES, "r_env", "r_social")}


def draw(results: Results) -> dict[str, Figure]:
    """Draw collisions and arrivals of each mode."""
    rows = {row["policy"]: row for row in results.tables["policies"]}
    return {mode: _dots(results, rows, mode) for mode in results.config["modes"]}


def _dots(results: Results, rows: Mapping[str, Row], mode: str) -> Figure:
    names = [network_name(mode, seed) for seed in results.config["seeds"]]
    runs: Runs = [(["expert of the atlas"], rows[f"atlas/{mode}"])]
    runs += [(["policy iteration", name], rows[name]) for name in names]
    runs += [(["ensemble"], rows[f"ensembles/{mode}"])]
    runs += [(["ensemble, one look at the future"], rows[f"foresight/ensembles/{mode}"])]
    drawn = dots(runs, 3.0, TARGETS[mode])
    about = f"{runs[0][1]['episodes']} episodes each; dashed: aim; dot: a seed, bar: mean"
    head(drawn, f"Intersection: plain networks at {TRAINED[mode]:g} degrees\n{about}")
    return drawn


STUDY = Study(
    name="intersection-policy-iteration",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=VIEW_OF_SHARES,
)
