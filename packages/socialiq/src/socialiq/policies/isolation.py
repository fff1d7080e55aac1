"""Isolation of foreign code with bubblewrap: the command line of its sandbox.

A sandboxed process has its own processes, network, interprocess communication, host name and files.
It sees the system's programs and libraries, the folder of its interpreter, and what its hash
covers, all read-only; two small folders in memory are writable. Its environment is empty. Nothing
that it starts outlives it.
"""

from __future__ import annotations

import functools
import os
import secrets
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line

IsolationMode = Literal["auto", "required", "none"]
"""Isolation that is asked for: where it is possible, always, or never."""

PROCESSES = 1_024
"""Largest number of processes and threads; libraries start one thread for each core."""

DISK = 256 * 1024 * 1024
"""Bytes of each writable folder, and of a file."""

NONE = "none"

_PROGRAM = "bwrap"
_LAUNCHERS = Path(__file__).with_name("launchers.py")
_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")
_SETTINGS = ("/etc/ld.so.cache", "/etc/alternatives", "/etc/localtime")
_WRITABLE = ("/tmp", "/dev/shm")
_ENVIRONMENT = {
    "PATH": "/usr/local/bin:/usr/bin:/bin",
    "HOME": "/tmp",
    "USER": "policy",
    "LANG": "C.UTF-8",
}
_SECONDS = 20  # of the trial


class Isolation(NamedTuple):
    """Isolation of a process.

    Attributes:
        kind: Program and version, for instance "bubblewrap 0.8.0", "none" or "not needed".
        why: Reason why there is none.
    """

    kind: str
    why: str = ""

    @property
    def works(self) -> bool:
        """Whether the process is isolated."""
        return self.kind != NONE


NOT_ASKED = Isolation(NONE, "it was not asked for")

NOT_NEEDED = Isolation("not needed", "no code of its author runs")


def isolation_of(mode: str) -> Isolation:
    """Return the isolation that this system has, if it is asked for.

    Raises:
        UserError: If it is required and not possible, or `mode` is not one of `IsolationMode`.
    """
    one_of("isolation", mode, get_args(IsolationMode))
    if mode == NONE:
        return NOT_ASKED
    program = shutil.which(_PROGRAM)
    isolation = _tried(program) if program else Isolation(NONE, "bubblewrap is not installed")
    if mode == "required" and not isolation.works:
        raise UserError(f"isolation is required, but {isolation.why}: install bubblewrap (Linux)")
    return isolation


class CodeHash(NamedTuple):
    """Hash of a policy's code, and what it covers.

    Attributes:
        sha256: SHA-256 over words, paths and contents.
        covers: Description for people.
        paths: The named files and folders, absolute.
        caches: Folders below them that are not covered.
    """

    sha256: str
    covers: str
    paths: tuple[Path, ...]
    caches: tuple[Path, ...]


NO_FILES = CodeHash("", "", (), ())


@functools.cache
def _tried(program: str) -> Isolation:
    """Start an empty sandbox once: a system can have the program and forbid its use."""
    command = sandboxed([sys.executable, "-I", "-S", "-c", "pass"], NO_FILES, program)
    try:
        version = subprocess.run([program, "--version"], capture_output=True, timeout=_SECONDS)
        trial = subprocess.run(command, capture_output=True, timeout=_SECONDS)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Isolation(NONE, f"bubblewrap does not start: {one_line(str(error))}")
    if trial.returncode:
        message = one_line(trial.stderr.strip().rsplit(b"\n", 1)[-1])
        return Isolation(NONE, f"bubblewrap makes no sandbox here: {message}")
    return Isolation(one_line(version.stdout.strip()))


