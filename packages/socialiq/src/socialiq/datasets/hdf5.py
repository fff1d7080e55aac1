"""Untrusted HDF5 files of plain numeric arrays, and demonstrations in D4RL's layout of them.

An HDF5 file can link to other files, store its data in them, or claim shapes of any size without
data. None of that is followed, and a shape is checked against a limit before it is read. h5py runs
HDF5's own C code on the file; a defect of that code cannot be prevented here.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import check_file

MOST_NUMBERS = 2**28
"""Largest number of elements that are read from one file: 1 GiB as float32."""

_FAULTS = (OSError, RuntimeError, ValueError, TypeError, KeyError, AttributeError, OverflowError)


def library(needed_by: str = "Minari data") -> ModuleType:
    """Import h5py; `UserError` if it is not installed."""
    return optional("h5py", "minari", needed_by)


class Reader:
    """An open file; a context manager. Every error message names the file."""

    def __init__(self, path: Path) -> None:
        self._h5py = library()
        self._path = path
        self._left = MOST_NUMBERS
        check_file(path)
        with self._reading():
            self._file = self._h5py.File(path, "r")

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except _FAULTS as error:
            raise UserError(f"{self._path} is damaged or no HDF5 file: record it again") from error

    def text(self, name: str) -> bytes | None:
        """Return a text that the root has as an attribute; None if there is none."""
        with self._reading():
            text = self._file.attrs.get(name)
        if isinstance(text, np.void):  # bytes of any length
            return text.tobytes()
        return text.encode() if isinstance(text, str) else None

    def size(self) -> int:
        """Return the number of members of the file's root."""
        with self._reading():
            return len(self._file)

    def has(self, name: str) -> bool:
        """Whether there is a member of that path, separated by slashes."""
        with self._reading():
            return self._member(name) is not None

    def array(self, name: str) -> np.ndarray:
        """Return the numbers of one member of this very file."""
        with self._reading():
            member = self._member(name)
            if member is None:
                raise UserError(f"{self._path} lacks {name}: record it again")
            if not isinstance(member, self._h5py.Dataset):
                raise UserError(
                    f"{self._path}: {name} is nested: only plain arrays are read, flatten it first"
                )
            if member.external or member.is_virtual:
                raise UserError(f"{self._path}: {name} is stored in another file: copy it in")
            if member.dtype.kind not in "fiub" or member.shape is None or not member.shape:
                kind = one_line(str(member.dtype), 40)
                raise UserError(f"{self._path}: {name} is {kind}, not an array of numbers")
            largest = max(math.prod(member.shape), math.prod(member.chunks or (1,)))
            if largest > self._left:
                raise UserError(f"{self._path} claims more than {MOST_NUMBERS:,} numbers: split it")
            self._left -= largest
            return np.asarray(member[()])

    def _member(self, name: str) -> Any:
        """Return a member of this file, without following a link to another place."""
        group = self._file
        for word in name.split("/"):
            if not isinstance(group, self._h5py.Group) or word not in group:
                return None
            link = group.get(word, getlink=True)
            if link is None:
                return None
            if not isinstance(link, self._h5py.HardLink):
                raise UserError(f"{self._path}: {name} is a link to another place: copy it in")
            group = group[word]
        return group


NAMES = {
    "observation": "observations",
    "action": "actions",
    "terminated": "terminals",
    "truncated": "timeouts",
    "next_observation": "next_observations",
}
"""D4RL's name of each column."""

REWARD = "rewards"
PAIRS = "infos/reward_vector", "infos/reward_pair"
"""D4RL's reward, and what holds a pair of rewards beside it; the first of these is written."""

MORE = ("ending", "mode", "episode", "step")
"""Columns of a table that D4RL has no name for; they are kept in `infos/socialiq`."""

OURS = "infos/socialiq"


def read_d4rl(path: Path, key: str) -> tuple[dict[str, Any], bytes | None]:
    """Read the arrays of `arrays.of_steps` from a file in D4RL's layout.

    Returns:
        The arrays by their names in the file, and the header at the attribute `key` or None.
    """
    with Reader(path) as reader:
        required = (*list(NAMES.values())[:3], REWARD)
        missing = [name for name in required if not reader.has(name)]
        if missing:
            raise UserError(f"{path} has no {', '.join(missing)}: is it of D4RL's layout?")
        if not reader.has(NAMES["next_observation"]):
            raise UserError(
                f"{path} has no next_observations: what follows the last step of an episode is in "
                "no other array"
            )
        arrays = {
            name: reader.array(member) for name, member in NAMES.items() if reader.has(member)
        }
        arrays["reward"] = reader.array(next(filter(reader.has, PAIRS), REWARD))
        header = reader.text(key)
        if header is not None:
            arrays |= {name: reader.array(f"{OURS}/{name}") for name in MORE}
        return arrays, header


def d4rl_of(table: Demonstrations, key: str, header: bytes) -> bytes:
    """Return a table as a file in D4RL's layout, whose one reward is r_env.

    Args:
        table: The table.
        key: Name of the attribute with the header.
        header: Bytes of the header.

    Returns:
        The bytes of the file, which also has the columns that D4RL's layout lacks.
    """
    h5py = library("HDF5 files")
    content = io.BytesIO()
    columns = table.arrays()
    with h5py.File(content, "w") as file:
        for name, member in NAMES.items():
            file.create_dataset(member, data=columns[name])
        file.create_dataset(REWARD, data=table.rewards.env)
        file.create_dataset(PAIRS[0], data=np.stack(table.rewards, axis=1))
        for name in MORE:
            file.create_dataset(f"{OURS}/{name}", data=columns[name])
        file.attrs[key] = np.void(header)
    return content.getvalue()
