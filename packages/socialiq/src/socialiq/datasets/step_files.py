"""Demonstrations in and out as files of plain arrays: .npz, .csv, .parquet, and D4RL's .hdf5."""

import io
import json
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from socialiq.datasets import step_tables
from socialiq.datasets.arrays import Bounds, of_steps
from socialiq.datasets.column_map import ColumnMap, read_map
from socialiq.datasets.hdf5 import d4rl_of, read_d4rl
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.reading import open_file, path_of, sha256_of_file
from socialiq.storage import write_atomically

FORMATS = (".npz", ".csv", ".parquet", ".hdf5")
"""Endings of the files that are read and written."""

ARRAYS = ("observation", "action", "reward", "terminated", "truncated", "ending", "episode")
ARRAYS += ("step", "next_observation", "final_observation", "mode")
"""Arrays of an archive (.npz); the first three are required."""

HEADER = "socialiq"
"""Entry of .npz, .parquet and .hdf5 with the table's header as a JSON object."""


def read_steps(
    path: str | Path,
    *,
    n_actions: int = 0,
    bounds: Bounds | None = None,
    mode_names: tuple[str, ...] = (),
    social: str = "",
    flatten: bool = False,
    columns: Path | None = None,
) -> Demonstrations:
    """Read a file of one row for each step, of `write_steps` or of another program.

    Args:
        path: The file; its ending names the format.
        n_actions: Number of actions of the world; 0 where the file has a header with it, and for
            continuous actions.
        bounds: Ends of continuous actions in the file's units, as in `arrays.of_steps`.
        mode_names: Names of the demonstrators that `mode` numbers; by default the header's, or one.
        social: "none" if a reward of one number a step is r_env, and r_social is 0.
        flatten: Whether observations of more axes (images) are flattened to one; .npz only.
        columns: TOML file of a column map, of a CSV file; modes and episodes may then be text.

    Raises:
        UserError: If the file is missing or damaged, or a column is missing, unknown or wrong; the
            line names it.
    """
    path = path_of(path)
    modes = dict[str, int]()
    if columns is None:
        arrays, header = _read(path)
    else:
        arrays = _mapped(path, read_map(columns), modes)
        header = None
    mode_names = mode_names or tuple(modes)
    done = arrays.pop("done", None)
    if done is not None:
        arrays.setdefault("terminated", done & ~np.asarray(arrays.get("truncated", False)))
    written = _header(path, header)
    if written:
        n_actions = _agreed(path, "the number of actions", n_actions, written["n_actions"])
        bounds = _agreed(path, "the bounds of actions", bounds, None)
        mode_names = _agreed(path, "the modes", mode_names, tuple(written["mode_names"]))
    elif n_actions < 1 and np.asarray(arrays["action"]).dtype.kind != "f":
        raise UserError(f"{path} has no number of actions: pass --n-actions")
    source = written["source"] if written else source_of(path)
    options: dict[str, Any] = {"social": social, "flatten": flatten, "source": source}
    options |= {"bounds": bounds, "mode_names": mode_names or ("demonstrator",)}
    try:
        table = of_steps(**arrays, n_actions=n_actions, **options)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    if written and written["sha256"] != files.sha256_of(table):
        raise UserError(
            f"{path} is not what was written (its SHA-256 differs): write it again, or remove its "
            f"{HEADER} entry"
        )
    return table


def write_steps(path: str | Path, table: Demonstrations, replace: bool = True) -> None:
    """Write every column of a table, so that `read_steps` gives it back to the bit.

    A CSV file has no place for the names of the modes, the number of actions and the source; the
    other formats keep them.

    Args:
        path: The file; its ending, one of `FORMATS`, names the format.
        table: The table.
        replace: Whether an existing file may be replaced.

    Raises:
        UserError: If the ending is unknown, or the file can't be written.
    """
    path = path_of(path)
    kind = format_of(path)
    header = json.dumps({**files.header_of(table), "sha256": files.sha256_of(table)}).encode()
    if kind == ".csv":
        content = step_tables.csv_of(step_tables.columns_of(table))
    elif kind == ".parquet":
        content = step_tables.parquet_of(step_tables.columns_of(table), HEADER, header)
    elif kind == ".hdf5":
        content = d4rl_of(table, HEADER, header)
    else:
        arrays = table.arrays()
        arrays["reward"] = np.stack([arrays.pop("r_env"), arrays.pop("r_social")], axis=1)
        arrays[HEADER] = np.frombuffer(header, np.uint8)
        file = io.BytesIO()
        np.savez_compressed(file, allow_pickle=False, **arrays)
        content = file.getvalue()
    write_atomically(path, content, replace)


