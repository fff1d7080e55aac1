"""Episodes in parts, by seed, in separate processes; the same results for any number of these."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

import numpy as np

from socialiq.errors import UserError
from socialiq.learners.callbacks import Report

Part = TypeVar("Part")
Result = TypeVar("Result")

_EACH = 4  # parts of a process, so that there is progress to report
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def available_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_processes(processes: int) -> None:
    """Raise `UserError` if a number of processes is negative."""
    if processes < 0:
        raise UserError(f"processes must be at least 1, got {processes}")


def draws_in_order(name: str) -> UserError:
    """Return the error for a policy whose draws depend on the order of all episodes."""
    return UserError(f"{name} draws its actions in order: leave out --processes")


def blocks_of(seeds: Sequence[int] | np.ndarray, processes: int) -> list[np.ndarray]:
    """Return the seeds of each part, in their order.

    Args:
        seeds: Seed of each episode.
        processes: Number of processes; each gets a few parts, as long as there are seeds.
    """
    return np.array_split(np.asarray(seeds), max(1, min(_EACH * processes, len(seeds))))


def in_parts(
    play: Callable[[Part], Result],
    parts: Sequence[Part],
    processes: int,
    on_report: Callable[[Report], None] | None = None,
) -> list[Result]:
    """Call a function on each part, each in one of some processes; return the results in order.

    Args:
        play: Function of a module; it and the parts are sent to the processes.
        parts: Its arguments.
        processes: Number of processes, each with one thread of linear algebra.
        on_report: Called with the progress after each part.

    Raises:
        UserError: If a part fails, or its process ends. The other processes are stopped, as they
            are on Ctrl-C.
    """
    context = multiprocessing.get_context("spawn")
    begun = time.monotonic()
    with _one_thread(), ProcessPoolExecutor(min(processes, len(parts)), context) as pool:
        tasks = [pool.submit(play, argument) for argument in parts]
        pool.submit(int)  # wakes the pool, or it would not notice if the last process ended
        try:
            for finished, task in enumerate(as_completed(tasks), 1):
                task.result()
                if on_report is not None:
                    seconds = (time.monotonic() - begun) / finished
                    left = seconds * (len(parts) - finished)
                    rate = 60.0 / seconds
                    on_report(Report(finished, len(parts), rate, left, {}, {}, (), "parts/min"))
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            if isinstance(error, UserError) or not isinstance(error, Exception):
                raise
            if isinstance(error, BrokenProcessPool):
                raise UserError("a process of the episodes was killed: use fewer") from None
            line = " ".join(f"{type(error).__name__}: {error}".split())
            raise UserError(f"a part of the episodes failed: {line}") from error
        return [task.result() for task in tasks]


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Give processes that are started one thread of linear algebra each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
