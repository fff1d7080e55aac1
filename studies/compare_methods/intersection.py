"""The comparison in the intersection: a job trains all runs of a method, others drive episodes.

All runs of a method share one program, or one for each of its static configs, which is what a GPU
is fast at. Episodes are driven by the compiled core, on as many processes as there are.
"""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from socialiq import QPolicy
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.exact import Metrics
from socialiq.evaluation.rollout import MODES
from socialiq.results_folder import from_csv
from socialiq.types import Policy, Row
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab import comparison, comparison_runs
from socialiq_lab.comparison_jobs import ROWS, SPEED, GridRuns
from socialiq_lab.intersection import driving
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, write_rows
from socialiq_lab.registry import declaration
from studies.compare_methods.learners import LEARNERS

WORLD = "intersection"
METHODS = comparison.declared_methods(declaration("compare-methods"))
"""The comparison's rows by name."""

FIRST_DEVELOPMENT = 50_000_000
FIRST_FRESH = 70_000_000
"""Seeds of the first episodes on which settings are chosen, and of those of the table."""

POLICIES = "policies.csv"
"""File of a training job: the file of the policy of each run and angle."""

DEMONSTRATORS = "references/intersection"  # job that drives the demonstrators


@dataclasses.dataclass(frozen=True)
class IntersectionRuns(GridRuns):
    """Runs with networks of `hidden` layers, at the rates of the world instead of those given."""

    hidden: tuple[int, ...] = (64, 64)
    batch_size: int = 64


