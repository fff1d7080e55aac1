"""Compilation of the core: strict float64, no fused operations, a cache that detects edits."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import itertools
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
from numba.core import config

from socialiq.errors import UserError

_MOMENT = 2.0  # s; the cache loads in less


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function with Numba.

    Division follows IEEE 754 instead of raising, and no rewriting of arithmetic is allowed:
    the order of operations is that of highway-env, so the last bit is too.
    """
    # Tests wrap functions in run-time type checks, which Numba can't compile.
    return numba.njit(inspect.unwrap(function), error_model="numpy", nogil=True)


def entry_point(function: Callable[..., Any]) -> Any:
    """Compile a function that is called from Python without the GIL, and cache it on disk.

    Its last two arguments are the first row of its part and the end of it; see `run_in_parts`.
    """
    # Numba's own threads (parallel=True) would compile every kernel below a second time.
    options = {"error_model": "numpy", "nogil": True, "cache": True}
    return numba.njit(inspect.unwrap(function), **options)


def run_in_parts(run: Any, threads: int, rows: int, *arguments: Any) -> None:
    """Call an entry point on equal parts of the rows, each on a thread of its own.

    Args:
        run: Entry point whose last two arguments are the first row and the end of its part.
        threads: Number of threads; 0 takes all there are.
        rows: Number of rows.
        arguments: The entry point's other arguments.

    Raises:
        UserError: If there are fewer threads.
    """
    available = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    if threads > available:
        raise UserError(f"{threads} threads are more than there are: {available}")
    parts = min(threads or available, max(rows, 1))
    ends = [rows * part // parts for part in range(parts + 1)]
    if not run.signatures:
        with _announced():
            run(*arguments, 0, 0)
    if parts == 1:
        run(*arguments, 0, rows)
        return
    with ThreadPoolExecutor(parts) as pool:
        for done in [pool.submit(run, *arguments, *part) for part in itertools.pairwise(ends)]:
            done.result()


@contextlib.contextmanager
def _announced() -> Iterator[None]:
    """Say on standard error that code is compiled, if that takes more than a moment.

    Code that is in the cache loads in less. A terminal gets a dot for every second.
    """
    ended, said = threading.Event(), threading.Event()

    def show() -> None:
        if ended.wait(_MOMENT):
            return
        said.set()
        live = sys.stderr.isatty()
        sys.stderr.write("compiling the intersection for this machine, once" + "\n" * (not live))
        while live and not ended.wait(1.0):
            sys.stderr.write(".")
            sys.stderr.flush()

    begun = time.monotonic()
    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        if said.is_set():
            tail = " done in" if sys.stderr.isatty() else "compiled in"
            sys.stderr.write(f"{tail} {time.monotonic() - begun:.0f} s\n")


def fingerprint() -> int:
    """Return a number that changes with any source file that the compiled code depends on.

    Numba's cache checks the file of the entry point only; it would miss an edit to a kernel that
    the entry point calls. The entry point therefore closes over this number.
    """
    digest = hashlib.sha256()
    here = Path(__file__).parent
    names = ("buffers", "options", "settings", "state")
    around = (here.parent / f"{name}.py" for name in names)
    for path in (*sorted(here.glob("*.py")), *around):
        digest.update(path.read_bytes())
    return int.from_bytes(digest.digest()[:7], "big")
