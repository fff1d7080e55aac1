"""Standard output and error that never decide a command's exit status.

A verdict is the exit status of `audit`. A reader that closes the pipe early, a full disk or a
locale that lacks a character must not change it: a failed write is remembered instead of raised.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any

CRASHED = 70
"""Exit status of a fault of the program (EX_SOFTWARE of sysexits.h)."""
OUTPUT_LOST = 74
"""Exit status of a command that did its work but could not write its output (EX_IOERR)."""


class Stream:
    """Text stream that remembers the first failed write, and ignores what follows it.

    Attributes:
        failure: The failed write, if there was one.
    """

    def __init__(self, stream: Any) -> None:
        """Wrap a stream; None stands for one that was closed before the program began."""
        self._stream = stream
        self.failure: OSError | None = None
        if stream is None:
            self._stream, self.failure = io.StringIO(), BrokenPipeError()
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        """Write, unless a write has failed."""
        self._try(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush, unless a write has failed."""
        self._try(self._stream.flush)

    def _try(self, action: Callable[[], Any]) -> None:
        if self.failure is None:
            try:
                action()
            except OSError as error:
                self.failure = error

    @property
    def is_lost(self) -> bool:
        """Whether output is missing that a reader still waits for."""
        failure = self.failure
        return failure is not None and failure.errno not in (None, errno.EPIPE)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the stream, such as `isatty`."""
        return getattr(self._stream, name)


def exit_status(command: Callable[[], int]) -> int:
    """Run a command; return its exit status, whatever becomes of its output.

    Args:
        command: Returns its exit status.

    Returns:
        The command's status; 70 after a fault of the program; 74 in the place of 0 if output was
        lost because a disk is full, for instance.
    """
    before = sys.stdout, sys.stderr
    out, errors = Stream(sys.stdout), Stream(sys.stderr)
    sys.stdout, sys.stderr = out, errors  # pyright: ignore[reportAttributeAccessIssue]
    try:
        status = _run(command)
        out.flush()
        if out.is_lost and out.failure:
            errors.write(f"socialiq: can't write the output: {out.failure.strerror}\n")
            status = status or OUTPUT_LOST
    finally:
        sys.stdout, sys.stderr = before
        for stream in (out, errors):
            stream.flush()
            _discard(stream)
    return status


def _run(command: Callable[[], int]) -> int:
    try:
        return command()
    except Exception:  # a fault of ours, whatever it is, must not look like a failed audit
        traceback.print_exc()
        sys.stderr.write(
            "socialiq: this is a fault of the program: please report the lines above\n"
        )
        return CRASHED


def _discard(stream: Stream) -> None:
    """Empty the buffer of a stream that failed; Python would exit with 120 at its last flush."""
    if stream.failure is None:
        return
    with contextlib.suppress(AttributeError, OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
