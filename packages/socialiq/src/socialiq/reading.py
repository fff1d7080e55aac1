"""Files of the user, read so that no pipe blocks, no device runs on, and no size fills the memory.

Every reader of the project opens its file here.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from socialiq.errors import UserError
from socialiq.foreign import one_line

_PIECE = 1 << 20
_LARGEST_TOML = 1 << 20


@contextlib.contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file; what fails while it is read is raised as one line.

    A pipe would block and a device never ends, so both are refused.
    """
    try:
        check_file(path)
        with path.open("rb") as file:
            yield file
    except OSError as error:
        # A library's own message may have several lines.
        reason = error.strerror or one_line(str(error))
        raise UserError(f"cannot read {path}: {reason}") from error


def check_file(path: Path) -> None:
    """Refuse a path that is not a regular file."""
    if path.is_file():
        return
    if path.is_dir():
        inside = next((file.name for file in sorted(path.glob("*.safetensors"))), "")
        raise UserError(f"{path} is a folder: name a file" + (inside and f" in it, as {inside}"))
    if path.exists():
        raise UserError(f"{path} is not a regular file: name one")
    raise UserError(f"no such file: {path}")


def path_of(path: object) -> Path:
    """Return a path that may be text; `UserError` for anything else."""
    if isinstance(path, str | os.PathLike):
        return Path(path)
    raise UserError(f"{type(path).__name__} is no path: give a text or a pathlib.Path")


def read_bytes(path: Path, most: int) -> bytes:
    """Read a regular file of limited size.

    Args:
        path: The file.
        most: Largest number of bytes.

    Raises:
        UserError: If it is not a regular file, is larger, or can't be read.
    """
    with open_file(path) as file:
        # Not more than the file's size: the buffer is allocated at once.
        content = file.read(min(path.stat().st_size, most) + 1)
    if len(content) > most:
        raise UserError(f"{path} is larger than {most:,} bytes: name a smaller file")
    return content


