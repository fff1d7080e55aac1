"""Hashes of arrays and tables, and the list of items that have them.

An item is a function that yields a name and an entry for each of its tables. The cores of
simulation give the same bits on every machine, so their entry is a SHA-256. The last digits of
floats that come from training or from a study depend on the model of the CPU, so their entry is a
sketch: the SHA-256 of everything but the floats, and three sums over the floats, which are compared
with a tolerance. Keys are named by content, not by module.
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

TOLERANCE = 1e-5
"""Largest difference of two sums of a sketch.

A sum moves by about the root mean square of the floats' relative changes. When XLA fuses
multiplications and additions (`--xla_cpu_max_isa=AVX2`), the sums of the items
`learner/iq_learn/online` and `offline` move by at most 3e-8.
"""

SCALE = 1e-3
"""Magnitude below which a float's absolute change counts, and above which its relative change."""

FREQUENCIES = (math.sqrt(2.0), math.sqrt(3.0), math.sqrt(5.0))
"""Radians from one float to the next in the three sums' weights."""

SKETCH = "~"
"""First character of a sketch."""

FILE = Path(__file__).with_name("digest.json")

Hashes = dict[str, str]


class Item(NamedTuple):
    """Tables that are computed together.

    Attributes:
        name: Beginning of their keys.
        compute: Returns an entry by table, given an empty folder.
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
    """Return the entry of an array: type, shape and content.

    Args:
        values: The array.
        exact: Whether floats are hashed to the last bit instead of sketched.
    """
    array = np.asarray(values)
    head = f"{array.dtype.str}{array.shape}".encode()
    if exact or array.dtype.kind != "f":
        return of_bytes(head + np.ascontiguousarray(array).tobytes())
    finite = np.isfinite(array)
    others = np.where(finite, 0.0, array).astype(np.float32)
    return sketch(head + others.tobytes(), array[finite].tolist())


def sketch(content: bytes, numbers: Sequence[float]) -> str:
    """Return the SHA-256 of content and three weighted sums of numbers.

    Args:
        content: What is compared exactly.
        numbers: Finite floats, in a fixed order.
    """
    scaled = np.arcsinh(np.asarray(numbers, np.float64) / SCALE)
    places = np.arange(len(scaled))
    sums = [scaled @ np.cos(frequency * places) for frequency in FREQUENCIES]
    words = [f"{total / math.sqrt(max(len(scaled), 1)):.9g}" for total in sums]
    return " ".join([f"{SKETCH}{of_bytes(content)}:{len(scaled)}", *words])


def equal(before: str, after: str) -> bool:
    """Return whether two entries are of the same table: sums may differ by `TOLERANCE`."""
    if not (before.startswith(SKETCH) and after.startswith(SKETCH)):
        return before == after
    head, *sums = before.split()
    head_after, *sums_after = after.split()
    distances = [abs(float(one) - float(two)) for one, two in zip(sums, sums_after, strict=True)]
    return head == head_after and max(distances) <= TOLERANCE


def of_arrays(arrays: Mapping[str, Any], exact: bool = False) -> str:
    """Return the entry of arrays by name, in the order of their names."""
    return of_plain({name: of_array(arrays[name], exact) for name in sorted(arrays)})


def plain(value: Any, numbers: list[float]) -> Any:
    """Return data for canonical JSON without its floats, mappings sorted.

    Args:
        value: Plain values and entries.
        numbers: Gets the floats, and the sums of sketches.
    """
    if isinstance(value, str) and value.startswith(SKETCH):
        head, *sums = value.split()
        numbers.extend(map(float, sums))
        return head
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            return str(value)
        numbers.append(value)
        return "float"
    if isinstance(value, Mapping):
        by_name = {str(name): entry for name, entry in value.items()}
        return {name: plain(by_name[name], numbers) for name in sorted(by_name)}
    if hasattr(value, "tolist"):
        return plain(value.tolist(), numbers)
    if isinstance(value, tuple | list):
        return [plain(entry, numbers) for entry in value]
    raise TypeError(f"{type(value).__name__} has no plain form")


def of_plain(value: Any) -> str:
    """Return the entry of plain values as canonical JSON: a sketch if there are floats."""
    numbers: list[float] = []
    text = json.dumps(plain(value, numbers), sort_keys=True, separators=(",", ":"))
    return sketch(text.encode(), numbers) if numbers else of_bytes(text.encode())


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
        yield from (f"differs: {key}" for key in both if not equal(before[key], after[key]))


def read() -> Hashes:
    """Return the committed hashes."""
    return json.loads(FILE.read_text()) if FILE.is_file() else {}


def write(hashes: Hashes) -> None:
    """Replace the committed hashes."""
    FILE.write_text(json.dumps(hashes, indent=1, sort_keys=True) + "\n")
