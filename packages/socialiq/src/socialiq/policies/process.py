"""Policies in a separate process, in any language, over JSON lines (docs/policies.md); POSIX."""

from __future__ import annotations

import itertools
import json
import os
import shlex
import shutil
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32

from socialiq.child import Child
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies.interface import BatchPolicy, Interface

PROTOCOL = "socialiq-policy"
VERSION = 1

_GREETING = 4_096  # bytes of an answer to the first line
_SHORTEST = 0.001  # seconds
_LONGEST = 3_600.0  # seconds
_MOST_MEMORY = 2**20 * 1024**3  # bytes
_ANSWER = 4_096  # bytes of any other answer
_PER_ROW = 32  # bytes that each observation adds to it

_ACTIONS = "actions"
_SIZE = "action_size"
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
    """Return limits in the units of the command line.

    Args:
        step_seconds: Seconds for each batch of observations.
        memory_gib: Address space of each process, in GiB; 0 for any amount.

    Raises:
        UserError: If a number is out of range.
    """
    if not 0.0 <= memory_gib <= _MOST_MEMORY / GIB:
        raise UserError(f"memory in GiB must be at least 0, got {memory_gib:g}")
    limits = Limits(step=step_seconds, memory=round(memory_gib * GIB))
    limits.check()
    return limits


def start_process(
    command: Sequence[str], source: str, world: Interface, limits: Limits
) -> tuple[BatchPolicy, dict[str, Any], Child]:
    """Start a policy's process and exchange the first message; no shell is used.

    Args:
        command: Words of the command.
        source: Name of the policy in messages.
        world: Interface of the world.
        limits: Time and memory of the process.

    Returns:
        The policy, details that the process gives, and the process, which must be closed.

    Raises:
        UserError: If it can't be started, doesn't speak the protocol, or is made for another world.
    """
    if os.name != "posix":
        raise UserError("a policy in a separate process needs Linux or macOS: export it to ONNX")
    limits.check()
    child = Child(command, source, limits.memory)
    kind = {_SIZE: world.action_size} if world.action_size else {_ACTIONS: world.n_actions}
    greeting = {"protocol": PROTOCOL, "version": VERSION, "features": world.n_features, **kind}
    answer = child.request(greeting, limits.start, _GREETING)
    if (answer.get("protocol"), answer.get("version")) != (PROTOCOL, VERSION):
        raise child.failure(f"does not speak {PROTOCOL} version {VERSION}")
    features = answer.get("features")
    sizes = [answer.get(name) for name in (_ACTIONS, _SIZE)]
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
        self._child = child
        self._seconds = seconds
        self._number = 0
        self._size = size

    def decide(
        self, batch: Float32[np.ndarray, "batch feature"], deterministic: bool
    ) -> np.ndarray:
        """Request the actions of a batch; any answer but these ends the process.

        Args:
            batch: The observations.
            deterministic: Whether the policy must not draw its actions.

        Returns:
            int64 (batch,); for continuous actions float64 (batch, size).

        Raises:
            UserError: If the answer has another form.
        """
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
