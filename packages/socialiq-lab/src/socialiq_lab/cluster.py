"""Dask clusters: a local one for this command, or a running one."""

import logging
import os
import re
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import dask.config
from distributed import Client, LocalCluster

from socialiq import UserError
from socialiq.storage import read_json
from socialiq_lab.jobs import job_environment

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

    Args:
        cluster: Address of a scheduler or its scheduler file; None for a local cluster.
        processes: Number of processes of the local cluster.
        work: Folder of all jobs' folders, and of compiled programs.

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
                    preload="socialiq_lab.worker",
                ) as cluster,
                _started(Client, cluster, set_as_default=False) as client,
            ):
                yield client
        finally:
            os.environ.clear()  # Dask leaves the variables of its workers there
            os.environ.update(before)
