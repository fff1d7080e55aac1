"""Loading of policies of any kind: `load_policy` returns a `Policy` and a record of its origin."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.foreign import one_line
from socialiq.nn import actor_policy, ensemble
from socialiq.policies.callable import read_callable
from socialiq.policies.interface import Interface
from socialiq.policies.native import (
    read_actor,
    read_context,
    read_dial,
    read_ensemble,
    read_policy,
    read_table,
)
from socialiq.policies.onnx.load import read_onnx
from socialiq.policies.process.code_hash import CodeHash, files_named_by, hash_files
from socialiq.policies.process.isolation import NOT_ASKED, Isolation, sandboxed
from socialiq.policies.process.load import Limits, command_of, start_process
from socialiq.policies.process.python_module import (
    OWN_FOLDER,
    command_of_python,
    hash_of_python,
)
from socialiq.policies.record import Loaded, Record, read_content, sha256_of
from socialiq.policies.sb3.load import read_sb3
from socialiq.storage import kind_of
from socialiq.types import Policy
from socialiq.worlds import context_policy

KINDS = (
    "FILE.safetensors",
    "FILE.zip",
    "FILE.onnx",
    "process:COMMAND LINE",
    "python:MODULE:ATTRIBUTE",
)
"""Forms of a policy specification."""

_SUFFIXES = (".safetensors", ".zip", ".onnx")


def load_policy(
    spec: str,
    n_features: int,
    n_actions: int,
    *,
    angle: float | None = None,
    action_size: int = 0,
    allow_code: bool = False,
    limits: Limits | None = None,
    isolation: Isolation | None = None,
    files: Sequence[str] = (),
    clock: bool = False,
) -> Loaded:
    """Load a policy from a file, a command or a Python module, for a world.

    Args:
        spec: One of `KINDS`. A .safetensors is a file of this package (a policy, an
            ensemble, a dial or a table), a .zip one of Stable-Baselines3. A command is run, and a
            Python module imported.
        n_features: Length of the world's observations.
        n_actions: Number of the world's actions; 0 if they are continuous.
        angle: Angle of a dial, in degrees.
        action_size: Length of a continuous action; 0 if they are discrete.
        allow_code: Whether a Python module may be imported, which runs its author's code with
            your rights. An isolated one needs no such permission.
        limits: Time and memory of a process.
        isolation: Result of `isolation_of`; a Python module then runs in a process of its own.
            None: a module runs in this process, and a command is not isolated.
        files: Further files and folders of a command or module, which its hash covers; an
            isolated one sees no others.
        clock: Whether a file of this package may take the time as a further feature.

    Returns:
        The policy and its record. Close it, or use it as a context manager: a process runs
            until then.

    Raises:
        UserError: If the policy cannot be read, is ambiguous, or does not fit the world.
    """
    world, source = Interface(n_features, n_actions, action_size), one_line(spec)
    head, colon, rest = spec.partition(":")
    if colon and head == "process":
        command = command_of(rest.strip())
        code = _Code(source, command, lambda: hash_files(command, files_named_by(command, files)))
        return code.started(world, limits or Limits(), isolation or NOT_ASKED)
    if colon and head == "python":
        if isolation is None or not isolation.works:
            _check_allowed(source, allow_code)
        if isolation is None:
            return _callable(rest, source, world)
        command = command_of_python(rest, source)
        code = _Code(source, command, lambda: hash_of_python(rest, source, files), (OWN_FOLDER,))
        return code.started(world, limits or Limits(), isolation)
    if files:
        raise UserError(
            f"{source} is one file: leave --files out, which are of a process or Python"
        )
    path, suffix = Path(spec), Path(spec).suffix.lower()
    if suffix not in _SUFFIXES:
        raise UserError(f"unknown kind of policy '{source}': name one of {', '.join(KINDS)}")
    content = read_content(path)
    if suffix == ".safetensors":
        policy, details = _native(path, world, angle, clock)
        kind = kind_of(path)
        # A clock makes it one more than the world's.
        world = world._replace(n_features=getattr(policy, "n_features", n_features))
        if read_content(path) != content:
            raise UserError(f"{source} changed while it was read: audit a file that stays as it is")
    else:
        kind, read = ("sb3", read_sb3) if suffix == ".zip" else ("onnx", read_onnx)
        policy, details = read(content, source, world)
    soft = isinstance(policy, SoftPolicy)
    sha256 = sha256_of(content)
    return Loaded(policy, Record(kind, source, sha256, "the file's bytes", world, soft, details))


def _native(
    path: Path, world: Interface, angle: float | None, clock: bool
) -> tuple[Policy, dict[str, Any]]:
    """Read a file of this package; return the policy and details."""
    try:
        return _read(path, world, angle)
    except UserError:
        if not clock or kind_of(path) == "table":
            raise
        with contextlib.suppress(UserError):
            return _read(path, world._replace(n_features=world.n_features + 1), angle)
        raise


def _read(path: Path, world: Interface, angle: float | None) -> tuple[Policy, dict[str, Any]]:
    kind = kind_of(path)
    if kind == "dial":
        return read_dial(path, angle, world)
    if kind == ensemble.KIND:
        return read_ensemble(path, world)
    if kind == context_policy.KIND:
        return read_context(path, world)
    if kind in (actor_policy.KIND, actor_policy.DIAL_KIND):
        return read_actor(path, angle, world)
    return (read_table if kind == "table" else read_policy)(path, world)


@dataclass(frozen=True)
class _Code:
    """A command that is a policy.

    Attributes:
        source: Its name in messages, as it was specified.
        command: Program and arguments.
        hashed: Returns the hash of its files.
        folders: Folders that an isolated one sees besides.
    """

    source: str
    command: Sequence[str]
    hashed: Callable[[], CodeHash]
    folders: Sequence[Path] = ()

    def started(self, world: Interface, limits: Limits, isolation: Isolation) -> Loaded:
        """Hash its files, start it, and return it with its record."""
        covered, command = self.hashed(), self.command
        if isolation.works:
            command = sandboxed(command, covered, folders=self.folders)
        policy, details, child = start_process(command, self.source, world, limits)
        record = Record(
            kind=self.source.partition(":")[0],
            source=self.source,
            sha256=covered.sha256,
            covers=covered.covers,
            interface=world,
            soft=False,
            details=details,
            isolation=isolation,
        )
        return Loaded(policy, record, child.close, partial(self._check, covered))

    def _check(self, before: CodeHash) -> None:
        if self.hashed().sha256 != before.sha256:
            raise UserError(
                f"{self.source} changed while it was audited: audit files that stay as they are"
            )


def _check_allowed(source: str, allowed: bool) -> None:
    if not allowed:
        raise UserError(
            f"{source} would run its author's code with your rights: allow that, or audit it as "
            "ONNX or isolated by bubblewrap"
        )


def _callable(name: str, source: str, world: Interface) -> Loaded:
    policy, text = read_callable(name, source, world)
    covers = "the module's source, not what it imports"
    record = Record("python", source, sha256_of(text), covers, world, False, {}, NOT_ASKED)
    return Loaded(policy, record)
