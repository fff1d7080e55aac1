"""Episodes in parts, by seed, in separate processes; the same results for any number of these."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
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

ONE_THREAD: dict[str, str] = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
)
"""Environment variables that give a process one thread of linear algebra."""


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


class Workers:
    """Processes that call a function on parts, each with one thread of linear algebra.

    They start with the first call and end with the context. They don't act on Ctrl-C, which their
    parent answers.
    """

    def __init__(self, processes: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(processes, context, _leave_interrupts)

    def __enter__(self) -> Workers:
        """Return the workers."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes, after what they are doing."""
        self._pool.shutdown()

    def __call__(
        self,
        play: Callable[[Part], Result],
        parts: Sequence[Part],
        on_report: Callable[[Report], None] | None = None,
    ) -> list[Result]:
        """Call a function on each part; return the results in order.

        Args:
            play: Function of a module; it and the parts are sent to the processes.
            parts: Its arguments.
            on_report: Called with the progress after each part.

        Raises:
            UserError: If a part fails, or its process ends. All processes are then stopped, as they
                are on Ctrl-C.
        """
        begun = time.monotonic()
        try:
            with _one_thread():
                tasks = [self._pool.submit(play, argument) for argument in parts]
                # wakes the pool, or it would not notice if the last process ended
                self._pool.submit(int)
                for finished, task in enumerate(as_completed(tasks), 1):
                    task.result()
                    if on_report is not None:
                        seconds = (time.monotonic() - begun) / finished
                        left = seconds * (len(parts) - finished)
                        rate = 60.0 / seconds
                        on_report(Report(finished, len(parts), rate, left, {}, {}, (), "parts/min"))
        except BaseException as error:
            self._pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            if isinstance(error, UserError) or not isinstance(error, Exception):
                raise
            if isinstance(error, BrokenProcessPool):
                raise UserError("a process of the episodes was killed: use fewer") from None
            line = " ".join(f"{type(error).__name__}: {error}".split())
            raise UserError(f"a part of the episodes failed: {line}") from error
        return [task.result() for task in tasks]


def in_parts(
    play: Callable[[Part], Result],
    parts: Sequence[Part],
    processes: int,
    on_report: Callable[[Report], None] | None = None,
) -> list[Result]:
    """Call a function on each part in some processes, which end with it; see `Workers`.

    Args:
        play: Function of a module; it and the parts are sent to the processes.
        parts: Its arguments.
        processes: Number of processes.
        on_report: Called with the progress after each part.

    Returns:
        The results in order.

    Raises:
        UserError: If a part fails, or its process ends.
    """
    with Workers(min(processes, len(parts))) as workers:
        return workers(play, parts, on_report)


def _leave_interrupts() -> None:
    """Ignore Ctrl-C, which reaches all processes of a terminal."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Give processes that are started one thread of linear algebra each."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
