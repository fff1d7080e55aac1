"""A policy's code: the hash of its files, and the command line of its sandbox (bubblewrap).

A sandboxed process has its own processes, network, interprocess communication, host name and files.
It sees the system's programs and libraries, the folder of the audit's interpreter without this
library, and a private copy of exactly what its hash covers, all read-only; two small folders in
memory are writable. Its environment is empty. Nothing that it starts outlives it. Calls that would
tell two sandboxes of each other by a file that both read are refused (`launchers.enter`).
"""

import functools
import hashlib
import os
import secrets
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line

IsolationMode = Literal["auto", "required", "none"]
"""Isolation that is asked for: where it is possible, always, or never."""

PROCESSES = 1_024
"""Largest number of processes and threads; libraries start one thread for each core."""

DISK = 256 * 1024 * 1024  # bytes of each writable folder, and of a file
NONE = "none"
_PROGRAM = "bwrap"
_LAUNCHERS = Path(__file__).with_name("launchers.py")
_LIBRARY = Path(__file__).parent
_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")
_SETTINGS = ("/etc/ld.so.cache", "/etc/alternatives", "/etc/localtime")
_WRITABLE = ("/tmp", "/dev/shm")
_IN_MEMORY = ("--perms", "1777", "--size", str(DISK), "--tmpfs")
_ENVIRONMENT = {"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": "/tmp", "LANG": "C.UTF-8"}
_SECONDS = 20  # of the trial
_BLOCK = 1024 * 1024  # bytes that are read at once
MOST_FILES = 100_000  # largest number of files below the named folders

CACHE = "__pycache__"
"""Folders with this name are derived from the sources beside them, and are not covered."""


class CodeHash(NamedTuple):
    """Hash of a policy's code, and what it covers."""

    sha256: str  # over words, paths and contents
    covers: str  # for people
    # The named files and folders, absolute, and the copy of each, if any.
    paths: Mapping[Path, Path]


def files_named_by(command: Sequence[str], files: Sequence[str] = ()) -> list[tuple[str, Path]]:
    """Return the files and folders that a command or the user names.

    Those of a command are its program, its words, and what follows the first "=" of a word
    (`--option=FILE`). A Python that is neither the audit's nor the system's counts with its whole
    folder, which may hold anything.

    Args:
        command: Words of the command.
        files: Further files and folders that the user names.

    Returns:
        Each file or folder with the word that names it.

    Raises:
        UserError: If a file that the user names doesn't exist.
    """
    program = Path(shutil.which(command[0]) or command[0])
    entries = [(command[0], program)] if program.is_file() else []
    outside = (Path("/"), Path.home(), *_visible(), *map(Path, _SYSTEM))
    for path in dict.fromkeys((program.absolute(), program.absolute().resolve())):
        folder = path.parent.parent
        if folder in outside or any(folder.is_relative_to(root) for root in outside[2:]):
            continue
        if (folder / "pyvenv.cfg").is_file() or any(folder.glob("lib/python3*/os.py")):
            entries.append((str(folder), folder))
    for word in command[1:]:
        name = next(filter(_is_there, (word, word.partition("=")[2])), "")
        entries += [(word, Path(name))] if name else []
    return entries + further_files(files)


def further_files(files: Sequence[str]) -> list[tuple[str, Path]]:
    """Return files and folders that the user names; `UserError` if one doesn't exist."""
    for word in files:
        if not _is_there(word):
            raise UserError(f"no such file: {one_line(word)}")
    return [(word, Path(word)) for word in files]


def _is_there(word: str) -> bool:
    """Whether a word names a file or a folder; of `os.path`, because a word may be too long."""
    return bool(word) and (os.path.isfile(word) or os.path.isdir(word))  # noqa: PTH112, PTH113


