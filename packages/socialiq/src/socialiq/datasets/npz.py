"""NumPy archives of unknown origin: plain arrays of numbers; nothing is unpickled.

The header of a member is checked against its size before memory is allocated: NumPy itself would
allocate an array of any shape that the header claims.
"""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from socialiq.errors import UserError
from socialiq.reading import open_file

MOST_BYTES = 2 * 1024**3
"""Largest size of all arrays of one archive together."""

_MEMBERS = 1_000
_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    EOFError,
    ValueError,
    RuntimeError,  # encrypted members; NotImplementedError for unknown compression is one too
    RecursionError,
    SyntaxError,
    tokenize.TokenError,
)


def read_npz(path: Path, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Read arrays of an archive that `numpy.savez` or `numpy.savez_compressed` wrote.

    Args:
        path: The archive.
        names: Members to read if they exist; others are never opened.

    Raises:
        UserError: If it is missing or damaged, or one of these members is not numeric.
    """
    try:
        with open_file(path) as file, zipfile.ZipFile(file) as archive:
            members = {one.filename: one for one in archive.infolist()[:_MEMBERS]}
            wanted = {name: members[f"{name}.npy"] for name in names if f"{name}.npy" in members}
            if sum(one.file_size for one in wanted.values()) > MOST_BYTES:
                raise UserError(f"{path} holds more than {MOST_BYTES:,} bytes: split it")
            return {name: _read(archive, one, path) for name, one in wanted.items()}
    except UserError:
        raise
    except _FAULTS as error:
        raise UserError(f"{path} is damaged or no .npz archive: save it again") from error


def npz_of(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return named arrays of numbers as the bytes of a compressed archive."""
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **arrays)
    return file.getvalue()


def _read(archive: zipfile.ZipFile, member: zipfile.ZipInfo, path: Path) -> np.ndarray:
    name = member.filename.removesuffix(".npy")
    with archive.open(member) as file:
        shape, dtype = _header(file)
        if dtype.kind not in "fiub":
            raise UserError(
                f"{path}: {name} is {dtype.kind!r}, not an array of numbers: save numbers"
            )
        if file.tell() + math.prod(shape) * dtype.itemsize != member.file_size:
            raise UserError(f"{path}: {name} has another size than its header: save it again")
    with archive.open(member) as file:
        return npy.read_array(file, allow_pickle=False)


def _header(file: Any) -> tuple[tuple[int, ...], np.dtype]:
    """Return shape and type of a member.

    Raises:
        ValueError: If it is not one that NumPy writes for plain arrays.
    """
    version = npy.read_magic(file)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise ValueError("unknown version")
    shape, _, dtype = readers[version](file)
    if any(size < 0 for size in shape):
        raise ValueError("negative size")
    return shape, dtype
