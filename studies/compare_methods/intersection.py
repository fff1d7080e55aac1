"""The comparison in the intersection: a job trains all runs of a method, others drive episodes.

All runs of a method share one program, or one for each of its static configs, which is what a GPU
is fast at. Episodes are driven by the compiled core, on as many processes as there are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.exact import Metrics
from socialiq.evaluation.road_training import source_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import config as presets
from socialiq.nn.q_policy import QPolicy
from socialiq.results_folder import as_csv, from_csv
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Policy, Row
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Batch
from socialiq_lab.comparison_runs import (
    Arena,
    Method,
    Setting,
    runs_of,
    setting_name,
)
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    MIXTURE,
    RECORDED_EPISODES,
    SIZE,
    atlas_demonstrations,
    mixture_of,
)
from socialiq_lab.intersection.driving import BATCH, EpisodesRun
from socialiq_lab.jobs import Job, ProgressCallback
from studies.compare_methods.methods import BY_NAME
from studies.compare_methods.training import LEARNERS

WORLD = "intersection"

NUMBERS = dataclasses.replace(presets.INTERSECTION_CALIBRATED_NUMBERS, learning_rate=1e-3)

FIRST_DEVELOPMENT = 50_000_000
"""Seed of the first episode on which settings are chosen."""

ROWS, SPEED = "rows.csv", "speed.csv"
"""Files of a job: a row for each policy and angle; updates per second."""

POLICIES = "policies.csv"
"""File of a training job: the file of the policy of each setting, seed and angle."""

DEMONSTRATORS = "references/intersection"
"""Job that drives the demonstrators."""


@dataclass(frozen=True, kw_only=True)
class IntersectionRuns:
    """Runs of a method at every angle, setting and seed."""

    method: str
    structure: iq.IQLearnConfig
    numbers: iq.IQLearnHyperparameters
    updates: int
    """Of each network."""
    angles: tuple[float, ...]
    settings: tuple[Setting, ...]
    seeds: tuple[int, ...]
    environments: int = 12
    options: Options = field(default_factory=Options)
    mixture: str = MIXTURE
    size: int = SIZE


@dataclass(frozen=True, kw_only=True)
class Driving(EpisodesRun):
    """Episodes of a method's policies of one setting and seed, at every angle."""

    method: str
    setting: Setting
    seed: int
    angles: tuple[float, ...]
    readouts: tuple[str, ...] = ("greedy",)


@dataclass(frozen=True, kw_only=True)
class DemonstratorsRun(EpisodesRun):
    """Episodes of the demonstrators, scored at every angle."""

    angles: tuple[float, ...]
    sha256: tuple[str, ...]
    """SHA-256 of the demonstrators."""


def structure(config: Any) -> iq.IQLearnConfig:
    """Return the static config of every method: a network that sees vehicles as a set."""
    return dataclasses.replace(
        presets.INTERSECTION_CALIBRATED,
        view="set",
        hidden=config.intersection_hidden,
        batch_size=config.intersection_batch,
        replay_capacity=100_000,
    )


def demonstrations() -> Job:
    """Return the job that records the demonstrations."""
    return atlas_demonstrations(RECORDED_EPISODES)


def demonstrators(config: Any) -> Job:
    """Return the job that drives the demonstrators on the episodes of the table."""
    sha256 = tuple(atlas.manifest()[f"expert_{mode}"]["sha256"] for mode in MODES)
    run = DemonstratorsRun(angles=config.angles, sha256=sha256, episodes=config.episodes)
    return Job(DEMONSTRATORS, drive_demonstrators, run, cost=5.0)


def jobs_of(
    config: Any,
    phase: str,
    method: Method,
    updates: int,
    angles: tuple[float, ...],
    settings: Sequence[Setting],
    seeds: Sequence[int],
    first_seed: int,
) -> Iterator[Job]:
    """Yield the job that trains a method, and one that drives for each setting and seed.

    Args:
        config: The comparison.
        phase: Name of the phase, part of the jobs' names.
        method: The method.
        updates: Gradient steps of each network.
        angles: Target angles in degrees.
        settings: Settings of the method's grid.
        seeds: Training seeds.
        first_seed: Seed of the first episode.
    """
    runs = IntersectionRuns(
        method=method.name,
        structure=structure(config),
        numbers=NUMBERS,
        updates=updates,
        angles=angles,
        settings=tuple(settings),
        seeds=tuple(seeds),
    )
    count = len(settings) * len(seeds)
    steps = updates * len(method.served(angles))
    training = trained(phase, method)
    yield Job(training, train_method, runs, (DEMONSTRATIONS,), 20.0 + count * steps / 300)
    for setting in settings:
        for seed in seeds:
            episodes = Driving(
                method=method.name,
                setting=setting,
                seed=seed,
                angles=angles,
                episodes=config.episodes,
                first_seed=first_seed,
            )
            name = _name(phase, method, setting, seed)
            yield Job(name, drive, episodes, (training,), 1.0 * len(angles))