def hash_files(
    words: Sequence[str], labelled: Sequence[tuple[str, Path]], copies: Path | None = None
) -> CodeHash:
    """Hash words, and files and folders with their paths; each part is preceded by its length.

    Args:
        words: Words that are hashed first.
        labelled: Each file or folder with the word that names it.
        copies: Folder that gets the bytes that are hashed, readable by all users; None for no
            copies.

    Returns:
        The hash, a description of what it covers, and the copy of each file or folder.

    Raises:
        UserError: If a file can't be read, a folder has too many files, or a link leaves it.
    """
    digest = hashlib.sha256()
    files = 0
    size = 0
    paths = {}
    for word in words:
        _add(digest, "word", word)
    roots = [path.resolve() for _, path in labelled]
    for number, (word, path) in enumerate(labelled):
        _add(digest, "path", word)
        copy = None if copies is None else copies / str(number) / path.name
        paths.setdefault(path.absolute(), copy or path)
        try:
            if copy is not None:
                copy.parent.mkdir(mode=0o755)
            below = [_file(path, "", copy)] if path.is_file() else _below(path, roots, "", copy)
            for entry in below:
                _add(digest, entry.kind, entry.name, entry.content)
                files = files + (entry.kind == "file")
                size = size + entry.size
                if files > MOST_FILES:
                    raise UserError(
                        f"{one_line(word)} has more than {MOST_FILES:,} files: name the policy's "
                        "own folder"
                    )
        except OSError as error:
            name = one_line(str(error.filename or path))
            raise UserError(f"cannot read {name}: {error.strerror}") from error
    covers = (
        f"the words, and whole the {files} files ({size:,} bytes) that they name; not what "
        "programs load besides: the folder of the audit's interpreter and shared libraries"
    )
    return CodeHash(digest.hexdigest(), covers, paths)


class _Entry(NamedTuple):
    """A file, link or folder: its path below the named one, what is hashed, and its bytes."""

    kind: str
    name: str
    content: str = ""
    size: int = 0


def _below(folder: Path, roots: Sequence[Path], prefix: str, copy: Path | None) -> Iterator[_Entry]:
    """Yield what is in a folder in the order of the names, without caches; copy it."""
    if copy is not None:
        copy.mkdir(mode=0o755)
    for path in sorted(folder.iterdir()):
        name = f"{prefix}{path.name}"
        target = None if copy is None else copy / path.name
        if path.is_symlink():
            visible = (*roots, *_visible(), *map(Path, _SYSTEM))
            if not any(path.resolve().is_relative_to(root) for root in visible):
                raise UserError(
                    f"{one_line(str(path))} is a link that leaves the policy's folder: replace it "
                    "by what it points to"
                )
            if target is not None:
                target.symlink_to(path.readlink())
            yield _Entry("link", name, str(path.readlink()))
        elif path.is_dir() and path.name == CACHE:
            continue
        elif path.is_dir():
            yield _Entry("folder", name)
            yield from _below(path, roots, f"{name}/", target)
        elif path.is_file():
            yield _file(path, name, target)
        else:
            raise UserError(f"{one_line(str(path))} is not a plain file: leave it out")


def _file(path: Path, name: str, copy: Path | None) -> _Entry:
    """Hash a file, and write the same bytes into its copy."""
    digest = hashlib.sha256()
    size = 0
    with path.open("rb") as file, Path(copy or os.devnull).open("wb") as target:
        while block := file.read(_BLOCK):
            digest.update(block)
            target.write(block)
            size += len(block)
    if copy is not None:
        copy.chmod(0o755 if path.stat().st_mode & 0o111 else 0o644)
    return _Entry("file", name, digest.hexdigest(), size)


def _add(digest: Any, *texts: str) -> None:
    for text in texts:
        content = os.fsencode(text)
        digest.update(len(content).to_bytes(8) + content)


class Isolation(NamedTuple):
    """Isolation of a process."""

    kind: str  # program and version, for instance "bubblewrap 0.8.0", "none" or "not needed"
    why: str = ""  # reason why there is none

    @property
    def works(self) -> bool:
        """Whether the process is isolated."""
        return self.kind != NONE


NOT_ASKED = Isolation(NONE, "it was not asked for")
NOT_NEEDED = Isolation("not needed", "no code of its author runs")


def isolation_of(mode: str) -> Isolation:
    """Return the isolation that this system has, if it is asked for; refuse a required one."""
    one_of("isolation", mode, get_args(IsolationMode))
    if mode == NONE:
        return NOT_ASKED
    program = shutil.which(_PROGRAM)
    isolation = _tried(program) if program else Isolation(NONE, "bubblewrap is not installed")
    if mode == "required" and not isolation.works:
        raise UserError(f"isolation is required, but {isolation.why}: install bubblewrap (Linux)")
    return isolation


@functools.cache
def _tried(program: str) -> Isolation:
    """Start an empty sandbox once: a system can have the program and forbid its use."""
    trial = [sys.executable, "-I", "-S", "-c", "pass"]
    command = sandboxed(trial, CodeHash("", "", {}), program)
    try:
        version = subprocess.run([program, "--version"], capture_output=True, timeout=_SECONDS)
        outcome = subprocess.run(command, capture_output=True, timeout=_SECONDS)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Isolation(NONE, f"bubblewrap does not start: {one_line(str(error))}")
    if outcome.returncode:
        message = one_line(outcome.stderr.strip().rsplit(b"\n", 1)[-1])
        return Isolation(NONE, f"bubblewrap makes no sandbox here: {message}")
    return Isolation(one_line(version.stdout.strip()))


