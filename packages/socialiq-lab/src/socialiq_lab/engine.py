"""Run the jobs of a study on Dask: on every core of this machine, or on a cluster.

Finished folders are the only record of finished jobs (`socialiq_lab.jobs`). Dask chooses the
process of a job, and another one if that process dies.
"""

from __future__ import annotations

import itertools
import math
import queue
import tempfile
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socialiq import UserError
from socialiq.evaluation.parts import available_cores
from socialiq.learners.callbacks import Stopped
from socialiq.storage import write_atomically
from socialiq_lab.jobs import Job, Progress, StageCallback, claimed, fingerprints, open_jobs

if TYPE_CHECKING:  # importing it takes half a second, which `socialiq --help` need not wait for
    from distributed import Client, Future

_EPISODES_OF_A_PART = 1000
_PATIENCE = 60.0  # s for a run to save its state after Ctrl-C
_ALMOST = 0.99  # largest share of a job that has not ended
_RECOUNT = 1.0  # s between two counts of the processes, which may join or leave a cluster

_GONE = (
    "the scheduler is gone: what is finished is kept; start it again and give the same command to "
    "go on"
)
STOPPED = "stopped: what is finished is kept; give the same command to go on"


@dataclass(frozen=True)
class Engine:
    """Place where jobs run."""

    processes: int = 0
    """Processes on this machine, each with a core of its own; by default one for each core."""
    cluster: str | None = None
    """A Dask cluster instead: the address of its scheduler (tcp://HOST:PORT) or its scheduler file.
    Its workers must see the work folder under the same path."""

    def __post_init__(self) -> None:
        """Refuse invalid numbers and combinations."""
        if self.processes < 0:
            raise UserError(f"processes must be at least 1, got {self.processes}")
        if self.processes and self.cluster is not None:
            raise UserError("--processes is of this machine: leave it out, or leave out --cluster")

    def parts(self, episodes: int) -> int:
        """Return in how many jobs episodes are played: one for each process.

        On a cluster, whose number of processes may change, one for each 1,000 episodes.
        """
        if self.cluster is not None:
            return math.ceil(episodes / _EPISODES_OF_A_PART)
        return min(self.processes or available_cores(), episodes)


@contextmanager
def work_folder(path: Path | None) -> Iterator[Path]:
    """Yield the folder that a study keeps its jobs in: the given one, or a temporary one."""
    if path is not None:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def run_jobs(
    jobs: Sequence[Job],
    work: Path,
    on_stage: StageCallback,
    processes: int = 0,
    cluster: str | None = None,
) -> None:
    """Run the jobs that are not finished, each after its inputs, in folders of the work folder.

    `on_stage` returns the callback for the progress of a stage. The jobs run in processes of a
    local cluster, by default one for each core that this process may use, or on `cluster`, the
    address of a running Dask scheduler or its scheduler file.

    Raises:
        UserError: If a job fails, its process dies again and again, the folder is in use, or the
            cluster can't be reached or used.
        Stopped: On Ctrl-C.
    """
    work = work.absolute()
    with claimed(work):
        still_open = open_jobs(jobs, work)
        if not still_open:
            return
        from socialiq_lab.cluster import client_of

        count = min(processes or available_cores(), len(still_open))
        try:
            with client_of(cluster, count, work) as client:
                _Call(client, jobs, still_open, work, on_stage).run()
        except KeyboardInterrupt:
            raise Stopped(STOPPED) from None


