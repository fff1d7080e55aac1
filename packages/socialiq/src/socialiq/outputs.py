"""Places of outputs: an occupied place is refused, and a place is claimed while its output is made.

Two processes with one output can't both succeed with one result lost: the second is refused by the
first one's claim. Where they don't see each other's claims (on two machines, say), no output that
has appeared meanwhile is replaced.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import filelock

from socialiq.errors import UserError

FORMATS = (".csv", ".gif", ".h5", ".hdf5", ".html", ".jpeg", ".jpg", ".json", ".md", ".mp4", ".npy")
FORMATS += (".npz", ".onnx", ".parquet", ".pdf", ".pkl", ".png", ".pt", ".pth", ".safetensors")
FORMATS += (".svg", ".toml", ".tsv", ".txt", ".xlsx", ".xml", ".yaml", ".zip")
"""Endings that name a format, so that no file or folder of another content has one."""
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


def check_ending(path: Path, *written: str) -> None:
    """Refuse an output whose name says another format than those it can have; none: a folder."""
    ending = path.suffix.lower()
    if ending in FORMATS and ending not in written:
        mend = f"name it {written[0]}" if written else "it is a folder, so leave the ending out"
        raise UserError(f"{path} would not be a {path.suffix} file: {mend}")


def refuse_existing(path: Path, *written: str) -> None:
    """Refuse an output file that exists, also if it is a broken link, before any work is done.

    Args:
        path: The output file.
        *written: Endings that its name may have, by default .safetensors. An ending of no known
            format is accepted too.

    Raises:
        UserError: If the file exists, has another ending, or can't be written in its folder.
    """
    check_ending(path, *(written or (".safetensors",)))
    if os.path.lexists(path):
        raise UserError(f"{path} exists already: name a new file, or remove it first")
    if not os.access(path.parent, os.W_OK):
        raise UserError(f"cannot write in {path.parent}: make the folder, or choose another place")


def check_place(out: Path, option: str) -> None:
    """Refuse an output that is a root, or the folder that one is in or above.

    Args:
        out: Path of the output.
        option: Name of the command's option for the path, for the message.

    Raises:
        UserError: If the path ends in no name of a file or folder.
    """
    if str(out) == "-":
        raise UserError(f"- is no name of an output: name a file or folder as {option}")
    if out.name in ("", ".", ".."):
        raise UserError(f"{out} is no new place: name another {option}")


@contextlib.contextmanager
def folder_above(out: Path) -> Iterator[None]:
    """Make the folders above an output; those that are empty after the block are removed.

    Args:
        out: Path of the output.

    Raises:
        UserError: If a folder can't be made.
    """
    missing = [folder for folder in out.parents if not folder.exists()]
    try:
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(
                f"cannot make {out.parent}: {error.strerror}; choose another place"
            ) from error
        yield
    finally:
        for folder in missing:
            with contextlib.suppress(OSError):  # it has content
                folder.rmdir()


@contextlib.contextmanager
def claimed(out: Path) -> Iterator[None]:
    """Keep other commands from an output while this one makes it.

    The claim is a locked file in the user's cache, so a killed process leaves no file next to its
    output. The system releases the lock of a process that dies: no claim outlives it.
    """
    check_place(out, "--out")
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "socialiq"
        cache.mkdir(parents=True, exist_ok=True)
        name = hashlib.sha256(os.path.realpath(out).encode()).hexdigest()[:32]
        lock = filelock.FileLock(cache / f"{name}.claim", blocking=False)
        lock.acquire()
    except filelock.Timeout as error:
        raise UserError(
            f"another process is writing {out}: wait for it, or name another --out"
        ) from error
    except (OSError, NotImplementedError, RuntimeError):  # no cache: what appears is not replaced
        yield
        return
    try:
        yield
    finally:
        # While it is held: a process that waits for this very file finds it gone and tries again.
        Path(lock.lock_file).unlink(missing_ok=True)
        lock.release()


def move_file(temporary: Path, path: Path, replace: bool) -> None:
    """Move a finished file from its temporary name in the same folder to its place.

    Args:
        temporary: The finished file.
        path: Its place.
        replace: Whether a file in that place is replaced.

    Raises:
        FileExistsError: If the place is taken and its file is not to be replaced.
        OSError: If the move fails.
    """
    if replace:
        temporary.replace(path)
        return
    try:
        os.link(temporary, path)  # fails if the place is taken, at whatever moment
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
        temporary.replace(path)


def new_folder(path: Path) -> Path:
    """Make a new output folder; an empty one is accepted, any other refused."""
    check_ending(path)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise UserError(f"{path} exists already: name a new folder, or remove it first")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot make {path}: {error.strerror}; choose another place") from error
    return path


@contextlib.contextmanager
def all_or_none(folder: Path) -> Iterator[None]:
    """Remove what a block that fails has added to a folder, and the folder if it is then empty."""
    before = {*folder.iterdir()}
    try:
        yield
    except BaseException:
        for path in {*folder.iterdir()} - before:
            path.unlink()
        with contextlib.suppress(OSError):
            folder.rmdir()
        raise


def part_beside(folder: Path) -> Path:
    """Make an empty folder for the later content of `folder` (see `swap_folder`)."""
    check_ending(folder)
    try:
        return Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
    except OSError as error:
        raise UserError(f"cannot make {folder}: {error.strerror}; choose another place") from error


@contextlib.contextmanager
def whole_folder(folder: Path, replace: bool = False) -> Iterator[Path]:
    """Give a temporary folder to fill; it becomes `folder` on success, else it is removed.

    Args:
        folder: The output folder; the folder above it must exist.
        replace: Whether a folder with content is replaced. If not, even one that appears meanwhile
            stays as it is.

    Yields:
        The temporary folder, which lies in the same folder as the output.

    Raises:
        UserError: If the folder can't be made, or exists and may not be replaced.
    """
    temporary = part_beside(folder)
    try:
        yield temporary
        temporary.chmod(0o755)
        swap_folder(temporary, folder, replace)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_output_folder(folder: Path, replace: bool | None = None) -> bool:
    """Refuse an output folder that can't be written, before any work is done.

    A command without --replace leaves `replace` out.

    Returns:
        Whether the folder has content, which may be replaced.
    """
    if not folder.parent.is_dir():
        new_folder(folder.parent)
    part_beside(folder).rmdir()  # whether it can be written there
    if Path(os.path.realpath(folder)) in (Path.cwd(), *Path.cwd().parents):
        raise UserError(f"{folder} is the folder that you are in, or above it: name a new folder")
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UserError(f"{folder} is not a folder: name another --out")
    if not folder.exists() or not any(folder.iterdir()):
        return False
    if not replace:
        mend = "remove it first" if replace is None else "add --replace"
        raise UserError(f"{folder} exists already: name a new folder, or {mend}")
    return True


def swap_folder(temporary: Path, folder: Path, replace: bool = True) -> None:
    """Move a finished folder from its temporary name in the same place to its final name.

    Args:
        temporary: The finished folder.
        folder: Its final path.
        replace: Whether a folder with content is replaced. The old folder is removed last, and
            restored on failure.

    Raises:
        UserError: If the move fails, or the folder has content and may not be replaced.
    """
    old = temporary.with_name(f"{temporary.name}.old")
    try:
        if not replace:
            with contextlib.suppress(FileNotFoundError):
                folder.rmdir()
            temporary.rename(folder)
            return
        if folder.exists():
            folder.rename(old)
        try:
            temporary.rename(folder)
        except OSError:
            if old.exists():
                old.rename(folder)
            raise
    except OSError as error:
        line = f"cannot make {folder}: {error.strerror}; choose another place"
        occupied = not replace and error.errno in (errno.ENOTEMPTY, errno.ENOTDIR)
        if occupied or isinstance(error, FileExistsError):
            line = f"{folder} exists already: name a new folder, or add --replace"
        raise UserError(line) from error
    shutil.rmtree(old, ignore_errors=True)