def format_of(path: Path) -> str:
    """Return the format that a file's ending names, one of `FORMATS`; `UserError` otherwise."""
    one_of("format", path.suffix.lower(), FORMATS)
    return path.suffix.lower()


def source_of(path: Path) -> dict[str, Any]:
    """Return where data came from: the file's name and the SHA-256 of its bytes."""
    sha256 = sha256_of_file(path)
    return {"made_by": "socialiq data", "file": path.name, "sha256": sha256}


def _read(path: Path) -> tuple[dict[str, Any], bytes | None]:
    kind = format_of(path)
    if kind == ".npz":
        arrays: dict[str, Any] = read_npz(path, (*ARRAYS, HEADER))
        missing = [name for name in ARRAYS[:3] if name not in arrays]
        if missing:
            raise UserError(f"{path} has no {', '.join(missing)}: save them by these names")
        header = arrays.pop(HEADER, None)
        return arrays, None if header is None else header.tobytes()
    if kind == ".hdf5":
        return read_d4rl(path, HEADER)
    if kind == ".csv":
        columns = step_tables.read_csv(path)
        header = None
    else:
        columns, header = step_tables.read_parquet(path, HEADER)
    return step_tables.STEPS.arrays_of(columns, str(path)), header


def _mapped(path: Path, columns: ColumnMap, modes: dict[str, int]) -> dict[str, Any]:
    """Return the arrays of a CSV file by a column map; number its modes in `modes`."""
    if format_of(path) != ".csv":
        raise UserError(f"{path} is no CSV file: leave the column map out, and name its columns")
    readers: dict[str, Any] = {
        columns.names[column]: partial(columns.number_of, column) for column in columns.words
    }
    for name, numbers in (("mode", modes), ("episode", dict[str, int]())):
        readers[name] = lambda cell, numbers=numbers: numbers.setdefault(cell, len(numbers))
    read = step_tables.read_csv(path, mapped=columns.names, readers=readers)
    return step_tables.STEPS.arrays_of(columns.applied(read), str(path))


def _header(path: Path, header: bytes | None) -> dict[str, Any] | None:
    """Return the header that `write_steps` added, if any; refuse any other."""
    if header is None:
        return None
    try:
        written = json.loads(header)
    except (ValueError, RecursionError):
        written = None
    kinds = {"mode_names": list, "n_actions": int, "source": dict, "sha256": str}
    if not isinstance(written, dict) or not all(
        isinstance(written.get(name), kind) for name, kind in kinds.items()
    ):
        raise UserError(f"{path} has a {HEADER} entry that cannot be read: remove it")
    return written


def _agreed(path: Path, what: str, option: Any, written: Any) -> Any:
    """Return the file's own value; refuse an option that differs."""
    if option and option != written:
        raise UserError(f"{path} has {what}: {written}, not {option}: leave the option out")
    return written


MOST_BYTES = 2 * 1024**3
"""Largest size of all arrays of one archive together."""

_MEMBERS = 1_000
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_FAULTS = (
    KeyError,  # of an unknown version
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
    """Read arrays of numbers in an archive of NumPy, of unknown origin, without unpickling.

    The header of a member is checked against its size before memory is allocated: NumPy itself
    would allocate an array of any shape that the header claims.

    Args:
        path: The archive.
        names: Names of the arrays to read; members of other names are never opened.

    Returns:
        The arrays by name. A name that the archive lacks is left out.

    Raises:
        UserError: If the archive is damaged or too large, or an array does not hold numbers.
    """
    try:
        with open_file(path) as file, zipfile.ZipFile(file) as archive:
            members = {member.filename: member for member in archive.infolist()[:_MEMBERS]}
            members = {name: members[f"{name}.npy"] for name in names if f"{name}.npy" in members}
            if sum(member.file_size for member in members.values()) > MOST_BYTES:
                raise UserError(f"{path} holds more than {MOST_BYTES:,} bytes: split it")
            arrays = {}
            for name, member in members.items():
                with archive.open(member) as content:
                    version = npy.read_magic(content)
                    shape, _, dtype = _HEADERS[version](content)
                    start = content.tell()
                if dtype.kind not in "fiub":
                    raise UserError(
                        f"{path}: {name} is {dtype.kind!r}, not an array of numbers: save numbers"
                    )
                size = start + math.prod(shape) * dtype.itemsize
                if min(shape, default=0) < 0 or size != member.file_size:
                    raise UserError(
                        f"{path}: {name} has another size than its header: save it again"
                    )
                with archive.open(member) as content:
                    arrays[name] = npy.read_array(content, allow_pickle=False)
            return arrays
    except UserError:
        raise
    except _FAULTS as error:
        raise UserError(f"{path} is damaged or no .npz archive: save it again") from error
