"""Loading of policies of any kind: `load_policy` returns a `Policy` and a record of its origin."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.foreign import one_line
from socialiq.nn.dial_policy import Dial
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.saved import FORMS, Header, refusal
from socialiq.policies.code import (
    OWN_FOLDER,
    command_of_python,
    files_named_by,
    hash_files,
    hash_of_python,
    read_callable,
)
from socialiq.policies.interface import Interface, Loaded, Record, read_content, sha256_of
from socialiq.policies.isolation import NOT_ASKED, CodeHash, Isolation, sandboxed
from socialiq.policies.onnx_load import read_onnx
from socialiq.policies.process import Limits, command_of, start_process
from socialiq.policies.sb3_load import read_sb3
from socialiq.storage import kind_of, load_arrays
from socialiq.types import Policy
from socialiq.worlds.situation import ContextPolicy

KINDS = (
    "FILE.safetensors",
    "FILE.zip",
    "FILE.onnx",
    "process:COMMAND LINE",
    "python:MODULE:ATTRIBUTE",
)
"""Forms of a policy specification."""

MOST_HEADER = 65_536
"""Characters of a file's header, which goes into reports."""


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
    head, colon, words = spec.partition(":")
    if colon and head == "process":
        command = command_of(words.strip())
        code = _Code(source, command, lambda: hash_files(command, files_named_by(command, files)))
        return code.started(world, limits or Limits(), isolation or NOT_ASKED)
    if colon and head == "python":
        if (isolation is None or not isolation.works) and not allow_code:
            raise UserError(
                f"{source} would run its author's code with your rights: allow that, or audit it "
                "as ONNX or isolated by bubblewrap"
            )
        if isolation is None:
            policy, text = read_callable(words, source, world)
            covers = "the module's source, not what it imports"
            record = Record("python", source, sha256_of(text), covers, world, False, {}, NOT_ASKED)
            return Loaded(policy, record)
        command = command_of_python(words, source)
        code = _Code(source, command, lambda: hash_of_python(words, source, files), (OWN_FOLDER,))
        return code.started(world, limits or Limits(), isolation)
    if files:
        raise UserError(
            f"{source} is one file: leave --files out, which are of a process or Python"
        )
    path, suffix = Path(spec), Path(spec).suffix.lower()
    if suffix not in (".safetensors", ".zip", ".onnx"):
        raise UserError(f"unknown kind of policy '{source}': name one of {', '.join(KINDS)}")
    content = read_content(path)
    if suffix == ".zip":
        kind, (policy, details) = "sb3", read_sb3(content, source, world)
    elif suffix == ".onnx":
        kind, (policy, details) = "onnx", read_onnx(content, source, world)
    else:
        kind, (policy, details) = kind_of(path), _read_with_clock(path, world, angle, clock)
        # A clock makes it one more than the world's.
        world = world._replace(n_features=getattr(policy, "n_features", n_features))
        if read_content(path) != content:
            raise UserError(f"{source} changed while it was read: audit a file that stays as it is")
    soft, sha256 = isinstance(policy, SoftPolicy), sha256_of(content)
    return Loaded(policy, Record(kind, source, sha256, "the file's bytes", world, soft, details))


def _read_with_clock(
    path: Path, world: Interface, angle: float | None, clock: bool
) -> tuple[Policy, dict[str, Any]]:
    """Read a file of this package, which may take the time too if there is a clock."""
    try:
        return read_native(path, world, angle)
    except UserError:
        if clock and kind_of(path) != "table":
            with contextlib.suppress(UserError):
                return read_native(path, world._replace(n_features=world.n_features + 1), angle)
        raise


def read_native(
    path: Path, world: Interface | None, angle: float | None = None
) -> tuple[Any, dict[str, Any]]:
    """Read a file of this package, of any kind in `nn.saved.FORMS`.

    Args:
        path: The file.
        world: The interface that it must have, if any.
        angle: Of a dial, in degrees; without use for other policies.

    Returns:
        The policy, of a dial that of the angle, and details from the file.

    Raises:
        UserError: If the file is missing, damaged, holds something else, or doesn't fit the world;
            if a dial has no angle, or was not trained for it.
    """
    form = FORMS.get(kind_of(path), QPolicy)
    arrays, header = load_arrays(path, form.KIND, form.VERSIONS)
    if issubclass(form, Dial) and angle is None:
        raise UserError(f"{path} is a dial: name an angle")
    if len(json.dumps(header)) > MOST_HEADER:
        raise refusal(path, f"has a header of more than {MOST_HEADER:,} characters")
    policy: Any = form.checked(path, arrays, header)
    if world is not None:
        size = getattr(policy, "action_size", 0)
        Interface(policy.n_features, policy.n_actions, size).check(str(path), world)
    if isinstance(policy, Dial):
        assert angle is not None
        at_angle = policy.at(angle)
        ends = {"angle": angle, "low": policy.low, "high": policy.high}
        return at_angle, _details(at_angle, header) | ends
    if isinstance(policy, ContextPolicy):
        dial = policy.dial
        ends = {"low": dial.low, "high": dial.high}
        return policy, _details(dial.turned, header) | {"rule": policy.rule.as_json()} | ends
    if isinstance(policy, EnsemblePolicy):
        pairs = zip(policy.members, header["members"], strict=True)
        return policy, {
            "content_sha256": policy.sha256,
            "temperature": policy.temperature,
            "members": [_details(member, row) for member, row in pairs],
            "provenance": header["provenance"],
        }
    if form.KIND == "table":
        return policy, {"content_sha256": policy.sha256, "world": policy.world.name}
    return policy, _details(policy, header)


def _details(network: Any, header: Header) -> dict[str, Any]:
    """Return facts about one network, discrete or continuous."""
    discrete = isinstance(network, QPolicy)
    name = "temperature" if discrete else "action_size"
    view = {"view": header.get("view") or header.get("one_hot")} if discrete else {}
    return {
        "content_sha256": network.sha256,
        "activation": network.activation,
        name: getattr(network, name),
        "layers": [network.n_features, *(len(bias) for bias in network.biases)],
        **view,
        "provenance": header["provenance"],
    }


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
