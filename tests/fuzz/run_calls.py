"""Run bad calls in this process, and judge how each one ends."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from tests.fuzz.calls import Call
from tests.patience import HANG

from socialiq.cli.main import main
from socialiq.worlds.highway import PORTABLE

SECONDS = 60.0
"""Most time of the processor that a call takes; some of them train."""

STATUSES = (0, 1, 2, 3)


class TooLong(BaseException):
    """The time of a call is over. No command catches it."""


class Outcome(NamedTuple):
    """End of a call.

    Attributes:
        words: The call.
        status: Exit status; -1 if it took too long.
        seconds: Its time.
        fault: What is wrong with this end, or "".
        error: Its standard error.
    """

    words: list[str]
    status: int
    seconds: float
    fault: str
    error: str


@contextlib.contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `TooLong` in the body when its time of the processor is over, or when it hangs."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    limits = (
        (signal.SIGPROF, signal.ITIMER_PROF, seconds),
        (signal.SIGALRM, signal.ITIMER_REAL, HANG),
    )
    before = [signal.signal(number, stop) for number, _, _ in limits]
    try:
        for _, timer, most in limits:
            signal.setitimer(timer, most)
        yield
    finally:
        for (number, timer, _), handler in zip(limits, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, handler)


class Runner:
    """Place where calls are run.

    Attributes:
        ok: Folder of samples.
        bad: Folder of bad places.
        out: Folder for outputs; empty before and after each call.
    """

    def __init__(self, folder: Path) -> None:
        self.ok, self.bad, self.out = (folder / name for name in ("ok", "bad", "out"))
        for one in (self.ok, self.bad, self.out):
            one.mkdir()
        os.environ.update(PORTABLE)  # or `conformance` would run in a process of its own
        self._kept: dict[Path, tuple[int, int]] = {}

    def keep(self) -> None:
        """Note the samples and the bad places as they are; no call may change them."""
        self._kept = self._stamps()

    def _stamps(self) -> dict[Path, tuple[int, int]]:
        found = {}
        for folder in (self.ok, self.bad):
            for path in sorted(folder.rglob("*")):
                state = path.lstat()
                found[path] = (state.st_size if path.is_file() else 0, state.st_mtime_ns)
        return found

    def run(self, call: Call) -> Outcome:
        """Run a call and judge its end."""
        words = call.at(self.ok, self.bad, self.out)
        output, errors = io.StringIO(), io.StringIO()
        began, status = time.perf_counter(), -1
        before = Path.cwd()
        os.chdir(self.out)
        try:
            streams = contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors)
            with streams[0], streams[1], limited(SECONDS):
                status = main(words)
        except TooLong:
            pass
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else 1
        finally:
            os.chdir(before)
        seconds = time.perf_counter() - began
        fault = self._fault(call, status, output.getvalue(), errors.getvalue())
        for path in self.out.iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        return Outcome(words, status, seconds, fault, errors.getvalue())

    def _fault(self, call: Call, status: int, output: str, errors: str) -> str:
        if status == -1:
            return f"longer than {SECONDS:g} s"
        if status not in STATUSES:
            return f"exit status {status}"
        if "Traceback" in errors:
            return "a traceback"
        if status != 2:
            return "accepted" if call.refused else ""
        lines = [line for line in errors.splitlines() if line.startswith("socialiq: ")]
        if len(lines) != 1 or not errors.endswith(f"{lines[0]}\n") or len(lines[0]) < 20:
            return "not one line"
        if len(lines[0]) > 1500 or not lines[0].isprintable():
            return "a line that is long or not printable"
        if output:
            return "output of a refused call"
        left = sorted(path.name for path in self.out.iterdir())
        if left:
            return f"left {', '.join(left)}"
        if self._stamps() != self._kept:
            self.keep()
            return "changed a file"
        return ""


def report(outcomes: list[Outcome]) -> str:
    """Return a summary, and a paragraph for each fault."""
    faults = [one for one in outcomes if one.fault]
    statuses = {status: sum(one.status == status for one in outcomes) for status in (*STATUSES, -1)}
    text = f"{len(outcomes)} bad calls, {len(faults)} faults; by exit status: {statuses}\n"
    for one in faults:
        words = " ".join(word[:80] for word in one.words)
        text += f"\n{one.fault}: socialiq {words!a}\n  {one.error[-600:]!a}\n"
    return text


if __name__ == "__main__":
    sys.exit("run python -m tests.fuzz")
