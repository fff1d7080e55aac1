"""Untrusted HDF5 files: plain numeric arrays that are stored in the file itself.

An HDF5 file can link to other files, store its data in them, or claim shapes of any size without
data. None of that is followed, and a shape is checked against a limit before it is read. h5py runs
HDF5's own C code on the file; a defect of that code cannot be prevented here.
"""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import check_file

MOST_NUMBERS = 2**28
"""Largest number of elements that are read from one file: 1 GiB as float32."""

_FAULTS = (OSError, RuntimeError, ValueError, TypeError, KeyError, AttributeError, OverflowError)


def library(needed_by: str = "Minari data") -> ModuleType:
    """Import h5py.

    Args:
        needed_by: What it reads or writes, in the message.

    Raises:
        UserError: If it is not installed.
    """
    return optional("h5py", "minari", needed_by)


class Reader:
    """An open file; a context manager. Every error message names the file.

    Args:
        path: The file.

    Raises:
        UserError: If it is missing or not an HDF5 file, or h5py is not installed.
    """

    def __init__(self, path: Path) -> None:
        self._h5py, self._path, self._left = library(), path, MOST_NUMBERS
        check_file(path)
        try:
            self._file = self._h5py.File(path, "r")
        except _FAULTS as error:
            raise self._damaged() from error

    def __enter__(self) -> Reader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def text(self, name: str) -> bytes | None:
        """Return a text that the root has as an attribute; None if there is none."""
        try:
            found = self._file.attrs.get(name)
        except _FAULTS as error:
            raise self._damaged() from error
        if isinstance(found, np.void):  # bytes of any length
            return found.tobytes()
        return found.encode() if isinstance(found, str) else None

    def size(self) -> int:
        """Return the number of members of the file's root."""
        try:
            return len(self._file)
        except _FAULTS as error:
            raise self._damaged() from error

    def has(self, name: str) -> bool:
        """Whether there is a member of that path, separated by slashes."""
        try:
            return self._found(name) is not None
        except _FAULTS as error:
            raise self._damaged() from error

    def array(self, name: str) -> np.ndarray:
        """Return the numbers of one member.

        Raises:
            UserError: If it is missing, not numeric, stored elsewhere, or too large.
        """
        try:
            found = self._found(name)
            if found is None:
                raise UserError(f"{self._path} lacks {name}: record it again")
            self._check(found, name)
            return np.asarray(found[()])
        except _FAULTS as error:
            raise self._damaged() from error

    def _found(self, name: str) -> Any:
        """Return a member of this file, without following a link to another place."""
        group = self._file
        for part in name.split("/"):
            if not isinstance(group, self._h5py.Group):
                return None
            link = group.get(part, getlink=True) if part in group else None
            if link is None:
                return None
            if not isinstance(link, self._h5py.HardLink):
                raise UserError(f"{self._path}: {name} is a link to another place: copy it in")
            group = group[part]
        return group

    def _check(self, found: Any, name: str) -> None:
        if not isinstance(found, self._h5py.Dataset):
            raise UserError(
                f"{self._path}: {name} is nested: only plain arrays are read, flatten it first"
            )
        if found.external or found.is_virtual:
            raise UserError(f"{self._path}: {name} is stored in another file: copy it in")
        if found.dtype.kind not in "fiub" or found.shape is None or not found.shape:
            kind = one_line(str(found.dtype), 40)
            raise UserError(f"{self._path}: {name} is {kind}, not an array of numbers")
        largest = max(math.prod(found.shape), math.prod(found.chunks or (1,)))
        if largest > self._left:
            raise UserError(f"{self._path} claims more than {MOST_NUMBERS:,} numbers: split it")
        self._left -= largest

    def _damaged(self) -> UserError:
        return UserError(f"{self._path} is damaged or no HDF5 file: record it again")
