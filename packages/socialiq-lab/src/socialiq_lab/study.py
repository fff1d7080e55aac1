"""A study: what to run, which tables and pictures follow from it, and which tables to print.

A study is a module of `studies` that ends with `STUDY`. Jobs fill folders and can be resumed
(`socialiq_lab.jobs`); tables follow from these folders alone, pictures and printed tables from the
tables alone. A short study has no jobs: its tables are computed in one go.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from socialiq import UserError
from socialiq import results_folder as store
from socialiq.learners.callbacks import Clock
from socialiq.results_folder import Results
from socialiq.storage import shipped
from socialiq.types import Row
from socialiq_lab.engine import Engine, run_jobs, work_folder
from socialiq_lab.jobs import ROWS, Job, StageCallback

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Item = TypeVar("Item")


def silent(_stage: str) -> None:
    """A `StageCallback` that shows no progress."""


class Context(NamedTuple):
    """Second argument of a study's `tables` function, after its configuration."""

    jobs: Sequence[Job]  # all of them, finished
    work: Path  # has a folder for each of them
    on_stage: StageCallback  # shows the progress of a study without jobs

    def tables(self) -> dict[str, list[Row]]:
        """Return the rows that the jobs have kept (`jobs.keeps_rows`), in their order, by table."""
        tables: dict[str, list[Row]] = {}
        for job in self.jobs:
            for name, rows in json.loads((self.work / job.name / ROWS).read_text()).items():
                tables.setdefault(name, []).extend(rows)
        return tables


class Findings(NamedTuple):
    """Tables of a study before they are rounded and saved."""

    tables: dict[str, list[Row]]  # empty ones are left out of the results
    summary: dict[str, Any]  # values that the claims ledger refers to
    files: Mapping[str, bytes] = {}  # content by path below the results folder


class View(NamedTuple):
    """A table to print, with its title."""

    rows: Sequence[Row]
    title: str = ""


@dataclass(frozen=True)
class Study:
    """A reproducible experiment.

    Attributes:
        name: Name on the command line and of the results folder.
        Config: Frozen dataclass; its fields are the study's command-line options, its defaults
            those of the committed results.
        tables: Computes tables and summary, given a configuration and the finished jobs.
        figures: Draws pictures from results, by name.
        view: Selects the tables to print.
        jobs: Lists the jobs for a configuration, each after its inputs; empty for a short study.
        more_jobs: Lists the jobs that depend on what the first ones found, given the work folder.
    """

    name: str
    Config: type[Any]
    tables: Callable[[Any, Context], Findings]
    figures: Callable[[Results], dict[str, Figure]]
    view: Callable[[Results], Sequence[View]]
    jobs: Callable[[Any], Sequence[Job]] | None = None
    more_jobs: Callable[[Any, Path], Sequence[Job]] | None = None


def run(
    study: Study,
    config: Any = None,
    on_stage: StageCallback = silent,
    work: Path | None = None,
    engine: Engine | None = None,
) -> Results:
    """Run the jobs that are not finished yet, and compute the tables, rounded as they are saved.

    Args:
        study: The study.
        config: Its configuration; None for that of the committed results.
        on_stage: Shows the progress of each stage.
        work: Folder of the jobs; None for a temporary one.
        engine: Processes or cluster of the jobs; None for every core of this machine.

    Raises:
        UserError: If a job fails or the work folder can't be written.
        Stopped: On Ctrl-C; the same call resumes.
    """
    config = study.Config() if config is None else config
    place = engine or Engine()
    with work_folder(work) as folder:
        jobs = list(study.jobs(config)) if study.jobs else []
        if jobs:
            run_jobs(jobs, folder, on_stage, place.processes, place.cluster)
        if study.more_jobs:
            jobs += [job for job in study.more_jobs(config, folder) if job not in jobs]
            run_jobs(jobs, folder, on_stage, place.processes, place.cluster)
        findings = study.tables(config, Context(jobs, folder, on_stage))
    return Results.of(study.name, config, findings.tables, findings.summary, findings.files)


def save(study: Study, results: Results, folder: Path, replace: bool) -> None:
    """Write results and figures to a folder, whole or not at all.

    Args:
        study: The study.
        results: Its results.
        folder: Folder to write.
        replace: Whether results in the folder may be replaced.

    Raises:
        UserError: If the folder exists and may not be replaced, or can't be written.
    """
    from socialiq.plotting.style import png

    store.save(results, folder, png(study.figures(results)), replace)


def load(study: Study, folder: Path) -> Results:
    """Read a study's results from a folder, or from its subfolder of the study's name.

    Args:
        study: The study.
        folder: Folder of the results, or the folder above it.

    Raises:
        UserError: If there are none, or those of another study.
    """
    inside = shipped(folder / study.name)
    results = store.load(inside if inside.is_dir() else shipped(folder))
    if results.study != study.name:
        raise UserError(f"{folder} holds {results.study}: name that study, or another folder")
    return results


def tracked(
    items: Sequence[Item], on_stage: StageCallback, stage: str, unit: str
) -> Iterator[Item]:
    """Yield the items of a stage, and show the number of those that are done.

    Args:
        items: The items.
        on_stage: Progress callback of the study.
        stage: Name of the stage.
        unit: Name of the items in the display.
    """
    report = on_stage(stage)
    clock = Clock(0, len(items), 1)
    for done, item in enumerate(items, start=1):
        yield item
        if report is not None:
            report(clock.report(done, {}, {}, ())._replace(unit=unit))