def read_text(path: Path, most: int) -> str:
    """Read a file of UTF-8 text.

    Args:
        path: The file.
        most: Largest number of bytes.

    Raises:
        UserError: If it is not UTF-8 text, or as `read_bytes`.
    """
    try:
        return read_bytes(path, most).decode()
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not UTF-8 text: name a text file") from error


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file of at most 1 MiB.

    A whole number of more than 64 bits is refused, which TOML excludes and Python doesn't.
    """
    text = read_text(path, _LARGEST_TOML)
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not TOML: {one_line(str(error))}") from error
    waiting: list[Any] = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict | list):
            waiting += value.values() if isinstance(value, dict) else value
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise UserError(f"{path} has a whole number of more than 64 bits: TOML has none")
    return document


def check_keys(table: str, content: Mapping[str, Any], allowed: Iterable[str]) -> None:
    """Refuse keys of a table of a TOML file that are unknown.

    Args:
        table: Name of the table; "" for the file itself.
        content: The table.
        allowed: Keys that it may have.

    Raises:
        UserError: The line names the key and those that are known.
    """
    for key in content:
        if key not in allowed:
            where = f"[{table}] " if table else ""
            raise UserError(
                f"{where}{one_line(key, 40)} is unknown: known are {', '.join(allowed)}"
            )


def sha256_of(content: bytes | str) -> str:
    """Return the SHA-256 of bytes, or of a text in UTF-8, as hexadecimal digits."""
    data = content.encode() if isinstance(content, str) else content
    return hashlib.sha256(data).hexdigest()


def sha256_of_file(path: Path) -> str:
    """Return the SHA-256 of a file, as `sha256sum` prints it."""
    digest = hashlib.sha256()
    with open_file(path) as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()


class ForeignFile(NamedTuple):
    """Format of other programs that is taken for a file of ours, and the way to one of ours."""

    name: str
    suffixes: tuple[str, ...]
    begins: bytes  # first bytes, or "<" and the name of XML's first element; none: only the suffix
    recording: str  # next step to a recording
    demonstrations: str  # next step to demonstrations


_IMPORT_CSV = "import it: socialiq data import csv FILE --columns MAP --out FOLDER"
_FROM_ARRAYS = "read it: socialiq data from-arrays FILE --out OUT.safetensors"
_AS_CSV = (f"write it as CSV, then {_IMPORT_CSV}", f"write it as CSV, then {_FROM_ARRAYS}")
_COMMONROAD = "import it first: socialiq data import commonroad FILE --out FOLDER"
_SUMO = "it is a road without traffic; look at it: socialiq world sumo FILE"
_MAP = "name it as a map: socialiq data import csv TRACKS --columns MAP --road FILE --out FOLDER"
_NET = "convert it by SUMO's netconvert, then look at it: socialiq world sumo FILE"

FOREIGN_FILES = (
    ForeignFile("a CommonRoad scenario", (), b"<commonRoad", _COMMONROAD, _COMMONROAD),
    ForeignFile("an OpenDRIVE map", (".xodr",), b"<OpenDRIVE", _NET, _NET),
    ForeignFile("a network of SUMO", (), b"<net", _SUMO, _SUMO),
    ForeignFile("FCD output of SUMO", (), b"<fcd-export", *_AS_CSV),
    ForeignFile("an OSM map", (".osm",), b"<osm", _MAP, _MAP),
    ForeignFile("another XML file", (".xml",), b"<", *_AS_CSV),
    ForeignFile("an SQLite database", (".db", ".sqlite"), b"SQLite format 3\0", *_AS_CSV),
    ForeignFile("an HDF5 file", (".h5", ".hdf5"), b"\x89HDF", _AS_CSV[0], _FROM_ARRAYS),
    ForeignFile(
        "a Parquet file",
        (".parquet",),
        b"PAR1",
        "import it: socialiq data import argoverse FILE --out FOLDER",
        _FROM_ARRAYS,
    ),
    ForeignFile("a zip archive", (".npz", ".zip"), b"PK\x03\x04", _AS_CSV[0], _FROM_ARRAYS),
    ForeignFile("a compressed file", (".gz",), b"\x1f\x8b", "unpack it first", "unpack it first"),
    ForeignFile("a pickle, which is never loaded", (".pickle", ".pkl"), b"\x80", *_AS_CSV),
    ForeignFile("an Arrow file", (".arrow", ".feather"), b"ARROW1", *_AS_CSV),
    ForeignFile("a TFRecord file", (".tfrecord",), b"", *_AS_CSV),
    ForeignFile("a Protocol Buffers file", (".pb",), b"", *_AS_CSV),
    ForeignFile("JSON", (".geojson", ".json"), b"{", *_AS_CSV),
    ForeignFile("a table of text", (".csv", ".tsv", ".txt"), b"", _IMPORT_CSV, _FROM_ARRAYS),
)
"""Formats that are known by their first bytes, else by the suffix; the first that fits counts."""

_HEAD = 1 << 16  # bytes in which XML's first element is looked for
_COMMENT = re.compile(rb"<!--.*?(-->|\Z)", re.DOTALL)
_ELEMENT = re.compile(rb"<[A-Za-z][\w.-]*")


def foreign_file(path: Path) -> ForeignFile | None:
    """Return the format of a file of another program; None of a .safetensors, or if it is unknown.

    Args:
        path: A regular file.
    """
    suffix = path.suffix.lower()
    if suffix == ".safetensors":
        return None
    with open_file(path) as file:
        head = file.read(_HEAD)
    start = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if start.startswith(b"<"):
        element = _ELEMENT.search(_COMMENT.sub(b"", start))
        start = element.group() if element else b"<"
    for foreign in FOREIGN_FILES:
        is_element = _ELEMENT.fullmatch(foreign.begins) is not None  # its whole name counts
        begins = foreign.begins and start.startswith(foreign.begins)
        if start == foreign.begins != b"" or (begins and not is_element):
            return foreign
    return next((foreign for foreign in FOREIGN_FILES if suffix in foreign.suffixes), None)
