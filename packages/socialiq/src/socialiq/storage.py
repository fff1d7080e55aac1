"""Atomic writes of files, and arrays with a checked header.

One container serves every array file of the project: safetensors, whose string metadata carries
one JSON header with the kind of content, the schema version and a SHA-256 over header and arrays.
Nothing here can execute what it reads.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.resources
import io
import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import safetensors
import safetensors.numpy

from socialiq.errors import UserError
from socialiq.outputs import check_ending, move_file
from socialiq.reading import check_file, foreign_file, open_file, path_of, read_bytes

_HEADER = "socialiq"
_CUT_OFF = ".unfinished"  # ending of a file that is being written
_MOST_JSON = 256 << 20
_UNREADABLE = (safetensors.SafetensorError, OSError, ValueError, RecursionError)


def write_atomically(path: Path, content: bytes | str, replace: bool = True) -> None:
    """Write a file atomically: a reader finds the old content or the new.

    Args:
        path: The file; its folder must exist.
        content: Its content.
        replace: Whether an existing file is replaced. If not, one that appears meanwhile stays.

    Raises:
        UserError: If the file can't be written, or exists and may not be replaced.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        if replace and os.path.lexists(path) and not (path.is_file() or path.is_dir()):
            raise UserError(f"cannot write {path}: it is not a regular file; choose another place")
        handle, temporary = tempfile.mkstemp(_CUT_OFF, f".{path.name}.", path.parent)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        move_file(Path(temporary), path, replace)
    except FileExistsError as error:
        raise UserError(f"{path} exists already: name a new file, or remove it first") from error
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place") from error
    finally:
        Path(temporary).unlink(missing_ok=True)


def remove_cut_off_writes(folder: Path) -> None:
    """Remove unfinished files of killed processes; no process may write in the folder meanwhile."""
    for path in folder.rglob(f".*{_CUT_OFF}"):
        path.unlink()