def trained(phase: str, method: Method) -> str:
    """Return the folder of a method's training."""
    return f"training/{WORLD}/{phase}/{method.name}"


def _name(phase: str, method: Method, setting: Setting, seed: int) -> str:
    number = method.settings.index(setting)
    return f"methods/{WORLD}/{phase}/{method.name}/{number}/{seed}"


def train_method(
    config: IntersectionRuns,
    folder: Path,
    inputs: Mapping[str, Path],
    on_progress: ProgressCallback,
) -> None:
    """Train every run; write their policies, which file serves which angle, and the speed."""
    method, (recordings,) = BY_NAME[config.method], inputs.values()
    arena = _arena(config, recordings, on_progress)
    served = method.served(config.angles)
    runs = runs_of(config.settings, served, config.seeds)
    policies = LEARNERS[method.learner](arena, method, runs)
    rows: list[Row] = []
    for number, (run, policy) in enumerate(zip(runs, policies, strict=True)):
        files: dict[int, str] = {}
        turned = [policy.at(a) if hasattr(policy, "at") else policy for a in served[run.angle]]
        for angle, turned_policy in zip(served[run.angle], turned, strict=True):
            if id(turned_policy) not in files:  # one policy may serve several angles
                files[id(turned_policy)] = f"{number}_{len(files)}.safetensors"
                turned_policy.save(folder / files[id(turned_policy)])
            label = {"setting": setting_name(run.setting), "seed": run.seed}
            rows.append(label | {"target_angle": angle, "file": files[id(turned_policy)]})
    write_atomically(folder / POLICIES, as_csv(rows))
    write_atomically(folder / SPEED, as_csv([arena.speed_row(WORLD, method, len(runs))]))
    on_progress(1.0)


def _arena(config: IntersectionRuns, recordings: Path, on_progress: ProgressCallback) -> Arena:
    """Return the inputs of a method: a mixture for each seed, and intersections to act in."""
    steps = config.updates * config.structure.env_steps_per_update
    capacity = min(config.structure.replay_capacity, steps)
    return Arena(
        dataclasses.replace(config.structure, replay_capacity=capacity),
        config.numbers,
        config.updates,
        [mixture_of(recordings, config.mixture, config.size, seed) for seed in config.seeds],
        None,
        lambda steps: source_of(config.options, config.environments, -(-steps // Arena.chunk)),
        lambda report: on_progress(0.9 * report.done / report.total),
        advantage="advantage_fitted",
    )


def drive(
    config: Driving, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Drive each policy once, and write a row for each angle and action selection."""
    (trained,) = inputs.values()
    label_and_seed = (setting_name(config.setting), config.seed)
    driven: dict[tuple[str, str], Metrics] = {}
    rows: list[Row] = []
    for row in from_csv(trained / POLICIES):
        if (row["setting"], row["seed"]) != label_and_seed:
            continue
        for readout in config.readouts:
            key = str(row["file"]), readout
            if key not in driven:
                driven[key] = _driven(config, QPolicy.load(trained / key[0]), readout)
            label = {"world": WORLD, "method": config.method, "setting": label_and_seed[0]}
            label |= {
                "target_angle": row["target_angle"],
                "readout": readout,
                "seed": label_and_seed[1],
            }
            metrics = driven[key]
            value = {"value": metrics.value(row["target_angle"]), "regret": ""}
            rows.append(label | metrics._asdict() | value)
        on_progress(len(rows) / len(config.angles) / len(config.readouts))
    write_atomically(folder / ROWS, as_csv(rounded(rows)))


def _driven(config: EpisodesRun, policy: Policy, readout: str = "greedy") -> Metrics:
    batch = Batch(config.options, BATCH)
    return episodes_of(batch, policy, config.seeds, deterministic=readout == "greedy").metrics()


def drive_demonstrators(
    config: DemonstratorsRun,
    folder: Path,
    _inputs: Mapping[str, Path],
    on_progress: ProgressCallback,
) -> None:
    """Write J(α) of each demonstrator at every angle."""
    rows: list[Row] = [{"world": WORLD, "target_angle": angle} for angle in config.angles]
    for number, mode in enumerate(MODES, start=1):
        metrics = _driven(config, atlas.load(f"expert_{mode}"))
        for row in rows:
            row[mode] = metrics.value(row["target_angle"])
        on_progress(number / len(MODES))
    write_atomically(folder / ROWS, as_csv(rounded(rows)))


def rows_of(
    work: Path, phase: str, method: Method, settings: Sequence[Setting], seeds: Sequence[int]
) -> Iterator[Row]:
    """Yield the rows of a method's jobs."""
    for setting in settings:
        for seed in seeds:
            yield from from_csv(work / _name(phase, method, setting, seed) / ROWS)
