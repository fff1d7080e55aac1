"""Compilation of the core: strict float64, no fused operations, a cache that detects edits.

Functions are unwrapped of the run-time type checks of tests, which Numba can't compile.
"""

import gc
import hashlib
import inspect
import itertools
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import numba.extending
from numba.core import config

from socialiq import physics
from socialiq.errors import UserError
from socialiq.worlds import road_users

NOTICE = "compiling the roads for this machine, once"

_CALLED: set[Any] = set()  # entry points that are compiled
_MOMENT = 2.0  # s; the cache loads in less
# Beside a folder of kernels, which read these.
_TABLES = ("effects", "network", "observation", "options", "scenes", "crossings", "idm")


def kernel(function: Callable[..., Any], allocates: bool = False) -> Any:
    """Make a function callable from compiled code.

    Division follows IEEE 754 instead of raising, and no rewriting of arithmetic is allowed: the
    order of operations is that of highway-env, so the last bit is too. The function gets no wrapper
    for Python, which would be a third of the compilation; see `for_python`. A function that makes
    an array is an `allocating_kernel`.

    Args:
        function: Function to compile.
        allocates: Whether the compiled code counts references, as code that makes arrays must.
    """
    options = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    options["_nrt"] = allocates  # Numba's counts of references
    return numba.extending.register_jitable(**options)(inspect.unwrap(function))


for _form in ("wrapped", "desired_gap", "idm", "ballistic", "overlap_depth"):
    kernel(getattr(physics, _form))


def allocating_kernel(function: Callable[..., Any]) -> Any:
    """Make a function that makes arrays callable from compiled code.

    Only it counts references: atomic counts in all kernels took a fifth of the time.
    """
    return kernel(function, allocates=True)


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """Make a function callable from compiled code, and compile it as a part of its caller.

    For large kernels with one caller: compiled by themselves they would be optimised twice, with
    everything that they call.
    """
    return numba.njit(inspect.unwrap(function), error_model="numpy", inline="always")


def for_python(function: Callable[..., Any]) -> Any:
    """Compile a kernel so that Python can call it."""
    return numba.njit(function, error_model="numpy", nogil=True)


def elementwise(function: Callable[..., Any]) -> Any:
    """Compile a function of numbers that Python calls with arrays, which are broadcast."""
    return numba.vectorize(nopython=True, cache=True)(inspect.unwrap(function))


def entry_point(function: Callable[..., Any], allocates: bool = False) -> Any:
    """Compile a function that is called from Python without the GIL, and cache it on disk.

    Args:
        function: Function whose last two arguments are the first row of its part and the end of it;
            see `run_in_parts`.
        allocates: Whether the compiled code counts references, as code that makes arrays must.
    """
    # Numba's own threads (parallel=True) would compile every kernel below a second time.
    options = {"error_model": "numpy", "nogil": True, "cache": True, "_nrt": allocates}
    return numba.njit(inspect.unwrap(function), **options)


def allocating_entry_point(function: Callable[..., Any]) -> Any:
    """Compile an entry point that makes arrays, or that inlines kernels which do."""
    return entry_point(function, allocates=True)


def run_in_parts(run: Any, threads: int, rows: int, *arguments: Any) -> None:
    """Call an entry point on equal parts of the rows, each on a separate thread.

    Compilation that takes more than a moment is announced on standard error; code that is in the
    cache loads in less. Only whole lines are written, each at once, so that a progress bar stays
    below them. Garbage collection, a tenth of the time, waits.

    Args:
        run: Entry point.
        threads: Number of threads; 0 takes all.
        rows: Number of rows.
        *arguments: Arguments of the entry point before the two for the part.

    Raises:
        UserError: If there are fewer threads.
    """
    available = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    if threads > available:
        raise UserError(f"{threads} threads are more than there are: {available}")
    count = min(threads or available, max(rows, 1))
    ends = [rows * interval // count for interval in range(count + 1)]
    if run not in _CALLED:  # not by `run.signatures`, which hashes all types at every call
        begun = time.monotonic()
        collecting = gc.isenabled()
        notice = threading.Timer(_MOMENT, lambda: sys.stderr.write(f"{NOTICE}\n"))
        notice.daemon = True
        notice.start()
        gc.disable()
        try:
            run(*arguments, 0, 0)
        finally:
            if collecting:
                gc.enable()
            notice.cancel()
            notice.join()
            if time.monotonic() - begun > _MOMENT:
                sys.stderr.write(f"compiled in {time.monotonic() - begun:.0f} s\n")
        _CALLED.add(run)
    if count == 1:
        run(*arguments, 0, rows)
        return
    with ThreadPoolExecutor(count) as pool:
        intervals = [pool.submit(run, *arguments, *ends_of) for ends_of in itertools.pairwise(ends)]
        for interval in intervals:
            interval.result()


def fingerprint(*files: str) -> int:
    """Return a number that changes with any source file that an entry point depends on.

    Numba's cache checks the file of the entry point only; it would miss an edit to a kernel that
    the entry point calls. The entry point therefore closes over this number. The files are those
    beyond the shared kernels: all files of their folders count, and the tables above.
    """
    digest = hashlib.sha256(Path(physics.__file__).read_bytes())
    digest.update(Path(road_users.__file__).read_bytes())
    for folder in sorted({Path(name).parent for name in (__file__, *files)}):
        tables = (folder.parent / f"{name}.py" for name in _TABLES)
        for path in (*sorted(folder.glob("*.py")), *filter(Path.exists, tables)):
            digest.update(path.read_bytes())
    return int.from_bytes(digest.digest()[:7], "big")