class _Call:
    """Open jobs of a call, as tasks of a cluster."""

    def __init__(
        self,
        client: Client,
        jobs: Sequence[Job],
        still_open: Sequence[Job],
        work: Path,
        on_stage: StageCallback,
    ) -> None:
        self.client = client
        self.work = work
        self.name = uuid.uuid4().hex
        self.known = fingerprints(jobs)
        self.open = {job.name: job for job in still_open}
        self.progress = Progress(jobs, still_open, on_stage)
        self.begun: set[str] = set()
        self.futures: dict[str, Future] = {}
        self.messages: queue.SimpleQueue[tuple[str, float | None]] = queue.SimpleQueue()

    def run(self) -> None:
        """Send the jobs and wait until all are finished.

        Raises:
            UserError: If a job fails; all other jobs are stopped first.
        """
        from socialiq_lab import cluster

        try:
            write_atomically(self.work / ".call", self.name)
            described = cluster.describe() | cluster.PORTABLE
            try:
                self.client.run(cluster.check, described, self.work, self.name)
            except ImportError as error:
                line = f"a worker of the cluster can't import socialiq: {error}"
                raise UserError(line) from None
            self.client.subscribe_topic(
                cluster.topic(self.name), lambda event: self.messages.put(tuple(event[1]))
            )
            while self.open:
                self._send(described)
                self._wait()
        except (KeyboardInterrupt, UserError):
            self._stop()
            raise
        finally:
            (self.work / ".call").unlink(missing_ok=True)

    def _send(self, described: dict[str, str]) -> None:
        """Send the next jobs whose inputs are finished, one for each thread without a job.

        Dask would queue a job at the process that has its inputs, while another process has none.
        """
        from socialiq_lab import cluster

        try:
            threads: Any = self.client.nthreads()
        except OSError:
            raise UserError(_GONE) from None
        free = sum(threads.values()) - len(self.futures)
        waiting = (job for name, job in self.open.items() if name not in self.futures)
        ready = (job for job in waiting if not any(name in self.open for name in job.inputs))
        for job in itertools.islice(ready, max(free, 0)):
            task = cluster.Task(job, self.work, self.known[job.name], self.name, described)
            key = f"{job.name}-{self.name}"
            future = self.client.submit(cluster.perform, task, key=key, pure=False)
            self.futures[job.name] = future
            future.add_done_callback(lambda _, name=job.name: self.messages.put((name, None)))

    def _wait(self) -> None:
        """Take messages until a job is finished, or it is time to count the processes again."""
        deadline = time.monotonic() + _RECOUNT
        sent = len(self.futures)
        with suppress(queue.Empty):
            while len(self.futures) == sent and time.monotonic() < deadline:
                self._take(*self.messages.get(timeout=_RECOUNT))

    def _take(self, name: str, share: float | None) -> None:
        """Take note of a job's share, or that its future is done (None)."""
        if name not in self.open:  # a late report of a job that is finished
            return
        if name not in self.begun:
            self.begun.add(name)
            self.progress.begin(name)
        if share is not None:
            if share:
                self.progress.update(name, min(share, _ALMOST))
            return
        future = self.futures[name]
        if future.status != "finished":
            raise self._failure(name, future)
        self.progress.update(name, 1.0)
        del self.futures[name], self.open[name]

    def _failure(self, name: str, future: Future) -> UserError:
        if future.status == "error":
            error: Any = future.exception()
            if isinstance(error, UserError):
                return error
            if type(error).__name__ == "KilledWorker":
                return UserError(
                    f"{str(error.task).rpartition('-')[0]}: the cluster lost "
                    f"{error.allowed_failures + 1} workers that had it: see their logs; what is "
                    "finished is kept"
                )
            line = " ".join(f"{type(error).__name__}: {error}".split())
            return UserError(f"{name}: {line}")
        return UserError(_GONE)

    def _stop(self) -> None:
        """Ask the jobs in progress to stop, and wait for those that save their state."""
        from socialiq_lab import cluster

        if self.client.status != "running":
            return
        answers: Any = self.client.run(cluster.request_stop, self.name, on_error="ignore")
        saving = [self.futures[name] for names in answers.values() for name in names or ()]
        deadline = time.monotonic() + _PATIENCE
        while any(not future.done() for future in saving) and time.monotonic() < deadline:
            time.sleep(0.05)
        with suppress(Exception):  # the call is over; it only tidies the scheduler's queue
            self.client.cancel(list(self.futures.values()), force=True)
