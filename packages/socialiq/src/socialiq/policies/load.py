"""Loading of policies of any kind: `load_policy` returns a `Policy` and a record of its origin."""

import contextlib
import inspect
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import isolation as code
from socialiq.child import Child
from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.foreign import FAILURES, failure, imported, one_line
from socialiq.isolation import NOT_ASKED, Isolation
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_policy import Dial
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.saved import FORMS, Header, Saved, refusal
from socialiq.policies.interface import (
    BatchPolicy,
    Interface,
    Loaded,
    Record,
    read_content,
)
from socialiq.policies.onnx_data import DATA_FILES
from socialiq.policies.onnx_load import read_onnx
from socialiq.policies.process import Limits, command_of, start_process
from socialiq.policies.sb3_load import interface_of, read_sb3, statistics_near
from socialiq.reading import path_of, sha256_of
from socialiq.storage import content_hash, kind_of, load_arrays, shipped
from socialiq.types import OBSERVATION, ROWS, Policy
from socialiq.worlds.highway.observation import ROUTE
from socialiq.worlds.situation import ContextPolicy

KINDS = ("FILE.safetensors", "FILE.zip", "FILE.onnx", "process:COMMAND LINE", "python:FILE.py:NAME")
"""Forms of a policy specification."""

_PROGRAMS = ("process:", "python:")
MOST_HEADER = 65_536  # characters of a file's header, which goes into reports


def load_policy(
    spec: str | Path | Saved | Policy | Loaded,
    n_features: int | None = None,
    n_actions: int | None = None,
    *,
    angle: float | None = None,
    action_size: int = 0,
    allow_code: bool = False,
    limits: Limits | None = None,
    isolation: Isolation | None = None,
    files: Sequence[str] = (),
    clock: bool = False,
    narrow: Sequence[int] = (),
    class_angle: float | None = None,
    schema: str = "",
) -> Loaded:
    """Load a policy from a file, a command or a Python module, for a world.

    Args:
        spec: One of `KINDS`: a .safetensors is ours, a .zip of Stable-Baselines3; or an object, a
            policy or dial of this package or anything with `predict`.
        n_features: Length of the world's observations; None for that of the file.
        n_actions: Number of the world's actions, 0 if they are continuous; None for the file's.
        angle: Angle of a dial, in degrees.
        action_size: Length of a continuous action; 0 if they are discrete, or the file's number
            counts because `n_actions` is None.
        allow_code: Whether a Python module may be imported, which runs its author's code with
            your rights. An isolated one needs no such permission.
        limits: Time and memory of a process.
        isolation: Result of `isolation_of`; a Python module then runs in a separate process.
            None: a module runs in this process, and a command is not isolated.
        files: Further files and folders of a command or module, which its hash covers; an
            isolated one sees no others.
        clock: Whether a file of this package may take the time as a further feature.
        narrow: Lengths of observations that such a file may take instead.
        class_angle: Class angle of a dial of two angles, in degrees.
        schema: Schema of the world's observations, as `World.schema`; "" for any.

    Returns:
        The policy and its record, a context manager: a process runs until it is closed.

    Raises:
        UserError: If the policy cannot be read, is ambiguous, or does not fit the world.
    """
    if isinstance(spec, Loaded):  # its process is ended where it was loaded
        return replace(spec, close=lambda: None)
    if n_features is None or n_actions is None:
        own = _own_interface(spec, angle, class_angle)
        n_features = own.n_features if n_features is None else n_features
        action_size = own.action_size if n_actions is None else action_size
        n_actions = own.n_actions if n_actions is None else n_actions
    world = Interface(n_features, n_actions, action_size, schema)
    lengths = dict.fromkeys((n_features, *narrow))
    fitting = [length + time for length in lengths for time in range(1 + clock)]
    if isinstance(spec, Saved | Policy):
        return _of_object(spec, world, fitting, angle, class_angle)
    spec = spec if isinstance(spec, str) else str(path_of(spec))
    source = one_line(spec)
    if spec.startswith(_PROGRAMS):
        return _load_code(spec, world, allow_code, limits or Limits(), isolation, files)
    if files:
        raise UserError(f"{source} is one file: leave --files out, of a process or Python")
    return _load_file(spec, world, fitting, angle, class_angle)


