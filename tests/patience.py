"""Events that tests wait for. The one limit here guards against a hang, however slow the machine.

No other test compares times (`tests/docs/test_sources.py`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, settings

HANG = 900.0
"""Seconds after which a test that still waits has failed; what must be ended lasts longer."""
LONGER = 4 * HANG
"""Seconds that a process sleeps that a test must see ended."""
PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""Profile of Hypothesis."""


def wait_until(event: Callable[[], object]) -> None:
    """Return once a function's value is true."""
    deadline = time.monotonic() + HANG
    while not event():
        assert time.monotonic() < deadline, "it never came to that"
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    """Whether a process runs; one that has ended and was not yet waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def pid_in(path: Path) -> int:
    """Return the number that a process writes to a file, as soon as its line is whole."""
    wait_until(lambda: path.exists() and path.read_text().endswith("\n"))
    return int(path.read_text())
