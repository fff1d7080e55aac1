"""Processes that do jobs, one pinned to each core.

A core's matrix products are as fast with one process as they get; two processes that share two
cores' threads are slower than two that have a core each.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.experiments.jobs import Job, Progress, claimed, do, fingerprints, open_jobs
from socialiq.learners.callbacks import Report, Stopped
from socialiq.worlds.intersection.reference.conformance import PORTABLE

_PATIENCE = 60.0  # s for a run to save its state after Ctrl-C


@contextmanager
def work_folder(given: Path | None) -> Iterator[Path]:
    """The folder that a study keeps its jobs in: the given one, or one that goes with the study."""
    if given is not None:
        yield given
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def run_jobs(
    jobs: Sequence[Job],
    work: Path,
    on_stage: Callable[[str], Callable[[Report], None] | None],
    processes: int = 0,
) -> None:
    """Do what is not done yet, each job after its inputs.

    Args:
        jobs: Each stands after its inputs.
        work: Folder of their folders.
        on_stage: Given the name of a stage, what shows its progress.
        processes: How many; by default one for each core that this process may use.

    Raises:
        UserError: If a job fails, a process dies, or the folder is in use.
        Stopped: On Ctrl-C.
    """
    with claimed(work):
        still_open = open_jobs(jobs, work)
        cores = sorted(os.sched_getaffinity(0))
        count = min(processes or len(cores), len(still_open))
        crew: list[_Worker] = []
        try:
            around = _surroundings(work)
            crew += (_Worker(cores[number % len(cores)], around) for number in range(count))
            _Shift(jobs, still_open, work, on_stage, crew).finish()
        except KeyboardInterrupt:
            for worker in crew:
                worker.stop()
            raise Stopped(
                "stopped: what is finished is kept; give the same command to go on"
            ) from None
        finally:
            for worker in crew:
                worker.dismiss()


class _Shift:
    """One call's jobs and processes."""

    def __init__(
        self,
        jobs: Sequence[Job],
        still_open: Sequence[Job],
        work: Path,
        on_stage: Callable[[str], Callable[[Report], None] | None],
        crew: Sequence[_Worker],
    ) -> None:
        self.known, self.work, self.crew = fingerprints(jobs), work, crew
        self.progress = Progress(jobs, still_open, on_stage)
        self.waiting = list(still_open)
        self.unfinished = {job.name for job in still_open}

    def finish(self) -> None:
        """Hand out jobs and listen until none is left."""
        self._hand_out()
        while self.unfinished:
            for message in self._heard():
                self._take(message)
            self._hand_out()

    def _hand_out(self) -> None:
        for worker in self.crew:
            if worker.job is None:
                ready = [job for job in self.waiting if not self.unfinished & {*job.inputs}]
                if ready:
                    self.waiting.remove(ready[0])
                    self.progress.begin(ready[0].name)
                    worker.begin(ready[0], self.work, self.known[ready[0].name])

    def _heard(self) -> list[tuple[_Worker, str, Any]]:
        busy = [worker for worker in self.crew if worker.job]
        ready = multiprocessing.connection.wait([worker.pipe for worker in busy])
        return [worker.hear() for worker in busy if worker.pipe in ready]

    def _take(self, message: tuple[_Worker, str, Any]) -> None:
        worker, kind, value = message
        assert worker.job is not None  # only busy workers are heard
        if kind == "failed":
            raise UserError(value)
        self.progress.update(worker.job.name, 1.0 if kind == "finished" else value)
        if kind == "finished":
            self.unfinished.discard(worker.job.name)
            worker.job = None


class _Worker:
    """A process of its own, pinned to one core."""

    def __init__(self, core: int, environment: Mapping[str, str]) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would copy JAX's threads
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other,), daemon=True)
        with _inherited(core, environment):
            self.process.start()
        other.close()
        self.job: Job | None = None

    def begin(self, job: Job, work: Path, fingerprint: str) -> None:
        """Hand out a job."""
        self.job = job
        with suppress(OSError):  # a process that is gone is noticed when it is heard
            self.pipe.send((job, work, fingerprint))

    def hear(self) -> tuple[_Worker, str, Any]:
        """What it says: this worker, the kind of message, its value."""
        try:
            return self, *self.pipe.recv()
        except (EOFError, OSError):
            name = self.job.name if self.job else ""
            line = f"the process that did {name} was killed; give the same command to go on"
            return self, "failed", line

    def stop(self) -> None:
        """End it, with its state saved if it is training."""
        if self.process.pid:
            os.kill(self.process.pid, signal.SIGINT)
        self.process.join(_PATIENCE)

    def dismiss(self) -> None:
        """End it at once."""
        self.process.terminate()
        self.process.join()
        self.pipe.close()


def _surroundings(work: Path) -> dict[str, str]:
    """Variables of processes that do such jobs: one arithmetic, and programs compiled once.

    A folder of compiled programs that the caller's environment names is used; else the jobs' own.
    """
    compiled = os.environ.get("JAX_COMPILATION_CACHE_DIR", str(work.absolute() / "compiled"))
    return PORTABLE | {
        "JAX_COMPILATION_CACHE_DIR": compiled,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.5",
    }


@contextmanager
def _inherited(core: int, environment: Mapping[str, str]) -> Iterator[None]:
    """Be for a moment as the process that is started meanwhile shall: on one core, deaf to Ctrl-C.

    A process has to begin on its core: libraries count the cores when they are loaded, and two
    threads that wait for one another on one core are several times as slow as one.
    """
    before, variables = os.sched_getaffinity(0), dict(os.environ)
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.sched_setaffinity(0, {core})
    os.environ.update(environment)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(variables)
        os.sched_setaffinity(0, before)
        signal.signal(signal.SIGINT, handler)


def _serve(pipe: Any) -> None:
    """Do jobs until the other side is gone, or asks for the end."""
    os.setpgid(0, 0)  # a Ctrl-C at the terminal is for the command, which passes it on once
    signal.signal(signal.SIGINT, _interrupted)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(Stopped, EOFError, BrokenPipeError):
        while True:
            job, work, fingerprint = pipe.recv()
            try:
                seconds = do(job, work, fingerprint, lambda share: pipe.send(("progress", share)))
                pipe.send(("finished", seconds))
            except Stopped:
                raise
            except UserError as error:
                pipe.send(("failed", f"{job.name}: {error}"))
            except Exception as error:
                traceback.print_exc()  # a mistake of ours, which one line would hide
                pipe.send(("failed", f"{job.name}: {type(error).__name__}: {error}"))


def _interrupted(_number: int, _frame: Any) -> None:
    """Leave what is in progress; training listens by itself and saves its state first."""
    raise Stopped("stopped")


def _end_with_parent() -> None:
    """A command that was killed leaves nobody behind who still writes."""
    parent = multiprocessing.parent_process()
    assert parent is not None  # this is a spawned process
    multiprocessing.connection.wait([parent.sentinel])
    os._exit(1)