def sandboxed(
    command: Sequence[str],
    covered: CodeHash,
    program: str = _PROGRAM,
    folders: Iterable[Path] = (),
) -> list[str]:
    """Return the command that runs a command in a sandbox.

    The user root of the system runs it as a user without rights, of a number that no other has;
    any other user in a namespace of its own. In both the number of processes is limited (the
    latter from Linux 5.14 on).

    Args:
        command: Program and arguments; its program is found outside of the sandbox.
        covered: Files and folders that it sees, at their paths.
        program: Path of bubblewrap.
        folders: Further folders that it sees.

    Raises:
        UserError: If the user without rights could not read a file, or the program is a version
            manager's shim, which needs files of the manager.
    """
    first = Path(shutil.which(command[0]) or command[0]).absolute()
    if first.parent.name == "shims":
        raise UserError(
            f"{one_line(str(first))} is a shim of a version manager, and a sandbox has no manager: "
            f"name the program itself (pyenv which {one_line(first.name)})"
        )
    here = Path.cwd()
    root = os.geteuid() == 0
    for path in covered.paths if root else ():
        mode, needed = path.stat().st_mode, 0o5 if path.is_dir() else 0o4
        if mode & needed != needed:
            raise UserError(
                f"{one_line(str(path))} is closed to other users, and root runs a policy as one: "
                "open it with chmod a+rX"
            )
    interpreters = (*_interpreters(first), *_interpreters(Path(sys.executable)))
    user = 2_000_000_000 + secrets.randbelow(100_000_000) if root else -1
    return [
        program,
        *(_AS_ROOT if root else ("--unshare-all", "--cap-drop", "ALL")),
        *("--die-with-parent", "--new-session", "--clearenv"),
        *(word for pair in _ENVIRONMENT.items() for word in ("--setenv", *pair)),
        *_system(),
        *("--proc", "/proc", "--dev", "/dev"),
        *(word for path in _WRITABLE for word in _memory(path)),
        *_bound((*interpreters, *folders, *covered.paths), here),
        *(word for cache in covered.caches for word in _memory(str(cache))),
        *("--ro-bind", str(_LAUNCHERS), "/launchers.py", "--chdir", str(here)),
        *("--remount-ro", "/dev", "--remount-ro", "/"),
        *(os.path.realpath(sys.executable), "-I", "-S", "/launchers.py", "enter"),
        *(str(user), str(PROCESSES), str(DISK), str(first), *command[1:]),
    ]


_AS_ROOT = (
    *("--unshare-pid", "--unshare-net", "--unshare-ipc", "--unshare-uts", "--unshare-cgroup-try"),
    # These two change the user and are lost with it.
    *("--cap-drop", "ALL", "--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID"),
)


def _system() -> Iterator[str]:
    """Return the arguments for the system's programs and libraries."""
    for path in map(Path, _SYSTEM):
        if path.is_symlink():
            yield from ("--symlink", str(path.readlink()), str(path))
        elif path.is_dir():
            yield from ("--ro-bind", str(path), str(path))
    for name in _SETTINGS:
        yield from ("--ro-bind-try", name, name)


def _memory(path: str) -> tuple[str, ...]:
    return ("--perms", "1777", "--size", str(DISK), "--tmpfs", path)


def _interpreters(program: Path) -> Iterator[Path]:
    """Return the folders of a Python that a program is, those of its virtual environment first."""
    for path in (program, program.resolve()):
        folder = path.parent.parent
        if folder in (Path("/"), Path.home()):
            continue
        if (folder / "pyvenv.cfg").is_file() or any(folder.glob("lib/python3*/os.py")):
            yield folder


def _bound(paths: Iterable[Path], here: Path) -> Iterator[str]:
    """Return the arguments for files and folders at their paths, outer ones first."""
    visible = [Path(name) for name in _SYSTEM]
    folders, arguments = {here, *here.parents}, []
    for path in sorted(set(paths)):
        if not any(path.is_relative_to(outer) for outer in visible):
            visible.append(path)
            folders.update(path.parents)
            arguments += ["--ro-bind", os.path.realpath(path), str(path)]
    # The folders in memory have their mode already; what is read-only has its folders.
    for folder in sorted(folders - set(map(Path, ("/", "/dev", "/proc", *_WRITABLE)))):
        if not any(folder.is_relative_to(outer) for outer in visible):
            yield from ("--perms", "0755", "--dir", str(folder))
    yield from arguments