def _own_interface(spec: str | Path | Saved | Policy, *angles: float | None) -> Interface:
    """Return the sizes that a file or an object names itself; `UserError` if it names none."""
    policy = spec
    if isinstance(spec, str | Path):
        path = path_of(spec)
        suffix = path.suffix.lower()
        if suffix == ".zip":
            return interface_of(read_content(path), str(path))
        if suffix == ".onnx":
            return read_onnx(read_content(path), str(path), None, shipped(path).parent)[0].interface
        if suffix == ".safetensors":
            policy = read_native(path, None, *angles)[0]
        elif not str(spec).startswith(_PROGRAMS):
            raise _unknown(str(spec))
    sizes = (getattr(policy, name, None) for name in ("n_features", "n_actions", "action_size"))
    n_features, n_actions, action_size = sizes
    if n_features is None or n_actions is None:
        raise UserError(f"{name_of(spec)} names no sizes: give n_features and n_actions")
    return Interface(n_features, n_actions, action_size or 0)


def _unknown(spec: str) -> UserError:
    return UserError(f"unknown kind of policy '{one_line(spec)}': name one of {', '.join(KINDS)}")


def name_of(policy: Any) -> str:
    """Return the text of a driver, or a name for an object."""
    if isinstance(policy, str | Path):
        return str(policy)
    if isinstance(policy, Loaded):
        return policy.record.source
    return repr(policy) if isinstance(policy, Saved) else type(policy).__name__


def _of_object(
    policy: Saved | Policy, world: Interface, fitting: Sequence[int], *angles: float | None
) -> Loaded:
    """Return a policy that is no file, with its record."""
    source = name_of(policy)
    if not isinstance(policy, Saved):
        soft = isinstance(policy, SoftPolicy)
        return Loaded(policy, Record("python", source, "", "nothing", world, soft))
    arrays, header = policy.content()

    def read(world: Interface) -> tuple[Any, dict[str, Any]]:
        return _described(policy, header, source, world, *angles)

    sha256 = content_hash(arrays, header)
    chosen, details = _read_fitting(read, () if policy.KIND == "table" else fitting, world)
    world = world._replace(n_features=getattr(chosen, "n_features", world.n_features))
    soft = isinstance(chosen, SoftPolicy)
    record = Record(policy.KIND, source, sha256, "the object's content", world, soft, details)
    return Loaded(chosen, record)


def _load_file(
    spec: str, world: Interface, fitting: Sequence[int], *angles: float | None
) -> Loaded:
    """Load a policy from a file; one of this package may take any of some lengths of input."""
    path = Path(spec)
    source = one_line(spec)
    suffix = Path(spec).suffix.lower()
    if suffix not in (".safetensors", ".zip", ".onnx"):
        raise _unknown(spec)
    content = read_content(path)
    sha256 = sha256_of(content)
    covers = "the file's bytes"
    if suffix == ".zip":
        kind = "sb3"
        policy, details = read_sb3(content, source, world, statistics_near(path))
    elif suffix == ".onnx":
        kind = "onnx"
        policy, details, sha256 = read_onnx(content, source, world, shipped(path).parent)
        covers = ", and those of ".join([covers, *details.get(DATA_FILES, ())])
    else:
        kind = kind_of(path)

        def read(world: Interface) -> tuple[Any, dict[str, Any]]:
            return read_native(path, world, *angles)

        policy, details = _read_fitting(read, () if kind == "table" else fitting, world)
        world = world._replace(n_features=getattr(policy, "n_features", world.n_features))
        if read_content(path) != content:
            raise UserError(f"{source} changed while it was read: audit a file that stays as it is")
    soft = isinstance(policy, SoftPolicy)
    return Loaded(policy, Record(kind, source, sha256, covers, world, soft, details))


def _read_fitting(
    read: Callable[[Interface], tuple[Any, dict[str, Any]]],
    fitting: Sequence[int],
    world: Interface,
) -> tuple[Any, dict[str, Any]]:
    """Read a policy of this package, which may take any of some lengths of input."""
    try:
        return read(world)
    except UserError:
        for length in fitting:
            with contextlib.suppress(UserError):
                return read(world._replace(n_features=length))
        raise