@dataclasses.dataclass(frozen=True, kw_only=True)
class Driving(driving.EpisodesRun):
    """Episodes of a method's greedy policies of one setting and seed, at every angle."""

    method: str
    setting: comparison.Setting
    seed: int
    angles: tuple[float, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class DemonstratorsRun(driving.EpisodesRun):
    """Episodes of the demonstrators of these SHA-256, scored at every angle."""

    angles: tuple[float, ...]
    sha256: tuple[str, ...]


def shared_jobs(config: Any, phase: str) -> Iterator[Job]:
    """Yield the job that records the demonstrations, and the one that drives the demonstrators.

    Args:
        config: Configuration of the study.
        phase: `DEVELOPMENT` or `FRESH`; demonstrators drive in the latter alone.
    """
    yield driving.atlas_demonstrations(driving.RECORDED_EPISODES)
    if phase == comparison.FRESH:
        sha256 = tuple(atlas.manifest()[f"expert_{mode}"]["sha256"] for mode in MODES)
        episodes = {"episodes": config.episodes * len(config.seeds), "first_seed": FIRST_FRESH}
        run = DemonstratorsRun(angles=config.angles, sha256=sha256, **episodes)
        yield Job(DEMONSTRATORS, drive_demonstrators, run, cost=5.0)


def jobs_of(
    config: Any, phase: str, method: Any, updates: int, settings: tuple[comparison.Setting, ...]
) -> Iterator[Job]:
    """Yield the job that trains a method, and one that drives for each setting and seed.

    Args:
        config: Configuration of the study.
        phase: `DEVELOPMENT` or `FRESH`.
        method: Method of the comparison.
        updates: Gradient steps of each network.
        settings: Settings at which the method is trained.
    """
    shape = {"hidden": config.intersection_hidden, "batch_size": config.intersection_batch}
    runs = IntersectionRuns.of(config, phase, WORLD, method, settings, updates, **shape)
    steps = updates * len(method.served(runs.angles)) * len(settings) * len(runs.seeds)
    training = f"training/{WORLD}/{phase}/{method.name}"
    yield Job(training, train_method, runs, (driving.DEMONSTRATIONS,), 20.0 + steps / 300)
    first = FIRST_DEVELOPMENT if phase == comparison.DEVELOPMENT else FIRST_FRESH
    for setting, seed in [(setting, seed) for setting in settings for seed in runs.seeds]:
        episodes = Driving(
            method=method.name,
            setting=setting,
            seed=seed,
            angles=runs.angles,
            episodes=config.episodes,
            first_seed=first + config.episodes * runs.seeds.index(seed),
        )
        number = method.settings.index(setting)
        name = f"methods/{WORLD}/{phase}/{method.name}/{number}/{seed}"
        yield Job(name, drive, episodes, (training,), 1.0 * len(runs.angles))


def train_method(
    config: IntersectionRuns,
    folder: Path,
    inputs: Inputs,
    on_progress: ProgressCallback,
) -> None:
    """Train every run; write their policies, which file serves which angle, and the speed.

    Args:
        config: Runs of one method.
        folder: Folder of the job, to which the files are written.
        inputs: Folder of the recorded demonstrations.
        on_progress: Callback of the finished share, 0 to 1.
    """
    method = METHODS[config.method]
    (recordings,) = inputs.values()
    arena = comparison_runs.intersection_arena(
        [driving.mixture_of(recordings, driving.SIZE, seed) for seed in config.seeds],
        config.updates,
        lambda report: on_progress(0.9 * report.done / report.total),
        config.hidden,
        config.batch_size,
    )
    served = method.served(config.angles)
    runs = comparison_runs.runs_of(config.settings, served, config.seeds)
    policies = comparison_runs.trained(LEARNERS[method.learner], arena, method, runs)
    rows: list[Row] = []
    for number, (run, policy) in enumerate(zip(runs, policies, strict=True)):
        files: dict[int, str] = {}
        turned = [comparison_runs.turned(policy, angle) for angle in served[run.angle]]
        for angle, at_angle in zip(served[run.angle], turned, strict=True):
            if id(at_angle) not in files:  # one policy may serve several angles
                files[id(at_angle)] = f"{number}_{len(files)}.safetensors"
                at_angle.save(folder / files[id(at_angle)])
            label = {"setting": comparison.setting_name(run.setting), "seed": run.seed}
            rows.append(label | {"target_angle": angle, "file": files[id(at_angle)]})
    write_rows(folder / POLICIES, rows)
    write_rows(folder / SPEED, [arena.speed_row(WORLD, method, len(runs))])
    on_progress(1.0)


def drive(config: Driving, folder: Path, inputs: Inputs, on_progress: ProgressCallback) -> None:
    """Drive each policy once, and write a row for each angle.

    Args:
        config: Method, setting and seed of the policies, and their episodes.
        folder: Folder of the job, to which the rows are written.
        inputs: Folder of the job that trained the method.
        on_progress: Callback of the finished share, 0 to 1.
    """
    (training,) = inputs.values()
    label = {
        "world": WORLD,
        "method": config.method,
        "setting": comparison.setting_name(config.setting),
    }
    driven: dict[str, Metrics] = {}
    rows: list[Row] = []
    for row in from_csv(training / POLICIES):
        if (row["setting"], row["seed"]) != (label["setting"], config.seed):
            continue
        file = str(row["file"])
        angle = row["target_angle"]
        if file not in driven:
            driven[file] = _driven(config, QPolicy.load(training / file))
        labels = {"target_angle": angle, "readout": "greedy", "seed": config.seed}
        value = {"value": driven[file].value(angle), "regret": ""}
        rows.append(label | labels | driven[file]._asdict() | value)
        on_progress(len(rows) / len(config.angles))
    write_rows(folder / ROWS, rows)


def _driven(config: driving.EpisodesRun, policy: Policy) -> Metrics:
    return episodes_of(
        Intersection(config.options).batch(driving.BATCH), policy, config.seeds
    ).metrics()


def drive_demonstrators(
    config: DemonstratorsRun,
    folder: Path,
    _inputs: Inputs,
    on_progress: ProgressCallback,
) -> None:
    """Write J(α) of each demonstrator at every angle.

    Args:
        config: Episodes, and angles in degrees.
        folder: Folder of the job, to which the rows are written.
        on_progress: Callback of the finished share, 0 to 1.
    """
    rows: list[Row] = [{"world": WORLD, "target_angle": angle} for angle in config.angles]
    for number, mode in enumerate(MODES, start=1):
        metrics = _driven(config, atlas.load(f"expert_{mode}"))
        for row in rows:
            row[mode] = metrics.value(row["target_angle"])
        on_progress(number / len(MODES))
    write_rows(folder / ROWS, rows)
