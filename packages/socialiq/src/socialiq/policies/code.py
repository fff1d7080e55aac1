"""Policies that are code: the files that a command or module names, their hash, and import.

Nothing is imported but by `read_callable`, which runs the author's code with all your rights.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any, NamedTuple

from socialiq.errors import UserError
from socialiq.foreign import FAILURES, failure, imported, one_line
from socialiq.policies.interface import BatchPolicy, Interface, read_content
from socialiq.policies.isolation import CodeHash

MOST_FILES = 100_000
"""Largest number of files below the named folders."""

CACHE = "__pycache__"
"""Folders with this name are derived from the sources beside them, and are not covered."""


class NamedFile(NamedTuple):
    """A file or folder of a policy, and the word that names it."""

    word: str
    path: Path


def files_named_by(command: Sequence[str], files: Sequence[str] = ()) -> list[NamedFile]:
    """Return the files and folders that a command names.

    They are its program, its words, and what follows the first "=" of a word (`--option=FILE`).

    Args:
        command: Program and arguments.
        files: Further files and folders, which the command doesn't name.

    Raises:
        UserError: If one of `files` doesn't exist.
    """
    program = NamedFile(command[0], Path(shutil.which(command[0]) or command[0]))
    entries = [program] if program.path.is_file() else []
    for word in command[1:]:
        path = next(filter(_is_there, (word, word.partition("=")[2])), "")
        entries += [NamedFile(word, Path(path))] if path else []
    return entries + further_files(files)


def further_files(files: Sequence[str]) -> list[NamedFile]:
    """Return files and folders that the user names.

    Raises:
        UserError: If one doesn't exist.
    """
    for word in files:
        if not _is_there(word):
            raise UserError(f"no such file: {one_line(word)}")
    return [NamedFile(word, Path(word)) for word in files]


def _is_there(word: str) -> bool:
    """Whether a word names a file or a folder; of `os.path`, because a word may be too long."""
    return bool(word) and (os.path.isfile(word) or os.path.isdir(word))  # noqa: PTH112, PTH113


def hash_files(words: Sequence[str], named: Sequence[NamedFile]) -> CodeHash:
    """Hash words, and files and folders with their paths; each part is preceded by its length.

    Args:
        words: Words of the specification, in their order.
        named: Files and folders.

    Raises:
        UserError: If a file can't be read, a folder has too many files, or a link leaves it.
    """
    digest, caches, files, size = hashlib.sha256(), [], 0, 0
    for word in words:
        _add(digest, "word", word)
    for word, path in named:
        _add(digest, "path", word)
        for entry in _entries(path, caches):
            _add(digest, entry.kind, entry.name, entry.content)
            files, size = files + (entry.kind == "file"), size + entry.size
            if files > MOST_FILES:
                raise UserError(
                    f"{one_line(word)} has more than {MOST_FILES:,} files: name the policy's own "
                    "folder"
                )
    covers = (
        f"the words, and whole the {files} files ({size:,} bytes) that they name; "
        "not what programs load besides: the interpreter's folder and shared libraries"
    )
    paths = tuple(dict.fromkeys(path.absolute() for _, path in named))
    return CodeHash(digest.hexdigest(), covers, paths, tuple(caches))


class _Entry(NamedTuple):
    """A file, link or folder: its path below the named one, what is hashed, and its bytes."""

    kind: str
    name: str
    content: str = ""
    size: int = 0


def _entries(path: Path, caches: list[Path]) -> Iterator[_Entry]:
    """Return the entries of a file or folder in the order of their names; collect its caches."""
    try:
        if path.is_file():
            yield _file(path, "")
        else:
            yield from _below(path, path.resolve(), "", caches)
    except OSError as error:
        name = one_line(str(error.filename or path))
        raise UserError(f"cannot read {name}: {error.strerror}") from error


def _below(folder: Path, root: Path, prefix: str, caches: list[Path]) -> Iterator[_Entry]:
    for path in sorted(folder.iterdir()):
        name = f"{prefix}{path.name}"
        if path.is_symlink():
            if not path.resolve().is_relative_to(root):
                raise UserError(
                    f"{one_line(str(path))} is a link that leaves the policy's folder: replace it "
                    "by what it points to"
                )
            yield _Entry("link", name, str(path.readlink()))
        elif path.is_dir() and path.name == CACHE:
            caches.append(path.absolute())
        elif path.is_dir():
            yield _Entry("folder", name)
            yield from _below(path, root, f"{name}/", caches)
        elif path.is_file():
            yield _file(path, name)
        else:
            raise UserError(f"{one_line(str(path))} is not a plain file: leave it out")


def _file(path: Path, name: str) -> _Entry:
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        return _Entry("file", name, hashlib.file_digest(file, "sha256").hexdigest(), size)


def _add(digest: Any, *texts: str) -> None:
    for text in texts:
        content = os.fsencode(text)
        digest.update(len(content).to_bytes(8) + content)


OWN_FOLDER = Path(__file__).parents[1]
"""Folder of this package: its child program, and what a policy may import of it."""


def hash_of_python(name: str, source: str, files: Sequence[str]) -> CodeHash:
    """Hash the files of `MODULE:ATTRIBUTE`: the module's file, or its whole top-level package.

    Args:
        name: As above; MODULE may be a file's path that ends in .py.
        source: Its name in messages.
        files: Further files and folders.

    Raises:
        UserError: If the module isn't found, or a file can't be read.
    """
    module, attribute = _split(name, source)
    # A file's name, not its path: the same policy in another folder has the same hash.
    words = ["python", Path(module).name, attribute]
    if module.endswith(".py"):
        if not Path(module).is_file():
            raise UserError(f"no such file: {one_line(module)}")
        return hash_files(words, [NamedFile(words[1], Path(module)), *further_files(files)])
    top = module.partition(".")[0]
    # This finder looks at names of files only; `find_spec` of a submodule would import its package.
    spec = PathFinder.find_spec(top) if top.isidentifier() else None
    if spec is None:
        raise UserError(
            f"no such module: {one_line(module)}; name the path of its file, ending in .py"
        )
    paths = list(spec.submodule_search_locations or ()) or [str(spec.origin)]
    entries = [NamedFile(top, Path(path)) for path in paths]
    return hash_files(words, [*entries, *further_files(files)])


def _split(name: str, source: str) -> tuple[str, str]:
    """Return module and attribute of `MODULE:ATTRIBUTE`."""
    module, _, attribute = name.rpartition(":")
    if not module or not attribute.isidentifier():
        raise UserError(
            f"{source} is not MODULE:ATTRIBUTE: write for instance mine.policies:careful"
        )
    return module, attribute


def command_of_python(name: str, source: str) -> list[str]:
    """Return the command that runs `MODULE:ATTRIBUTE` as a process, with this interpreter.

    Raises:
        UserError: If the text has another form.
    """
    module, attribute = _split(name, source)
    if module.endswith(".py"):
        module = str(Path(module).absolute())
    child = str(Path(__file__).with_name("python_child.py"))
    paths = json.dumps([str(Path(path).absolute()) for path in sys.path])
    return [sys.executable, "-I", "-B", child, module, attribute, paths]


def read_callable(name: str, source: str, world: Interface) -> tuple[BatchPolicy, bytes]:
    """Load the policy `MODULE:ATTRIBUTE`; MODULE may be a file's path that ends in .py.

    The attribute is a policy (it has `predict`), a class that makes one without arguments, or a
    function from observations, float32 (batch, features), to one action for each.

    Args:
        name: As above.
        source: Its name in messages.
        world: The interface for the check of its answers.

    Returns:
        The policy, and the source text of its module.

    Raises:
        UserError: If the module or attribute is missing, or its code fails.
    """
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
