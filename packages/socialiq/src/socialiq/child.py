"""A command in a process group of its own that answers each line by one; POSIX."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import one_line

_CHUNK = 65_536
_LAUNCHERS = Path(__file__).with_name("launchers.py")


class Child:
    """A running command, called `source` in messages. It has the rights of its caller.

    Args:
        command: Words of the command.
        source: Name of the command in messages.
        memory: Bytes of address space that each of its processes may have; 0 sets no limit.

    Raises:
        UserError: If the system sets no limits.
    """

    def __init__(self, command: Sequence[str], source: str, memory: int = 0) -> None:
        if memory:  # some systems have limits and set none (`launchers`)
            try:
                from resource import RLIMIT_AS  # noqa: F401
            except ImportError as error:
                line = "this system sets no memory limit for a process: pass --memory-gib 0"
                raise UserError(line) from error
        self.source = source
        self._ended = ""
        self._complaint = b""
        watched, self._lifeline = os.pipe()
        guard = (sys.executable, "-I", "-S", _LAUNCHERS, "guard", str(watched), str(memory))
        pipe = subprocess.PIPE
        # A new process group, so that all processes that it starts can be ended with it.
        self._process = subprocess.Popen(
            [*guard, *command],
            stdin=pipe,
            stdout=pipe,
            stderr=pipe,
            pass_fds=(watched,),
            start_new_session=True,
            bufsize=0,
        )
        os.close(watched)
        assert self._process.stdin and self._process.stdout and self._process.stderr
        self._in = self._process.stdin.fileno()
        self._out = self._process.stdout.fileno()
        self._err = self._process.stderr.fileno()
        for stream in (self._in, self._out, self._err):
            os.set_blocking(stream, False)

    def exchange(self, line: bytes, seconds: float, most: int) -> bytes:
        """Send a line and wait for the one that answers it.

        Args:
            line: The line, with its newline.
            seconds: Time for the answer.
            most: Largest number of bytes of the answer.

        Raises:
            UserError: If the child answers late, too much or not at all; it is killed then.
        """
        if self._ended:
            raise UserError(f"{self.source} {self._ended}")
        until = time.monotonic() + seconds
        answer = b""
        with selectors.DefaultSelector() as waiting:
            waiting.register(self._in, selectors.EVENT_WRITE)
            waiting.register(self._out, selectors.EVENT_READ)
            waiting.register(self._err, selectors.EVENT_READ)
            while b"\n" not in answer:
                ready = waiting.select(max(until - time.monotonic(), 0.0))
                if time.monotonic() > until:
                    raise self.failure(f"did not answer within {seconds:g} s and was ended")
                for key, _ in ready:
                    try:
                        if key.fd == self._in:
                            line = line[os.write(self._in, line[:_CHUNK]) :]
                            if not line:
                                waiting.unregister(self._in)
                        elif key.fd == self._err:
                            self._read_error(waiting)
                        else:
                            piece = os.read(self._out, _CHUNK)
                            if not piece:
                                raise BrokenPipeError
                            answer += piece
                    except BlockingIOError:
                        continue
                    except BrokenPipeError:
                        raise self.failure("ended before it answered") from None
                if len(answer) > most:
                    raise self.failure(f"answered more than {most:,} bytes and was ended")
        if line or answer.index(b"\n") < len(answer) - 1:
            raise self.failure("must answer each line by one, after it has read it; it was ended")
        return answer

    def request(self, message: dict[str, Any], seconds: float, most: int) -> dict[str, Any]:
        """Send a message and return its answer.

        Args:
            message: A JSON object.
            seconds: Time for the answer.
            most: Largest number of bytes of the answer.

        Raises:
            UserError: If the answer is late, too long, no JSON object, or an error of the policy;
                the child is ended then.
        """
        line = self.exchange(json.dumps(message).encode() + b"\n", seconds, most)
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError):
            raise self.failure("answered a line that is not JSON") from None
        if not isinstance(answer, dict):
            raise self.failure("answered a line that is not a JSON object")
        if isinstance(answer.get("error"), str):
            self.close()
            raise UserError(f"{self.source} {one_line(answer['error'])}")
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

    def _read_error(self, waiting: selectors.BaseSelector) -> None:
        """Read the child's standard error and keep its end, so that the pipe never fills."""
        try:
            piece = os.read(self._err, _CHUNK)
        except BlockingIOError:
            return
        if not piece:
            waiting.unregister(self._err)
        self._complaint = (self._complaint + piece)[-4_096:]