def sandboxed(
    command: Sequence[str], covered: CodeHash, program: str = _PROGRAM, library: bool = False
) -> list[str]:
    """Return the command that runs a command in a sandbox, which sees the covered files' copies.

    The user root of the system runs it as a user without rights, under a number that no other user
    has. Any other user runs it in a separate user namespace. In both the number of processes is
    limited (the latter from Linux 5.14 on).

    Args:
        command: Words of the command.
        covered: The files that it sees, with their copies.
        program: Path or name of bubblewrap.
        library: Whether it sees this library, with which it could compute the best answers.

    Returns:
        Words of the command line of the sandbox.

    Raises:
        UserError: If the program is a version manager's shim, which needs files of the manager.
    """
    first = Path(shutil.which(command[0]) or command[0]).absolute()
    if first.parent.name == "shims":
        raise UserError(
            f"{one_line(str(first))} is a shim of a version manager, and a sandbox has no manager: "
            f"name the program itself (pyenv which {one_line(first.name)})"
        )
    here = Path.cwd()
    root = os.geteuid() == 0
    system: list[str] = []
    for path in map(Path, _SYSTEM):
        if path.is_symlink():
            system += ["--symlink", str(path.readlink()), str(path)]
        elif path.is_dir():
            system += ["--ro-bind", str(path), str(path)]
    system += [word for name in _SETTINGS for word in ("--ro-bind-try", name, name)]
    user = 2_000_000_000 + secrets.randbelow(100_000_000) if root else -1
    folders = (*_visible(), *([_LIBRARY] if library else []))
    sources = {path: path for path in folders} | dict(covered.paths)
    # This library, which has the answers, is hidden where it is installed.
    roots = (Path(name) for name in ("/usr", "/usr/local", *map(str, sources)))
    installed = {path for root in roots for path in root.glob("lib/python3*/*-packages/socialiq*")}
    masked: list[str] = []
    for path in () if library else sorted({*installed, _LIBRARY}):
        if path.is_dir() and any(map(path.is_relative_to, (*sources, *_SYSTEM))):
            masked += ("--perms", "0555", "--tmpfs", str(path), "--remount-ro", str(path))
    return [
        program,
        *(_AS_ROOT if root else ("--unshare-all", "--cap-drop", "ALL")),
        *("--die-with-parent", "--new-session", "--clearenv"),
        *(word for pair in _ENVIRONMENT.items() for word in ("--setenv", *pair)),
        *system,
        # The first process is bubblewrap, whose command line has this library's paths.
        *("--proc", "/proc", "--ro-bind", "/dev/null", "/proc/1/cmdline", "--dev", "/dev"),
        *(word for path in _WRITABLE for word in (*_IN_MEMORY, path)),
        *_bound(sources, here),
        *masked,
        *("--chdir", str(here), "--remount-ro", "/dev", "--remount-ro", "/"),
        *(os.path.realpath(sys.executable), "-I", "-S", "-c", _LAUNCHERS.read_text(), "enter"),
        *(str(user), str(PROCESSES), str(DISK), str(first), *command[1:]),
    ]


_AS_ROOT = (
    *("--unshare-pid", "--unshare-net", "--unshare-ipc", "--unshare-uts", "--unshare-cgroup-try"),
    # These two change the user and are lost with it.
    *("--cap-drop", "ALL", "--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID"),
)


def _visible() -> tuple[Path, ...]:
    """Return the folders of the audit's interpreter: its virtual environment, and its base."""
    return tuple(dict.fromkeys(map(Path, (sys.prefix, sys.base_prefix))))


def _bound(sources: Mapping[Path, Path], here: Path) -> Iterator[str]:
    """Return the arguments for files and folders at their paths, outer ones first."""
    visible = [Path(name) for name in _SYSTEM]
    folders = {here, *here.parents}
    arguments = []
    for path, source in sorted(sources.items()):
        if not any(path.is_relative_to(outer) for outer in visible):
            visible.append(path)
            folders.update(path.parents)
            arguments += ["--ro-bind", os.path.realpath(source), str(path)]
    # The folders in memory have their mode already; what is read-only has its folders.
    for folder in sorted(folders - set(map(Path, ("/", "/dev", "/proc", *_WRITABLE)))):
        if not any(folder.is_relative_to(outer) for outer in visible):
            yield from ("--perms", "0755", "--dir", str(folder))
    yield from arguments
