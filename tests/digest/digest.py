"""Hashes of arrays and tables, and the list of items that have them.

An item is a function that yields a name and a SHA-256 for each of its tables. Floats that come from
training or from a study are rounded to 6 significant digits first, because their last digits depend
on the model of the CPU; those of the cores of simulation are hashed as they are, to the last bit.
Keys are named by content, not by module.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

DIGITS = 6
"""Significant digits of a rounded float."""

FILE = Path(__file__).with_name("digest.json")

Hashes = dict[str, str]


class Item(NamedTuple):
    """Tables that are computed together.

    Attributes:
        name: Beginning of their keys.
        compute: Returns a SHA-256 by table, given an empty folder.
        needs: Modules of optional extras.
        quick: Whether it is part of `make test`.
    """

    name: str
    compute: Callable[[Path], Hashes]
    needs: tuple[str, ...] = ()
    quick: bool = False

    @property
    def missing(self) -> list[str]:
        """Modules that are not installed."""
        return [name for name in self.needs if importlib.util.find_spec(name) is None]

    def hashes(self) -> Hashes:
        """Compute the hashes by full key."""
        with tempfile.TemporaryDirectory() as folder:
            tables = self.compute(Path(folder))
        return {f"{self.name}/{table}": value for table, value in tables.items()}


def of_bytes(content: bytes) -> str:
    """Return the SHA-256 of bytes."""
    return hashlib.sha256(content).hexdigest()


def of_array(values: Any, exact: bool = False) -> str:
    """Return the SHA-256 of an array: type, shape and content.

    Args:
        values: The array.
        exact: Whether floats are hashed to the last bit instead of to `DIGITS` digits.
    """
    array = np.asarray(values)
    whole = hashlib.sha256(f"{array.dtype.str}{array.shape}".encode())
    parts = (array,) if exact or array.dtype.kind != "f" else significant(array)
    for part in parts:
        whole.update(np.ascontiguousarray(part).tobytes())
    return whole.hexdigest()


def significant(array: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mantissas of `DIGITS` digits, and exponents; 0 and what is not finite have a code."""
    wide = array.astype(np.float64)
    regular = np.isfinite(wide) & (wide != 0.0)
    exponent = np.zeros(wide.shape, np.int64)
    exponent[regular] = np.floor(np.log10(np.abs(wide[regular]))).astype(np.int64)
    mantissa = np.zeros(wide.shape, np.int64)
    scaled = wide[regular] * 10.0 ** (DIGITS - 1 - exponent[regular])
    mantissa[regular] = np.rint(scaled).astype(np.int64)
    for code, selected in enumerate((np.isnan(wide), wide == np.inf, wide == -np.inf), start=1):
        exponent[selected] = 10_000 + code
    return mantissa, exponent


def of_arrays(arrays: Mapping[str, Any], exact: bool = False) -> str:
    """Return the SHA-256 of arrays by name, in the order of their names."""
    return of_plain({name: of_array(arrays[name], exact) for name in sorted(arrays)})


def of_tree(tree: Any, exact: bool = False) -> str:
    """Return the SHA-256 of the arrays of a tree of JAX, in the order of their paths."""
    import jax

    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    arrays = {}
    for path, leaf in leaves:
        if hasattr(leaf, "dtype") and jax.numpy.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            leaf = jax.random.key_data(leaf)
        arrays[jax.tree_util.keystr(path)] = leaf
    return of_arrays(arrays, exact)


def plain(value: Any, digits: int = DIGITS) -> Any:
    """Return data for canonical JSON: floats as text of so many digits, mappings sorted."""
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        return f"{value + 0.0:.{digits}g}" if math.isfinite(value) and value else f"{value + 0.0}"
    if isinstance(value, Mapping):
        return {str(name): plain(entry, digits) for name, entry in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist(), digits)
    if isinstance(value, tuple | list):
        return [plain(entry, digits) for entry in value]
    raise TypeError(f"{type(value).__name__} has no plain form")


def of_plain(value: Any, digits: int = DIGITS) -> str:
    """Return the SHA-256 of plain values as canonical JSON, floats rounded."""
    text = json.dumps(plain(value, digits), sort_keys=True, separators=(",", ":"))
    return of_bytes(text.encode())


def computed(
    items: Iterable[Item], say: Callable[[str], None] = print
) -> tuple[Hashes, list[str], list[str]]:
    """Compute items one after the other.

    Args:
        items: The items.
        say: Prints a line.

    Returns:
        Hashes by key, names of the items without their extra, and names of those that failed.
    """
    hashes: Hashes = {}
    skipped: list[str] = []
    failed: list[str] = []
    for item in items:
        begin = time.perf_counter()
        if item.missing:
            skipped.append(item.name)
            say(f"skipped {item.name}: needs {', '.join(item.missing)}")
            continue
        try:
            hashes |= item.hashes()
        except Exception as error:  # the other items are compared all the same
            failed.append(item.name)
            say(f"FAILED {item.name}: {type(error).__name__}: {error}")
            continue
        say(f"{item.name}: {time.perf_counter() - begin:.1f} s")
    return hashes, skipped, failed


def differences(
    items: Sequence[Item], hashes: Hashes, skipped: Sequence[str], failed: Sequence[str]
) -> Iterator[str]:
    """Yield a line for each table that differs from the file, is missing or is new.

    Args:
        items: The items that were computed.
        hashes: What they gave.
        skipped: Items whose extra is not installed; they are not compared.
        failed: Items that raised an error.
    """
    stored = read()
    compared = [item.name for item in items if item.name not in (*skipped, *failed)]
    yield from (f"failed: {name}" for name in failed)
    for name in compared:
        before = {key: value for key, value in stored.items() if key.startswith(f"{name}/")}
        after = {key: value for key, value in hashes.items() if key.startswith(f"{name}/")}
        yield from (f"missing: {key}" for key in sorted(before.keys() - after.keys()))
        yield from (f"new: {key}" for key in sorted(after.keys() - before.keys()))
        both = sorted(before.keys() & after.keys())
        yield from (f"differs: {key}" for key in both if before[key] != after[key])


def read() -> Hashes:
    """Return the committed hashes."""
    return json.loads(FILE.read_text()) if FILE.is_file() else {}


def write(hashes: Hashes) -> None:
    """Replace the committed hashes."""
    FILE.write_text(json.dumps(hashes, indent=1, sort_keys=True) + "\n")
