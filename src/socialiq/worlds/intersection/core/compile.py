"""Compilation of the core: strict float64, no fused operations, a cache that detects edits."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function with Numba.

    Division follows IEEE 754 instead of raising, and no rewriting of arithmetic is allowed:
    the order of operations is that of highway-env, so the last bit is too.
    """
    # Tests wrap functions in run-time type checks, which Numba can't compile.
    return numba.njit(inspect.unwrap(function), error_model="numpy", nogil=True)


def entry_point(function: Callable[..., Any]) -> Any:
    """Compile a function whose `prange` loops may run on several threads, and cache it on disk."""
    options = {"error_model": "numpy", "nogil": True, "parallel": True, "cache": True}
    return numba.njit(inspect.unwrap(function), **options)


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
