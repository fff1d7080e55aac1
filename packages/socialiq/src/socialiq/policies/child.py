"""A child process that exchanges lines with this one, each within a time limit; POSIX only."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from socialiq.errors import UserError
from socialiq.foreign import one_line

_CHUNK = 65_536
_LAUNCHERS = Path(__file__).with_name("launchers.py")


class Child:
    """A running command. It is started without a shell and has the rights of its caller.

    Args:
        command: Program and arguments.
        source: Its name in messages.
        memory: Bytes of address space that it, and each process that it starts, may have; 0 for
            any amount.

    Raises:
        UserError: If it can't be started.
    """

    def __init__(self, command: Sequence[str], source: str, memory: int = 0) -> None:
        if os.name != "posix":
            raise UserError(
                "a policy in a separate process needs Linux or macOS: export it to ONNX"
            )
        if memory and not _has_memory_limits():
            raise UserError("this system sets no memory limit for a process: pass --memory-gib 0")
        self.source = source
        self._ended = ""
        self._complaint = b""
        watched, self._lifeline = os.pipe()
        guard = (sys.executable, "-I", "-S", _LAUNCHERS, "guard", str(watched), str(memory))
        # A new process group, so that all processes that it starts can be ended with it.
        self._process = subprocess.Popen(
            [*guard, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=(watched,),
            start_new_session=True,
            bufsize=0,
        )
        os.close(watched)
        assert self._process.stdin and self._process.stdout and self._process.stderr
        self._in, self._out = self._process.stdin.fileno(), self._process.stdout.fileno()
        self._err = self._process.stderr.fileno()
        for stream in (self._in, self._out, self._err):
            os.set_blocking(stream, False)

    def exchange(self, line: bytes, seconds: float, most: int) -> bytes:
        """Send a line and wait for the one that answers it.

        Args:
            line: Ended by a newline.
            seconds: Until the child is killed.
            most: Bytes that the answer may have.

        Raises:
            UserError: If the child answers late, too much or not at all; it is killed then.
        """
        if self._ended:
            raise UserError(f"{self.source} {self._ended}")
        until, answer = time.monotonic() + seconds, b""
        with selectors.DefaultSelector() as waiting:
            waiting.register(self._in, selectors.EVENT_WRITE)
            waiting.register(self._out, selectors.EVENT_READ)
            waiting.register(self._err, selectors.EVENT_READ)
            while b"\n" not in answer:
                ready = waiting.select(max(until - time.monotonic(), 0.0))
                if time.monotonic() > until:
                    raise self.failure(f"did not answer within {seconds:g} s and was ended")
                for key, _ in ready:
                    if key.fd == self._in:
                        line = line[self._write(line[:_CHUNK]) :]
                        if not line:
                            waiting.unregister(self._in)
                    elif key.fd == self._err:
                        self._read_error(waiting)
                    else:
                        answer += self._read()
                if len(answer) > most:
                    raise self.failure(f"answered more than {most:,} bytes and was ended")
        if line or answer.index(b"\n") < len(answer) - 1:
            raise self.failure("must answer each line by one, after it has read it; it was ended")
        return answer

    def failure(self, fault: str) -> UserError:
        """End the child and return the error, with the last line that the child wrote."""
        with selectors.DefaultSelector() as waiting:
            waiting.register(self._err, selectors.EVENT_READ)
            until = time.monotonic() + 0.2  # for a child that is ending
            while waiting.get_map() and time.monotonic() <= until:
                if waiting.select(max(until - time.monotonic(), 0.0)):
                    self._read_error(waiting)
        last = one_line(self._complaint.strip().rsplit(b"\n", 1)[-1])
        self._ended = f"{fault}; last error line: {last}" if last else fault
        self.close()
        return UserError(f"{self.source} {self._ended}")

    def close(self) -> None:
        """End the child and all of its group."""
        self._ended = self._ended or "was ended"
        if self._process.returncode is not None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._lifeline)
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream:
                stream.close()

    def _write(self, piece: bytes) -> int:
        """Write what fits into the pipe; return the number of bytes."""
        try:
            return os.write(self._in, piece)
        except BlockingIOError:
            return 0
        except BrokenPipeError:
            raise self.failure("ended before it answered") from None

    def _read(self) -> bytes:
        try:
            piece = os.read(self._out, _CHUNK)
        except BlockingIOError:
            return b""
        if not piece:
            raise self.failure("ended before it answered")
        return piece

    def _read_error(self, waiting: selectors.BaseSelector) -> None:
        """Read the child's standard error and keep its end, so that the pipe never fills."""
        try:
            piece = os.read(self._err, _CHUNK)
        except BlockingIOError:
            return
        if not piece:
            waiting.unregister(self._err)
        self._complaint = (self._complaint + piece)[-4_096:]


def _has_memory_limits() -> bool:
    """Whether the system has limits of address space; some have them and set none (`launchers`)."""
    try:
        import resource
    except ImportError:
        return False
    return hasattr(resource, "RLIMIT_AS")