def write_json(path: Path, content: Any) -> None:
    """Write one JSON document, indented, keys in the order given, ended by a newline.

    Args:
        path: The file; its folder must exist, and a file of that name is replaced.
        content: JSON-compatible content, with finite numbers only.

    Raises:
        UserError: If the file can't be written.
        ValueError: If a number is not finite.
    """
    write_atomically(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_json(path: Path, most: int = _MOST_JSON) -> Any:
    """Read one JSON document.

    Args:
        path: The file.
        most: Largest number of bytes.

    Raises:
        UserError: If the file is missing, larger or not JSON.
    """
    try:
        return json.loads(read_bytes(path, most))
    except (ValueError, RecursionError) as error:
        raise UserError(f"cannot read {path} as JSON: {error}") from error


@contextlib.contextmanager
def open_csv(path: Path) -> Iterator[TextIO]:
    """Open a CSV file of UTF-8 text; what fails while it is read is raised as one line."""
    try:
        with open_file(path) as file, io.TextIOWrapper(file, "utf-8-sig", newline="") as text:
            yield text
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not UTF-8 text: is this a CSV file?") from error


def content_hash(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> str:
    """Return the SHA-256 over a header and named arrays: names, types, shapes and bytes.

    Args:
        arrays: Arrays by name; their order doesn't matter.
        header: JSON-compatible content; the order of its keys doesn't matter.

    Returns:
        64 hexadecimal digits.
    """
    digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.asarray(arrays[name], order="C")
        digest.update(f"{name}:{array.dtype.str}:{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def save_arrays(
    path: str | Path,
    kind: str,
    version: int,
    arrays: Mapping[str, np.ndarray],
    header: Mapping[str, Any],
    replace: bool = True,
) -> str:
    """Write named arrays and a JSON-compatible header to one checked file.

    Args:
        path: The file; its folder must exist.
        kind: Kind of content, for instance "demonstrations".
        version: Schema version of that kind.
        arrays: Named arrays, any shapes.
        header: Further JSON-compatible content.
        replace: Whether a file there is replaced.

    Returns:
        SHA-256 of the content.
    """
    check_ending(path := path_of(path), ".safetensors")
    contiguous, full = _as_read(kind, version, arrays, header)
    sha256 = content_hash(contiguous, full)
    metadata = {_HEADER: json.dumps({"header": full, "sha256": sha256})}
    write_atomically(path, safetensors.numpy.save(contiguous, metadata=metadata), replace)
    return sha256


def sha256_of(
    kind: str, version: int, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
) -> str:
    """Return the SHA-256 that `save_arrays` would return, without a file.

    Args:
        kind: Kind of content.
        version: Schema version of that kind.
        arrays: Named arrays, any shapes.
        header: Further JSON-compatible content.
    """
    return content_hash(*_as_read(kind, version, arrays, header))


def _as_read(
    kind: str, version: int, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return content as it is read back: JSON's string keys, native byte order."""
    full = json.loads(json.dumps({"kind": kind, "version": version, **header}))
    contiguous = {
        name: np.asarray(array, array.dtype.newbyteorder("="), order="C")
        for name, array in arrays.items()
    }
    return contiguous, full


def is_file(path: str | Path) -> bool:
    """Whether a path is that of a file (`shipped`); a text that can be no path is none."""
    try:
        return shipped(Path(path)).is_file()
    except (OSError, ValueError):  # too long, or with a zero byte
        return False


def header_of(path: Path) -> dict[str, Any]:
    """Return the header of a file of `save_arrays`; empty if there is none.

    The file is not checked; `load_arrays` does that and reports errors.
    """
    if not is_file(path):  # reading a pipe would block
        return {}
    try:
        with safetensors.safe_open(shipped(path), framework="numpy") as file:
            wrapper = json.loads((file.metadata() or {}).get(_HEADER, "null"))
        header = wrapper["header"]
    except (*_UNREADABLE, KeyError, TypeError):
        return {}
    return header if isinstance(header, dict) else {}


def kind_of(path: Path) -> str:
    """Return the kind in the header of a file, as `header_of`; "" if there is none."""
    kind = header_of(path).get("kind")
    return kind if isinstance(kind, str) else ""


def load_arrays(
    path: str | Path, kind: str, version: int | Sequence[int]
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read a file of `save_arrays` and check all its bytes.

    Args:
        path: The file.
        kind: Kind of content that is expected.
        version: Schema version that is read, or several.

    Returns:
        The named arrays, and the header with `kind`, `version` and `sha256` in it.
    """
    path = shipped(path_of(path))
    check_file(path)
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            text = (file.metadata() or {}).get(_HEADER, "null")
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        wrapper = json.loads(text)
    # safetensors raises the last two for types that NumPy doesn't have.
    except (*_UNREADABLE, AttributeError, TypeError) as error:
        raise _unreadable(path, kind) from error
    if not isinstance(wrapper, dict) or not isinstance(wrapper.get("header"), dict):
        raise UserError(f"{path} is not a socialiq file: expected a {kind} file")
    header = wrapper["header"]
    if header.get("kind") != kind:
        raise UserError(f"{path} holds {_word(header.get('kind'))}, not {kind}: name a {kind} file")
    read = (version,) if isinstance(version, int) else tuple(version)
    if header.get("version") not in read:
        raise UserError(
            f"{path} has {kind} schema version {_word(header.get('version'))}, this program reads "
            f"version {' or '.join(map(str, read))}: make the file again with this version"
        )
    sha256 = content_hash(arrays, header)
    # The hash covers values; another encoding of equal values is damage too: only spaces follow the
    # JSON object of a safetensors header.
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
        padded = file.read(length).rstrip(b" ").endswith(b"}")
    respelled = json.dumps(wrapper) != text or not padded
    if sha256 != wrapper.get("sha256") or respelled:
        raise UserError(f"{path} is damaged (its SHA-256 differs): restore it or make it again")
    return arrays, {**header, "sha256": sha256}


def _unreadable(path: Path, kind: str) -> UserError:
    """Return the error of a file that is damaged or of another program."""
    foreign = foreign_file(path)
    if foreign is None:
        return UserError(f"{path} is damaged or not a {kind} file: restore it or make it again")
    mends = {"recording": foreign.recording, "demonstrations": foreign.demonstrations}
    return UserError(f"{path} is {foreign.name}: {mends.get(kind, f'name a {kind} file')}")


def _word(value: Any) -> str:
    """Return a header value for an error message, if it is a short word; it may be any text."""
    word = str(value) if isinstance(value, str | int) else ""
    plain = word.isascii() and word.replace("-", "").replace("_", "").isalnum() and len(word) <= 40
    return word if plain else "something else"


def packaged_results() -> Path:
    """Return the folder of the committed results, in an installed package or in a checkout."""
    package = Path(str(importlib.resources.files("socialiq")))
    for folder in (package / "results", *(up / "results" for up in package.parents[3:4])):
        if folder.is_dir():
            return folder
    raise UserError("the committed results did not come with this package: name --results DIR")


def shipped(path: Path) -> Path:
    """Return the path, or the packaged result of that name if `results/...` doesn't exist.

    Commands of the documentation therefore also work outside a checkout.
    """
    if path.exists() or path.parts[:1] != ("results",):
        return path
    try:
        packaged = packaged_results().joinpath(*path.parts[1:])
    except UserError:
        return path
    return packaged if packaged.exists() else path
