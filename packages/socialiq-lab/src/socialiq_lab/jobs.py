"""Long studies as jobs in a work folder, resumable after each job.

A job is a function that fills a folder. Its fingerprint covers its configuration, the jobs that it
reads and the version of this package. A finished folder of the same fingerprint is reused, any
other is made again. An interrupted job finds the files that it had written and may resume from
them.
"""

import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import filelock

from socialiq import UserError
from socialiq.evaluation.parts import ONE_THREAD
from socialiq.learners.callbacks import PARTS, Callbacks, Report, Stopped, stop_requests
from socialiq.results_folder import as_csv
from socialiq.storage import read_json, remove_cut_off_writes, write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.highway import PORTABLE

RECORD = "job.json"
_BEGUN = "begun.json"

RETRIES = 3
"""Number of times that a call repeats a job whose process was killed."""

ProgressCallback = Callable[[float], None]
"""Called by a job with its finished share."""

Inputs = Mapping[str, Path]
"""Folder of each input of a job, by the input's name."""

StageCallback = Callable[[str], Callable[[Report], None] | None]
"""Given the name of a stage, return the callback that shows its progress, if any."""

Work = Callable[[Any, Path, Inputs, ProgressCallback], None]
"""Fills a folder: given the job's configuration, its folder, and the folders of its inputs."""


ROWS = "rows.json"
"""File of the rows that a job keeps (`keeps_rows`), as exact as they were computed."""


def keeps_rows(function: Callable[[Any, Path, StageCallback], Mapping[str, Sequence[Row]]]) -> Work:
    """Make the work of a job whose function returns rows of tables, which are kept.

    Args:
        function: Given the job's configuration, its folder and a progress callback, it returns
            rows by the name of their table. It is a function of a module.
    """

    @functools.wraps(function)
    def work(config: Any, folder: Path, _inputs: Inputs, on_progress: ProgressCallback) -> None:
        def on_stage(_stage: str) -> Callable[[Report], None]:
            return lambda report: on_progress(report.done / report.total)

        tables = function(config, folder, on_stage)
        write_atomically(folder / ROWS, json.dumps(tables, default=lambda number: number.item()))

    return work


@dataclass(frozen=True)
class Part:
    """Configuration of a job that computes a part of a study."""

    study: Any  # configuration of the study
    of: Any = ""  # which part


