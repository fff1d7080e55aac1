"""Dask clusters, a local one for this command or a running one, and what their processes do."""

import logging
import math
import os
import re
import signal
import tempfile
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import dask.config
from distributed import Client, LocalCluster, Nanny, Worker, get_worker

from socialiq import UserError
from socialiq.evaluation.parts import ONE_THREAD
from socialiq.learners.callbacks import Stopped, StopRequest
from socialiq.results_folder import versions
from socialiq.storage import read_json, write_atomically
from socialiq.worlds.highway import PORTABLE
from socialiq_lab.jobs import Job, do, job_environment

_CONNECT_SECONDS = 10.0
_WORKERS_SECONDS = 30.0
Made = TypeVar("Made")

_ADDRESS = re.compile(r"[a-z]{1,9}://[-.:\w\[\]%]{1,255}:\d{1,5}")

_SILENT = logging.CRITICAL + 1
_SETTINGS = {
    "distributed.scheduler.allowed-failures": 1_000_000,  # `jobs.do` counts the tries of a job
    "distributed.scheduler.worker-ttl": None,  # a compiler may keep a process silent for long
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "logging.distributed": "CRITICAL",
}


@contextmanager
def client_of(cluster: str | None, processes: int, work: Path) -> Iterator[Client]:
    """Connect to a running cluster, or start a local one for the duration of the context.

    `cluster` is the address of a scheduler or its scheduler file, None for a local cluster of some
    processes. Compiled programs are kept in the work folder.

    Raises:
        UserError: If the cluster can't be reached or has no workers.
    """
    roots = ("distributed", "asyncio", "tornado")  # errors are raised as one line, not logged
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] in roots]
    levels = {name: logging.getLogger(name).level for name in {*roots, *names}}
    for name in levels:
        logging.getLogger(name).setLevel(_SILENT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with _local(processes, work) if cluster is None else _remote(cluster) as client:
                yield client
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _started(kind: Callable[..., Made], *arguments: Any, **options: Any) -> Made:
    """Make a client or a cluster; try twice."""
    for _ in range(2):  # Dask asserts that its event loop runs in 10 s, which a busy machine misses
        with suppress(AssertionError):
            try:
                return kind(*arguments, **options)
            except RuntimeError as error:
                if isinstance(error.__cause__, OSError):  # a full disk, for instance
                    raise error.__cause__ from None
                raise
    raise UserError("Dask's event loop did not start: the machine is too busy; try again later")


@contextmanager
def _remote(cluster: str) -> Iterator[Client]:
    file = Path(cluster)
    address = scheduler_address(file) if file.is_file() else cluster
    try:
        if ":" not in address:
            raise ValueError("neither an address with a port nor a file")
        client = _started(Client, address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, TimeoutError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"no Dask scheduler answers at {cluster}: start `dask scheduler`, or name its "
            "address (tcp://HOST:PORT) or its scheduler file"
        ) from error
    try:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_SECONDS)
        except TimeoutError as error:
            raise UserError(f"{cluster} has no workers: start some with `dask worker`") from error
        yield client
    finally:
        client.close(timeout=5)


def scheduler_address(file: Path) -> str:
    """Return the address in a scheduler file (`dask scheduler --scheduler-file`).

    Raises:
        UserError: If it is not such a file.
    """
    content = read_json(file)
    address = content.get("address") if isinstance(content, dict) else None
    if not isinstance(address, str) or not _ADDRESS.fullmatch(address):
        raise UserError(
            f"{file} names no scheduler's address: make it with `dask scheduler --scheduler-file`"
        )
    return address


@contextmanager
def _local(processes: int, work: Path) -> Iterator[Client]:
    environment = job_environment(work)
    before = dict(os.environ)
    with tempfile.TemporaryDirectory() as scratch:
        settings = _SETTINGS | {"distributed.nanny.pre-spawn-environ": environment}
        try:
            with (
                dask.config.set(settings),
                _started(
                    LocalCluster,
                    n_workers=processes,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    protocol="tls://",
                    security=True,  # other users of this machine can't send it code
                    dashboard_address="127.0.0.1:0",
                    scheduler_kwargs={"dashboard": False},
                    memory_limit=0,
                    silence_logs=_SILENT,
                    local_directory=scratch,
                    preload="socialiq_lab.cluster",
                ) as cluster,
                _started(Client, cluster, set_as_default=False) as client,
            ):
                yield client
        finally:
            os.environ.clear()  # Dask leaves the variables of its workers there
            os.environ.update(before)


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


def perform(task: Task) -> float:
    """Run a job and return its seconds.

    Raises:
        Stopped: If the call was stopped.
        UserError: If the job fails for whatever reason, in one line that names it.
    """
    name = task.job.name
    request = StopRequest()
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
        self._worker = get_worker()
        self._request = request
        self._name = task.job.name
        self._topic = topic(task.call)
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
    here = describe()
    host = os.uname().nodename if hasattr(os, "uname") else "a worker"
    for name, value in expected.items():
        if here[name] != value and name in PORTABLE:
            raise UserError(
                f'the worker on {host} was not started with {name}="{value}": start it with '
                "`dask worker --preload-nanny socialiq_lab.cluster`"
            )
        if here[name] != value:
            raise UserError(f"the worker on {host} has {name} {here[name]}, this process {value}")
    deadline = time.monotonic() + _SHARED_SECONDS
    while not ((work / ".call").is_file() and (work / ".call").read_text() == call):
        if time.monotonic() > deadline:
            raise UserError(
                f"the worker on {host} does not see {work}: name a --work folder that all share"
            )
        time.sleep(0.2)


def dask_setup(worker: Worker | Nanny) -> None:
    """Prepare a process of a cluster, before it takes jobs.

    A nanny (`dask worker --preload-nanny socialiq_lab.cluster`) gives its worker the variables that
    must be set before a process starts. What follows is for a worker of the local cluster.
    A Ctrl-C at the terminal is for the command alone, which passes it on. Libraries count the
    cores when they start their threads, so the process is pinned before that; two threads that wait
    for one another on one core are several times as slow as one.
    """
    if isinstance(worker, Nanny):
        for variables in (worker.pre_spawn_env, worker.env):  # set before and after the start
            variables.update(ONE_THREAD | PORTABLE)
        return
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        number: Any = worker.name
        os.sched_setaffinity(0, {cores[int(number) % len(cores)]})
