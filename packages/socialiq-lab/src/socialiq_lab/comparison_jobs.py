"""Jobs of a comparison in gridworlds: train a method, evaluate every policy exactly, write rows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.learners.callbacks import Report
from socialiq.results_folder import from_csv
from socialiq.types import Row
from socialiq_lab.comparison import DEVELOPMENT, Method, Setting
from socialiq_lab.comparison_runs import Arena, Run, grid_arena, runs_of
from socialiq_lab.comparison_tables import rows_of
from socialiq_lab.jobs import Job, ProgressCallback, Work, write_rows

ROWS = "rows.csv"
SPEED = "speed.csv"
"""Files of a job: a row for each policy and angle, and updates per second."""

EPISODES_EACH = {"crossing5": 1, "crossing7": 60}
"""Episodes of each expert, as in the worlds' own studies; the 5x5 world is deterministic."""


@dataclass(frozen=True)
class GridRuns:
    """Configuration of a job: runs of a method in a gridworld, at target angles in degrees.

    `updates` counts those of each network; the rates apply where the settings of a method have
    none.
    """

    world: str
    method: str
    updates: int
    angles: tuple[float, ...]
    settings: tuple[Setting, ...]
    seeds: tuple[int, ...]
    learning_rate: float
    polyak: float
    chunk: int = 200

    @classmethod
    def of(
        cls,
        config: Any,
        phase: str,
        world: str,
        method: Method,
        settings: tuple[Setting, ...],
        updates: int,
        **options: Any,
    ) -> Any:
        """Return the runs of a method in one phase of a comparison.

        Args:
            config: Configuration of the comparison, which has the angles, the seeds and the rates.
            phase: `DEVELOPMENT` or `FRESH`.
            world: Name of the gridworld.
            method: The method.
            settings: Settings of the method.
            updates: Gradient steps of each network.
            **options: Further fields of the class.
        """
        develops = phase == DEVELOPMENT
        angles = config.development_angles if develops else config.angles
        seeds = config.development_seeds if develops else config.seeds
        rates = config.learning_rate, config.polyak
        return cls(world, method.name, updates, angles, settings, seeds, *rates, **options)

    def arena(self, ground: Ground, on_progress: Callable[[float], None]) -> Arena:
        """Return the inputs of a method, with an equal mixture of trajectories for each seed.

        Args:
            ground: The world, enumerated.
            on_progress: Called with the share of the job that is done; training takes 0.9 of it.
        """
        datasets = trajectory_datasets(ground.table, self.seeds, EPISODES_EACH[self.world])

        def on_report(report: Report) -> None:
            on_progress(0.9 * report.done / report.total)

        return grid_arena(ground.table, datasets, self, self.chunk, on_report)


def grid_job(
    name: str, work: Work, runs: GridRuns, method: Method, seconds: float = 1.0, *inputs: str
) -> Job:
    """Return the job that trains and evaluates a method.

    Args:
        name: Name of the job.
        work: Function of the job.
        runs: Configuration of the job.
        method: The method.
        seconds: Approximate seconds of a network.
        *inputs: Names of the jobs whose folders it reads.
    """
    count = len(runs.seeds) * len(runs.settings) * len(method.served(runs.angles))
    return Job(name, work, runs, inputs, seconds * count + 10.0)


def evaluated(
    config: GridRuns,
    method: Method,
    train: Callable[[Ground, Arena, Sequence[Run]], Sequence[Any]],
    columns: Callable[[Arena, Run], tuple[Row, Row]],
    folder: Path,
    on_progress: ProgressCallback,
) -> list[Row]:
    """Train every run, evaluate its policy exactly, and write the speed.

    Args:
        config: Runs of one method in a gridworld.
        method: The method.
        train: Trains a policy for each run.
        columns: Returns the columns of a run that stand before and after those of `rows_of`.
        folder: Folder of the job.
        on_progress: Callback of the finished share, 0 to 1.

    Returns:
        A row for each policy, angle and action selection.
    """
    ground = Ground.of(config.world)
    arena = config.arena(ground, on_progress)
    served = method.served(config.angles)
    runs = runs_of(config.settings, served, config.seeds)
    rows: list[Row] = []
    for run, policy in zip(runs, train(ground, arena, runs), strict=True):
        first, last = columns(arena, run)
        label = {"world": config.world, "method": method.name} | first
        of_run = rows_of(ground, method, label, run.seed, policy, served[run.angle])
        rows += [row | last for row in of_run]
    write_rows(folder / SPEED, [arena.speed_row(config.world, method, len(runs))])
    return rows


def job_rows(jobs: Sequence[Job], work: Path, phase: str, file: str = ROWS) -> list[Row]:
    """Return the rows that the jobs of a phase have written.

    Args:
        jobs: Jobs of any phase.
        work: Work folder.
        phase: `DEVELOPMENT` or `FRESH`: a part of the jobs' names.
        file: Name of the file in a job's folder. A job without it has no rows.

    Returns:
        The rows in the order of the jobs.
    """
    folders = [work / job.name for job in jobs if phase in job.name.split("/")]
    paths = [folder / file for folder in folders if (folder / file).is_file()]
    return [row for path in paths for row in from_csv(path)]