def callbacks_of(
    progress: ProgressCallback,
    checkpoint: Path | None = None,
    monitor: Any = None,
    done: float = 0.0,
    share: float = 1.0,
    keep: bool = False,
) -> Callbacks:
    """Return the callbacks of a training that is a part of a job.

    Args:
        progress: Callback of the job.
        checkpoint: File of the resumable state; the training resumes from it if it exists.
        monitor: Measures of the training after each chunk.
        done: Share of the job that is finished when the training begins.
        share: Share of the job that the training takes.
        keep: Whether the file has the trained state too.
    """

    def on_report(report: Report) -> None:
        progress(done + share * report.done / report.total)

    resume = checkpoint is not None and checkpoint.is_file()
    return Callbacks(on_report, monitor, checkpoint, resume, keep)


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write rows of equal columns as CSV, rounded as those of results are.

    Args:
        path: File to write.
        rows: The rows, at least one.

    Raises:
        UserError: If the file can't be written.
    """
    write_atomically(path, as_csv(rounded(rows)))


@dataclass(frozen=True)
class Job:
    """One step of a study."""

    name: str  # folder below the work folder; the part before the first "/" is its stage
    work: Work  # function of a module, so that another process can import it
    config: Any  # everything it depends on: a dataclass with fields that JSON can hold
    inputs: tuple[str, ...] = ()  # names of the jobs whose folders it reads
    cost: float = 1.0  # approximate seconds; only proportions matter, for the estimated time left

    @property
    def stage(self) -> str:
        """The stage it belongs to."""
        return self.name.split("/")[0]


def job_environment(work: Path) -> dict[str, str]:
    """Return the variables of the jobs' processes: equal arithmetic, and a cache of programs.

    The cache is the folder that the caller's environment names, else a folder of the jobs. Several
    processes may share a GPU, so none takes its memory in advance.
    """
    compiled = os.environ.get("JAX_COMPILATION_CACHE_DIR", str(work / "compiled"))
    return {
        **ONE_THREAD,
        **PORTABLE,
        "JAX_COMPILATION_CACHE_DIR": compiled,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.5",
        "XLA_PYTHON_CLIENT_PREALLOCATE": os.environ.get("XLA_PYTHON_CLIENT_PREALLOCATE", "false"),
    }


def fingerprints(jobs: Sequence[Job]) -> dict[str, str]:
    """Return the SHA-256 of everything that each job depends on, its inputs' fingerprints too.

    Raises:
        UserError: If two jobs share a name.
    """
    hashes: dict[str, str] = {}
    version = importlib.metadata.version("socialiq")
    for job in jobs:  # a job stands after its inputs
        if job.name in hashes:
            raise UserError(f"two jobs are called {job.name}")
        content = [
            version,
            getattr(job.work, "func", job.work).__qualname__,  # of a partial function too
            dataclasses.asdict(job.config),
            [hashes[name] for name in job.inputs],
        ]
        hashes[job.name] = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return hashes


def is_done(folder: Path, fingerprint: str) -> bool:
    """Whether a folder holds the finished job of this fingerprint.

    Args:
        folder: Folder of the job.
        fingerprint: Result of `fingerprints` for the job.
    """
    record = folder / RECORD
    return record.is_file() and read_json(record).get("fingerprint") == fingerprint


def do(
    job: Job, work: Path, fingerprint: str, on_progress: ProgressCallback, call: str = ""
) -> float:
    """Run a job, unless it is finished.

    The job's folder appears whole, or its written files remain for the next try. Two processes
    never do the same job at a time; the second finds it finished.

    Args:
        job: The job.
        work: Work folder.
        fingerprint: Result of `fingerprints` for the job.
        on_progress: Callback of the job.
        call: Name of the call of `run_jobs`, for which interrupted tries are counted; "" for no
            count.

    Returns:
        The seconds that it took; 0 if it was finished already.

    Raises:
        UserError: If the folder can't be written, or the job was interrupted too often.
    """
    with _locked(work / ".locks" / job.name, job.name):
        if is_done(work / job.name, fingerprint):
            return 0.0
        target = _begun(job, work, fingerprint, call)
        began = time.monotonic()
        job.work(job.config, target, {name: work / name for name in job.inputs}, on_progress)
        seconds = time.monotonic() - began
        record = {
            "fingerprint": fingerprint,
            "config": dataclasses.asdict(job.config),
            "inputs": list(job.inputs),
            "seconds": round(seconds, 1),
        }
        write_json(target / RECORD, record)
        (target / _BEGUN).unlink()
        folder = work / job.name
        if folder.exists():
            shutil.rmtree(folder)
        target.rename(folder)
    return seconds


def _begun(job: Job, work: Path, fingerprint: str, call: str) -> Path:
    """Return the folder in which a job is done, in which the number of its tries is noted."""
    target = work / f"{job.name}.part"
    mark = target / _BEGUN
    try:
        hashes = read_json(mark) if mark.is_file() else {}
        if target.exists() and hashes.get("fingerprint") != fingerprint:
            shutil.rmtree(target)
        target.mkdir(parents=True, exist_ok=True)
        remove_cut_off_writes(target)
    except OSError as error:
        raise UserError(f"cannot write {target}: {error.strerror}; choose another place") from error
    again = call != "" and (hashes.get("fingerprint"), hashes.get("call")) == (fingerprint, call)
    cut_off = hashes["tries"] if again else 0
    if cut_off > RETRIES:
        raise UserError(
            f"its process was killed {cut_off} times: see whether the memory suffices; "
            "what is finished is kept"
        )
    write_json(mark, {"fingerprint": fingerprint, "call": call, "tries": cut_off + 1})
    return target


def open_jobs(jobs: Sequence[Job], work: Path) -> list[Job]:
    """Return the jobs that are not finished.

    Args:
        jobs: Jobs, each after its inputs.
        work: Work folder.

    Returns:
        The open jobs in their order.

    Raises:
        UserError: If two jobs share a name.
    """
    hashes = fingerprints(jobs)
    return [job for job in jobs if not is_done(work / job.name, hashes[job.name])]


def check_work(work: Path) -> None:
    """Refuse a work folder with content that no run of jobs has left."""
    names = {path.name for path in work.iterdir()} if work.is_dir() else set()
    if names and not names & {".lock", ".locks", "compiled", "sweep.sh"}:
        raise UserError(f"{work} holds something else: name a new folder with --work")


@contextmanager
def claimed(work: Path) -> Iterator[None]:
    """Keep a second command out of a work folder; the lock of a killed command is released.

    Raises:
        UserError: If the folder is in use, or can't be made.
    """
    try:
        work.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(work / ".lock", blocking=False)
        lock.acquire()
    except filelock.Timeout as error:
        raise UserError(f"{work} is in use by another run: wait for it, or stop it") from error
    except (OSError, NotImplementedError) as error:
        raise UserError(f"cannot write {work}: {_cause(error)}; choose another place") from error
    try:
        yield
    finally:
        lock.release()


@contextmanager
def _locked(path: Path, name: str) -> Iterator[None]:
    """Wait until no other process does a job, in this command or in another."""
    lock = filelock.FileLock(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with stop_requests() as stop:
            while not lock.is_locked:
                if stop.is_set():
                    raise Stopped(f"stopped before {name}")
                with suppress(filelock.Timeout):
                    lock.acquire(timeout=0.5, poll_interval=0.05)
    except (OSError, NotImplementedError) as error:
        raise UserError(f"cannot write {path}: {_cause(error)}; choose another place") from error
    try:
        yield
    finally:
        lock.release()


def _cause(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


WHOLE = "whole run"
"""Stage whose reports are of all jobs of a call."""


class Progress:
    """Progress of a study's jobs, of which some are still open, as the reports of its stages."""

    def __init__(
        self,
        jobs: Sequence[Job],
        still_open: Sequence[Job],
        on_stage: StageCallback,
    ) -> None:
        self._watch = on_stage
        self._shown = dict[str, Any]()
        self._jobs = {job.name: job for job in jobs}
        waiting = {job.name for job in still_open}
        self._share = {job.name: float(job.name not in waiting) for job in jobs}
        self._began: dict[str, tuple[float, float]] = {}

    def begin(self, name: str) -> None:
        """Take note that a job begins."""
        for stage in (WHOLE, self._jobs[name].stage):
            if stage not in self._began:
                self._began[stage] = time.monotonic(), self._done(self._of(stage))
                self._shown[stage] = self._watch(stage)

    def update(self, name: str, share: float) -> None:
        """Take note of the finished share of a job that has begun; report its stage and the run.

        Args:
            name: Name of the job.
            share: Finished share of the job, from 0 to 1.
        """
        self._share[name] = share
        for stage, unit in ((self._jobs[name].stage, "jobs/min"), (WHOLE, PARTS)):
            if self._shown[stage]:
                self._shown[stage](self._report(stage, unit))

    def _report(self, stage: str, unit: str) -> Report:
        began, at = self._began[stage]
        jobs = self._of(stage)
        total = sum(job.cost for job in jobs)
        done = self._done(jobs)
        finished = sum(self._share[job.name] >= 1 for job in jobs)
        pace = (done - at) / max(time.monotonic() - began, 1e-9)
        left = (total - done) / pace if pace > 0 else float("inf")
        rate = pace * len(jobs) / total * 60
        return Report(finished, len(jobs), rate, left, {}, {}, (), unit)

    def _of(self, stage: str) -> list[Job]:
        return [job for job in self._jobs.values() if stage in (WHOLE, job.stage)]

    def _done(self, jobs: Sequence[Job]) -> float:
        """Costs of what is done."""
        return sum(job.cost * self._share[job.name] for job in jobs)