def read_native(
    path: Path,
    world: Interface | None,
    angle: float | None = None,
    class_angle: float | None = None,
) -> tuple[Any, dict[str, Any]]:
    """Read a file of this package, of any kind in `nn.saved.FORMS`, and details from it.

    Args:
        path: The file.
        world: Interface that the policy must have; None for any.
        angle: Angle of a dial, in degrees.
        class_angle: Class angle of a dial of two angles, in degrees.

    Returns:
        The policy (of a dial its policy at the angle), and details for its record.

    Raises:
        UserError: If the file can't be read, a dial has no angle, or the policy does not fit the
            world.
    """
    form = FORMS.get(kind_of(path), QPolicy)
    arrays, header = load_arrays(path, form.KIND, form.VERSIONS)
    if len(json.dumps(header)) > MOST_HEADER:
        raise refusal(path, f"has a header of more than {MOST_HEADER:,} characters")
    policy = form.checked(path, arrays, header)
    return _described(policy, header, str(path), world, angle, class_angle)


def _described(
    policy: Any,
    header: Header,
    source: str,
    world: Interface | None,
    angle: float | None = None,
    class_angle: float | None = None,
) -> tuple[Any, dict[str, Any]]:
    """Return a policy of this package, a dial's at an angle, and details from its header."""
    is_dial = isinstance(policy, (Dial, ClassDial))
    if is_dial and angle is None:
        raise UserError(f"{source} is a dial: name an angle")
    if isinstance(policy, ClassDial):
        if class_angle is None:
            raise UserError(
                f"{source} is a dial of two angles: name a world of a class angle, or turn it "
                "first with `socialiq turn --class-angle`"
            )
        policy = policy.of_class(class_angle)
    # Before the sizes: `_read_fitting` tries several, and says what is wrong with the first.
    at_angle = policy.at(angle) if is_dial else None
    if world is not None:
        size = getattr(policy, "action_size", 0)
        schema = getattr(policy, "provenance", {}).get(OBSERVATION, ROWS)
        if schema not in (ROWS, ROUTE):
            named = one_line(str(schema), 80)
            raise UserError(
                f"{source} takes observations of the schema {named}, which this version does not "
                f"know: name a policy of {ROWS} or {ROUTE}"
            )
        Interface(policy.n_features, policy.n_actions, size, schema).check(source, world)
    if is_dial:
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
    if policy.KIND == "table":
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


def _load_code(
    spec: str,
    world: Interface,
    allow_code: bool,
    limits: Limits,
    isolation: Isolation | None,
    files: Sequence[str],
) -> Loaded:
    """Hash the files of a command or a Python module, and start it as a process."""
    source = one_line(spec)
    kind, _, words = spec.partition(":")
    is_python = kind == "python"
    if is_python and (isolation is None or not isolation.works) and not allow_code:
        raise UserError(
            f"{source} would run its author's code with your rights: allow that with --allow-code "
            "(allow_code=True), or audit it as ONNX or isolated by bubblewrap"
        )
    if is_python and isolation is None:
        policy, text = _read_callable(words, source, world)
        covers = "the module's source, not what it imports"
        record = Record("python", source, sha256_of(text), covers, world, False, {}, NOT_ASKED)
        return Loaded(policy, record)
    isolation = isolation or NOT_ASKED
    command = command_of_python(words, source) if is_python else command_of(words.strip())

    def hashed(copies: Path | None) -> code.CodeHash:
        if is_python:
            return hash_of_python(words, source, files, copies)
        return code.hash_files(command, code.files_named_by(command, files), copies)

    def check_unchanged() -> None:
        if hashed(None).sha256 != covered.sha256:
            raise UserError(
                f"{source} changed while it was audited: audit files that stay as they are"
            )

    def start() -> tuple[BatchPolicy, dict[str, Any], Child]:
        started = command
        if isolation.works:
            started = code.sandboxed(command, covered, library=is_python and allow_code)
        elif is_python:
            started = command_of_python(words, source, covered.paths)
        return start_process(started, source, world, limits)

    with contextlib.ExitStack() as closing:
        # What runs is a copy of exactly the hashed bytes, where it can be put in their place.
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory(prefix="policy-")))
        covered = hashed(folder if isolation.works or is_python else None)
        process = closing.enter_context(contextlib.closing(_Process(start)))
        facts = (kind, source, covered.sha256, covered.covers, world, False, process.details)
        record = Record(*facts, isolation)
        policy = replace(process.policy, decide=process.decide)
        return Loaded(policy, record, closing.pop_all().close, check_unchanged, process.restart)


