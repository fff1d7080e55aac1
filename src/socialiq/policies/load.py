"""Loading of policies of any kind: `load_policy` returns a `Policy` and a record of its origin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.foreign import one_line
from socialiq.policies.callable import read_callable
from socialiq.policies.interface import Interface
from socialiq.policies.native import read_dial, read_policy, read_table
from socialiq.policies.onnx.load import read_onnx
from socialiq.policies.process.load import Limits, command_of, hash_of_command, start_process
from socialiq.policies.record import Loaded, Record, read_content, sha256_of
from socialiq.policies.sb3.load import read_sb3
from socialiq.storage import kind_of
from socialiq.types import Policy

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
    allow_code: bool = False,
    limits: Limits | None = None,
) -> Loaded:
    """Load a policy from a file, a command or a Python module, for a world.

    Args:
        spec: One of `KINDS`. A .safetensors is a file of this package (a policy, a dial or a
            table), a .zip one of Stable-Baselines3. A command is run, and a Python module imported.
        n_features: Length of the world's observations.
        n_actions: Number of the world's actions.
        angle: Angle of a dial, in degrees.
        allow_code: Whether a Python module may be imported, which runs its author's code with
            your rights.
        limits: Time and memory of a process.

    Returns:
        The policy and its record. Close it, or use it as a context manager: a process runs
            until then.

    Raises:
        UserError: If the policy cannot be read, is ambiguous, or does not fit the world.
    """
    world, source = Interface(n_features, n_actions), one_line(spec)
    head, colon, rest = spec.partition(":")
    if colon and head == "process":
        return _process(rest.strip(), source, world, limits or Limits())
    if colon and head == "python":
        return _callable(rest, source, world, allow_code)
    path, suffix = Path(spec), Path(spec).suffix.lower()
    if suffix not in _SUFFIXES:
        raise UserError(f"unknown kind of policy '{source}': name one of {', '.join(KINDS)}")
    content = read_content(path)
    if suffix == ".safetensors":
        kind, (policy, details) = _native(path, world, angle)
        if read_content(path) != content:
            raise UserError(f"{source} changed while it was read: audit a file that stays as it is")
    else:
        kind, read = ("sb3", read_sb3) if suffix == ".zip" else ("onnx", read_onnx)
        policy, details = read(content, source, world)
    soft = isinstance(policy, SoftPolicy)
    sha256 = sha256_of(content)
    return Loaded(policy, Record(kind, source, sha256, "the file's bytes", world, soft, details))


def _native(
    path: Path, world: Interface, angle: float | None
) -> tuple[str, tuple[Policy, dict[str, Any]]]:
    """Read a file of this package; return its kind, the policy and details."""
    kind = kind_of(path)
    if kind == "dial":
        return kind, read_dial(path, angle, world)
    return kind, (read_table if kind == "table" else read_policy)(path, world)


def _process(command_line: str, source: str, world: Interface, limits: Limits) -> Loaded:
    sha256 = hash_of_command(command_of(command_line))
    policy, details, child = start_process(command_line, source, world, limits)
    covers = "the command's words and the files that they name"
    record = Record("process", source, sha256, covers, world, False, details)
    return Loaded(policy, record, child.close)


def _callable(name: str, source: str, world: Interface, allowed: bool) -> Loaded:
    if not allowed:
        raise UserError(
            f"{source} would run its author's code with your rights: allow that, or audit it as "
            "ONNX or in a separate process"
        )
    policy, text = read_callable(name, source, world)
    covers = "the module's source, not what it imports"
    return Loaded(policy, Record("python", source, sha256_of(text), covers, world, False))
