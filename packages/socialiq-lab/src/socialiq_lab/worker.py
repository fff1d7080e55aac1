"""Functions for the processes of a Dask cluster: run a job, report its progress, stop it."""

import math
import os
import signal
import threading
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from distributed import Worker, get_worker

from socialiq import UserError
from socialiq.learners.callbacks import Stopped, StopRequest
from socialiq.results_folder import versions
from socialiq.storage import write_atomically
from socialiq.worlds.highway import PORTABLE
from socialiq_lab.jobs import Job, do

_REPORT_SECONDS = 0.2  # between two reports of one job
_SHARED_SECONDS = 10.0  # for a new file to appear on another machine of a shared file system

_requests: dict[str, dict[str, StopRequest]] = {}  # of the jobs in progress, by call
_stopped: set[str] = set()  # calls that were stopped
_lock = threading.Lock()


class Task(NamedTuple):
    """A job as it travels to a worker."""

    job: Job
    work: Path  # folder of all jobs' folders, as an absolute path
    fingerprint: str
    call: str  # name of the call of `run_jobs`
    described: dict[str, str]  # result of `describe` in the calling process


def perform(task: Task, *_inputs: float) -> float:
    """Run a job and return its seconds; the inputs only make it wait for them.

    Raises:
        Stopped: If the call was stopped.
        UserError: If the job fails for whatever reason, in one line that names it.
    """
    name, request = task.job.name, StopRequest()
    with _lock:
        if task.call in _stopped:
            raise Stopped("stopped")
        _requests.setdefault(task.call, {})[name] = request
    try:
        check(task.described, task.work, task.call)
        with request.reaches_thread():
            report = _Reporter(task, request)
            return do(task.job, task.work, task.fingerprint, report, task.call)
    except Stopped:
        raise
    except UserError as error:
        raise UserError(f"{name}: {error}") from None
    except Exception as error:
        note = task.work / f"{name}.part" / "error.txt"
        with suppress(UserError, OSError):
            write_atomically(note, traceback.format_exc())
        line = " ".join(f"{type(error).__name__}: {error}".split())
        raise UserError(f"{name}: {line}; the traceback is in {note}") from None
    finally:
        with _lock:
            _requests[task.call].pop(name, None)


class _Reporter:
    """Progress callback that sends a job's finished share to the calling process."""

    def __init__(self, task: Task, request: StopRequest) -> None:
        self._worker, self._request = get_worker(), request
        self._name, self._topic = task.job.name, topic(task.call)
        self._sent = -math.inf
        self._send(0.0)

    def __call__(self, share: float) -> None:
        if self._request.is_set() and not self._request.listeners:
            raise Stopped("stopped")
        if time.monotonic() - self._sent >= _REPORT_SECONDS:
            self._sent = time.monotonic()
            self._send(share)

    def _send(self, share: float) -> None:
        self._worker.log_event(self._topic, [self._name, float(share)])


def topic(call: str) -> str:
    """Return the name under which the reports of a call are sent."""
    return f"socialiq-{call}"


def request_stop(call: str) -> list[str]:
    """Ask the jobs of a call to stop; return those that save their state first."""
    with _lock:
        _stopped.add(call)
        requests = _requests.get(call, {})
        for request in requests.values():
            request.set()
        return [name for name, request in requests.items() if request.listeners]


def describe() -> dict[str, str]:
    """Return the versions and variables of this process that affect a job's numbers."""
    return versions() | {name: os.environ.get(name, "") for name in PORTABLE}


def check(expected: dict[str, str], work: Path, call: str) -> None:
    """Refuse a worker whose numbers or files would differ from the caller's.

    `expected` is the result of `describe` in the calling process; the name of the call is in the
    file `.call` of the work folder.

    Raises:
        UserError: If a version or a variable differs, or the folder is not shared.
    """
    here, host = describe(), os.uname().nodename if hasattr(os, "uname") else "a worker"
    for name, value in expected.items():
        if here[name] != value and name in PORTABLE:
            raise UserError(f'the worker on {host} was not started with {name}="{value}"')
        if here[name] != value:
            raise UserError(f"the worker on {host} has {name} {here[name]}, this process {value}")
    deadline = time.monotonic() + _SHARED_SECONDS
    while not ((work / ".call").is_file() and (work / ".call").read_text() == call):
        if time.monotonic() > deadline:
            raise UserError(
                f"the worker on {host} does not see {work}: name a --work folder that all share"
            )
        time.sleep(0.2)


def dask_setup(worker: Worker) -> None:
    """Prepare a process of the local cluster, before it takes jobs.

    A Ctrl-C at the terminal is for the command alone, which passes it on. Libraries count the
    cores when they start their threads, so the process is pinned before that; two threads that wait
    for one another on one core are several times as slow as one.
    """
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        number: Any = worker.name
        os.sched_setaffinity(0, {cores[int(number) % len(cores)]})