class _Process:
    """The process of a policy that is code: one at a time, so that no two of them can talk."""

    def __init__(self, start: Callable[[], tuple[BatchPolicy, dict[str, Any], Child]]) -> None:
        self._start = start
        self.policy, self.details, self._child = start()

    def decide(self, batch: np.ndarray, deterministic: bool) -> Any:
        """Return the actions of the present process."""
        return self.policy.decide(batch, deterministic)

    def restart(self) -> None:
        """End the process, and then start a new one."""
        self.close()
        self.policy, _, self._child = self._start()

    def close(self) -> None:
        """End the process."""
        self._child.close()


def hash_of_python(
    name: str, source: str, files: Sequence[str], copies: Path | None = None
) -> code.CodeHash:
    """Hash (`isolation.hash_files`) the module's file, or its whole top-level package.

    Args:
        name: `MODULE:ATTRIBUTE` or `FILE.py:ATTRIBUTE`.
        source: Name of the policy in messages.
        files: Further files and folders that the hash covers.
        copies: Folder for copies of the hashed files; None for no copies.

    Raises:
        UserError: If the name has another form, or a file or the module doesn't exist.
    """
    module, attribute = _split(name, source)
    # A file's name, not its path: the same policy in another folder has the same hash.
    words = ["python", Path(module).name, attribute]
    if module.endswith(".py"):
        if not Path(module).is_file():
            raise UserError(f"no such file: {one_line(module)}")
        labelled = [(words[1], Path(module)), *code.further_files(files)]
        return code.hash_files(words, labelled, copies)
    top = module.partition(".")[0]
    # This finder looks at names of files only; `find_spec` of a submodule would import its package.
    spec = PathFinder.find_spec(top) if top.isidentifier() else None
    if spec is None:
        raise UserError(
            f"no such module: {one_line(module)}; name the path of its file, ending in .py"
        )
    paths = list(spec.submodule_search_locations or ()) or [str(spec.origin)]
    entries = [(top, Path(path)) for path in paths]
    return code.hash_files(words, [*entries, *code.further_files(files)], copies)


def _split(name: str, source: str) -> tuple[str, str]:
    """Return module and attribute of `MODULE:ATTRIBUTE`; `UserError` for another form."""
    module, _, attribute = name.rpartition(":")
    if not module or not attribute.isidentifier():
        raise UserError(
            f"{source} is not MODULE:ATTRIBUTE: write for instance mine.policies:careful"
        )
    return module, attribute


def command_of_python(
    name: str, source: str, copies: Mapping[Path, Path] | None = None
) -> list[str]:
    """Return the command that runs a Python policy with this interpreter.

    Args:
        name: `MODULE:ATTRIBUTE` or `FILE.py:ATTRIBUTE`.
        source: Name of the policy in messages.
        copies: Copy of each file or folder, which is run in its place; None to run the originals.

    Raises:
        UserError: If the name has another form.
    """
    copies = copies or {}
    module, attribute = _split(name, source)
    if module.endswith(".py"):
        path = Path(module).absolute()
        module = json.dumps([str(copies.get(path, path)), str(path)])
    child = Path(__file__).with_name("python_child.py").read_text()
    folders = [path.parent for path in copies.values()]
    paths = json.dumps([str(Path(path).absolute()) for path in (*folders, *sys.path)])
    return [sys.executable, "-I", "-B", "-c", child, module, attribute, paths]


def _read_callable(name: str, source: str, world: Interface) -> tuple[BatchPolicy, bytes]:
    """Load the policy `MODULE:ATTRIBUTE` (docs/policies.md), and return its module's source too."""
    module_name, attribute = _split(name, source)
    try:
        if module_name.endswith(".py"):
            read_content(Path(module_name))
        module = imported(module_name)
        policy: Any = getattr(module, attribute)
        policy = policy() if inspect.isclass(policy) else policy
        text = read_content(Path(module.__file__ or ""))
    except UserError:
        raise
    except FAILURES as error:
        raise failure(source, error) from error
    if not callable(getattr(policy, "predict", policy)):
        raise UserError(f"{source} is not a policy: it must be a function or have `predict`")

    def decide(batch: Any, deterministic: bool) -> Any:
        try:
            if hasattr(policy, "predict"):
                return policy.predict(batch, deterministic=deterministic)[0]
            return policy(batch)
        except FAILURES as error:
            raise failure(source, error) from error

    return BatchPolicy(source, world, decide), text
