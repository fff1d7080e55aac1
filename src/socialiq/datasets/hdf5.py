"""HDF5 files of strangers, read by number: plain arrays that lie in the file itself.

HDF5 lets a file link to other files, keep its numbers in them, or claim shapes of any size that no
byte stands for. None of that is followed, and a shape is held against a limit before it is read.
h5py runs HDF5's own C code on the file; what that code gets wrong, no check here can mend.
"""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line

MOST_NUMBERS = 2**28
"""Of all arrays that are read from one file together: 1 GiB as float32."""

_FAULTS = (OSError, RuntimeError, ValueError, TypeError, KeyError, AttributeError, OverflowError)


def library() -> ModuleType:
    """The h5py module.

    Raises:
        UserError: If it is not installed.
    """
    try:
        import h5py  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UserError(
            "Minari data need h5py, which is not installed: pip install 'socialiq[minari]'"
        ) from error
    return h5py


class Reader:
    """One open file; a context. Every fault is one line that names the file.

    Args:
        path: The file.

    Raises:
        UserError: If it is missing or no HDF5 file, or h5py is not installed.
    """

    def __init__(self, path: Path) -> None:
        self._h5py, self._path, self._left = library(), path, MOST_NUMBERS
        if not path.is_file():
            raise UserError(f"no such file: {path}")
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

    def size(self) -> int:
        """Number of members of the file's root."""
        try:
            return len(self._file)
        except _FAULTS as error:
            raise self._damaged() from error

    def has(self, name: str) -> bool:
        """Whether there is a member of that name; its path is given by slashes."""
        try:
            return self._found(name) is not None
        except _FAULTS as error:
            raise self._damaged() from error

    def array(self, name: str) -> np.ndarray:
        """The numbers of one member.

        Raises:
            UserError: If it is missing, no array of numbers, lies elsewhere, or is too large.
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
        """A member that lies in this file, following no link to another place."""
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
            raise UserError(f"{self._path}: {name} lies in another file: copy it in")
        if found.dtype.kind not in "fiub" or found.shape is None or not found.shape:
            kind = one_line(str(found.dtype), 40)
            raise UserError(f"{self._path}: {name} is {kind}, no array of numbers")
        largest = max(math.prod(found.shape), math.prod(found.chunks or (1,)))
        if largest > self._left:
            raise UserError(f"{self._path} claims more than {MOST_NUMBERS:,} numbers: split it")
        self._left -= largest

    def _damaged(self) -> UserError:
        return UserError(f"{self._path} is damaged or no HDF5 file: record it again")
