import io
import json
import struct
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[3] / "examples" / "policies"
DICTIONARY = b"ccollections\nOrderedDict\n)R"
REBUILD = b"ctorch._utils\n_rebuild_tensor_v2\n"
FLOATS = b"ctorch\nFloatStorage\n"


def word(text: str) -> bytes:
    """BINUNICODE"""
    return b"X" + struct.pack("<I", len(text.encode())) + text.encode()


def number(value: int) -> bytes:
    """BININT"""
    return b"J" + struct.pack("<i", value)


def numbers(values: tuple[int, ...]) -> bytes:
    return b"(" + b"".join(number(one) for one in values) + b"t"


def storage(member: str, length: int, kind: bytes = FLOATS) -> bytes:
    return b"(" + word("storage") + kind + word(member) + word("cpu") + number(length) + b"tQ"


def tensor(
    stored: bytes, shape: tuple[int, ...], strides: tuple[int, ...] | None = None, offset: int = 0
) -> bytes:
    rows = tuple(int(np.prod(shape[place + 1 :])) for place in range(len(shape)))
    placed = number(offset) + numbers(shape) + numbers(rows if strides is None else strides)
    return REBUILD + b"(" + stored + placed + b"\x89" + DICTIONARY + b"tR"


def program(values: Mapping[str, bytes]) -> bytes:
    """Bytes that `torch.save` writes of a dictionary, by hand."""
    pairs = b"".join(word(name) + value for name, value in values.items())
    return b"\x80\x02" + DICTIONARY + b"(" + pairs + b"u."


def zipped(members: Mapping[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def pth(arrays: Mapping[str, np.ndarray], **members: bytes) -> bytes:
    """A `torch.save` file of float32 arrays; members replace those it would have."""
    made = {}
    stored = {"archive/byteorder": b"little"}
    for place, (name, array) in enumerate(arrays.items()):
        made[name] = tensor(storage(str(place), array.size), array.shape)
        stored[f"archive/data/{place}"] = array.astype("<f4").tobytes()
    return zipped({"archive/data.pkl": program(made)} | stored | members)


def data_of(zip_file: Path) -> dict:
    with zipfile.ZipFile(zip_file) as archive:
        return json.loads(archive.read("data"))


@contextmanager
def bounded(most: int) -> Iterator[None]:
    """Fail if Python allocates more bytes than that at a time."""
    tracemalloc.start()
    try:
        yield
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < most, f"{peak:,} bytes"


class Crafted:
    """The builders above, for tests: modules of tests can't import one another."""

    examples = EXAMPLES
    word, number, numbers, storage = map(staticmethod, (word, number, numbers, storage))
    tensor, program, zipped, pth = map(staticmethod, (tensor, program, zipped, pth))
    data_of = staticmethod(data_of)
    bounded: Callable[[int], AbstractContextManager[None]] = staticmethod(bounded)


@pytest.fixture(scope="session")
def crafted():
    return Crafted
