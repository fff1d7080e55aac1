"""Policies in a separate process, in any language, over JSON lines (docs/policies.md); POSIX."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import selectors
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies.interface import BatchPolicy, Interface

PROTOCOL = "socialiq-policy"
VERSION = 1

_GREETING = 4_096  # bytes of an answer to the first line
_SHORTEST = 0.001
_LONGEST = 3_600.0  # seconds
_MOST_MEMORY = 2**20 * 1024**3  # bytes
_ANSWER, _PER_ROW = 4_096, 32  # bytes of any other: for all, and for each observation
_CHUNK = 65_536
_LAUNCHERS = Path(__file__).with_name("launchers.py")

_ACTIONS, _SIZE = "actions", "action_size"
"""Field of a greeting with the number of discrete actions, or the length of a continuous one."""

GIB = 1024**3
LEAST_MEMORY = GIB // 4
"""Bytes; an interpreter does not start with less."""


class Limits(NamedTuple):
    """Time and memory of a process."""

    start: float = 30.0  # seconds from its start to its first answer
    step: float = 5.0  # seconds for each batch of observations
    # bytes of address space of each of its processes; 0 for any amount. A network of torch or JAX
    # reserves several GiB that it never uses
    memory: int = 8 * GIB

    def check(self) -> None:
        """Raise `UserError` if a number is out of range."""
        if not all(_SHORTEST <= seconds <= _LONGEST for seconds in (self.start, self.step)):
            raise UserError(
                f"seconds for an answer must be at least {_SHORTEST:g} and at most {_LONGEST:g}"
            )
        if self.memory and not LEAST_MEMORY <= self.memory <= _MOST_MEMORY:
            raise UserError(
                f"memory must be from {LEAST_MEMORY / GIB:g} to {_MOST_MEMORY // GIB} GiB, or 0 "
                "for any amount"
            )


def limits_of(step_seconds: float, memory_gib: float) -> Limits:
    """Return limits in the units of the command line; `UserError` if one is out of range."""
    if not 0.0 <= memory_gib <= _MOST_MEMORY / GIB:
        raise UserError(f"memory in GiB must be at least 0, got {memory_gib:g}")
    limits = Limits(step=step_seconds, memory=round(memory_gib * GIB))
    limits.check()
    return limits


class Child:
    """A running command, called `source` in messages. It has the rights of its caller.

    Each process may have `memory` bytes of address space; 0 sets no limit.
    """

    def __init__(self, command: Sequence[str], source: str, memory: int = 0) -> None:
        if os.name != "posix":
            raise UserError(
                "a policy in a separate process needs Linux or macOS: export it to ONNX"
            )
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
        self._in, self._out = self._process.stdin.fileno(), self._process.stdout.fileno()
        self._err = self._process.stderr.fileno()
        for stream in (self._in, self._out, self._err):
            os.set_blocking(stream, False)

    def exchange(self, line: bytes, seconds: float, most: int) -> bytes:
        """Send a line and wait for the one that answers it, of at most `most` bytes.

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
        """Send a message and return its answer, a JSON object; any other ends the child."""
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


def start_process(
    command: Sequence[str], source: str, world: Interface, limits: Limits
) -> tuple[BatchPolicy, dict[str, Any], Child]:
    """Start a policy's process and exchange the first message; no shell is used.

    Returns the policy, its own details, and the process, which must be closed. `UserError` if it
    can't be started, doesn't speak the protocol, or is made for another world.
    """
    limits.check()
    child = Child(command, source, limits.memory)
    kind = {_SIZE: world.action_size} if world.action_size else {_ACTIONS: world.n_actions}
    greeting = {"protocol": PROTOCOL, "version": VERSION, "features": world.n_features, **kind}
    answer = child.request(greeting, limits.start, _GREETING)
    if (answer.get("protocol"), answer.get("version")) != (PROTOCOL, VERSION):
        raise child.failure(f"does not speak {PROTOCOL} version {VERSION}")
    features, sizes = answer.get("features"), [answer.get(name) for name in (_ACTIONS, _SIZE)]
    if type(features) is not int or [type(size) for size in sizes if size is not None] != [int]:
        raise child.failure(
            f"does not give its numbers of features and {_ACTIONS}, or {_SIZE} if they are "
            "continuous"
        )
    interface = Interface(features, sizes[0] or 0, sizes[1] or 0)
    try:
        interface.check(source, world)
    except UserError:
        child.close()
        raise
    conversation = _Conversation(child, limits.step, interface.action_size)
    details = {"name": one_line(str(answer.get("name", ""))), **limits._asdict()}
    return BatchPolicy(source, interface, conversation.decide), details, child


def command_of(command_line: str) -> list[str]:
    """Split a command line into program and arguments."""
    try:
        command = shlex.split(command_line)
    except ValueError as error:
        raise UserError(f"cannot read the command {one_line(command_line)}: {error}") from error
    if not command or not shutil.which(command[0]):
        name = one_line(command[0]) if command else ""
        raise UserError(f"no such program: '{name}'; name one after 'process:'")
    return command


class _Conversation:
    """Exchange of observations and actions; each answer has the number of its request."""

    def __init__(self, child: Child, seconds: float, size: int) -> None:
        self._child, self._seconds, self._number, self._size = child, seconds, 0, size

    def decide(
        self, batch: Float32[np.ndarray, "batch feature"], deterministic: bool
    ) -> np.ndarray:
        """Request the actions of a batch; any answer but these ends the process."""
        self._number += 1
        request = {"id": self._number, "deterministic": deterministic}
        request["observations"] = batch.tolist()
        most = _ANSWER + _PER_ROW * len(batch) * max(self._size, 1)
        answer = self._child.request(request, self._seconds, most)
        if answer.get("id") != self._number:
            raise self._child.failure(f"did not name the request {self._number} that it answers")
        actions: Any = answer.get("actions")
        if self._size:  # `Interface.checked` counts the lists
            lists = isinstance(actions, list) and all(isinstance(row, list) for row in actions)
            if not lists or any(len(row) != self._size for row in actions):
                raise self._child.failure(
                    f"answered actions that are no list of {self._size} number(s) for each "
                    "observation"
                )
            for number in itertools.chain.from_iterable(actions):
                if type(number) not in (int, float):
                    raise self._child.failure(
                        f"answered {one_line(json.dumps(number), 40)} in an action: each must be a "
                        "number"
                    )
                if not abs(number) <= 1.0:  # NaN too
                    raise self._child.failure(
                        f"answered {one_line(str(number), 40)} in an action: continuous ones must "
                        "be in [-1, 1], the ends being the bounds of the action space"
                    )
            return np.array(actions, np.float64).reshape(-1, self._size)
        if not isinstance(actions, list) or any(type(action) is not int for action in actions):
            raise self._child.failure("answered actions that are not a list of integers")
        if any(abs(action) >= 2**31 for action in actions):
            raise self._child.failure("answered an action of more than 32 bits")
        return np.array(actions, np.int64)
