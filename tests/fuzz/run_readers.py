"""Damaged files for every reader: it returns something valid, or raises `UserError` in one line."""

from __future__ import annotations

import contextlib
import resource
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from tests.fuzz import damage
from tests.fuzz.readers import Reader, content_of, place_of
from tests.fuzz.run_calls import TooLong, limited
from tests.patience import PATIENT

from socialiq.errors import UserError

SECONDS = 10.0
"""Most time of the processor that a reader takes, with a file of at most some 100 KiB."""
MEMORY = 4 << 30
"""Bytes of address space that a reader may take beside those that the process has."""


@contextlib.contextmanager
def limited_memory(most: int = MEMORY) -> Iterator[None]:
    """Let the process take so many more bytes of address space in the body, and no more."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def damaged(reader: Reader, ok: Path, path: Path) -> st.SearchStrategy[bytes]:
    """Return the strategy of damaged files of a reader."""
    sample = ok / reader.sample
    content = sample.read_bytes()
    found = [damage.of_bytes(content)]
    if reader.resealed:
        made = damage.of_content(*content_of(sample), path)
        found += [made, made, made]
    elif sample.suffix in (".zip", ".npz"):
        found += [damage.of_zip(content)] * 2
    elif sample.suffix == ".json":
        found += [damage.of_json(content)] * 2 + [damage.of_words(content)]
    elif sample.suffix != ".onnx":
        found += [damage.of_words(content)] * 3
    return st.one_of(found)


def check(reader: Reader, path: Path) -> bool:
    """Read a file; return whether it was accepted.

    Raises:
        AssertionError: If the reader takes too long.
        Exception: Anything but a `UserError` of one line is the reader's fault.
    """
    try:
        with warnings.catch_warnings(), limited(SECONDS), limited_memory():
            warnings.simplefilter("ignore")
            reader.read(path)
    except UserError as error:
        line = str(error)
        assert len(line) > 10 and "\n" not in line and "\r" not in line, f"not one line: {line!a}"
        return False
    except TooLong as error:
        raise AssertionError(f"longer than {SECONDS:g} s") from error
    return True


class Counts:
    """Numbers of files that a reader was given, and accepted."""

    def __init__(self) -> None:
        self.files = self.accepted = 0


def property_of(
    reader: Reader, ok: Path, work: Path, examples: int, number: int | None, counts: Counts
) -> Callable[[], None]:
    """Return the property of a reader, as a test of hypothesis.

    Args:
        reader: The reader.
        ok: Folder of samples.
        work: Folder for the damaged files.
        examples: Number of files.
        number: Seed; None for the files that hypothesis always draws for this test.
        counts: Counts the files.
    """
    path = place_of(reader, ok, work)

    @settings(
        PATIENT,
        max_examples=examples,
        derandomize=number is None,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
        print_blob=False,
    )
    @given(content=damaged(reader, ok, path))
    def holds(content: bytes) -> None:
        path.write_bytes(content)
        counts.files += 1
        counts.accepted += check(reader, path)

    return holds if number is None else seed(number)(holds)
