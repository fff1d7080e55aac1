"""Weights of an ONNX policy in files beside it (ONNX's external data), made a part of the model.

The file names each of them, and may come from anyone: so only files of its own folder are read, of
limited size, and every range is checked against the tensor that it fills. What is read here is
hashed with the file (`sha256_of_parts`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies.interface import MOST_BYTES, read_content
from socialiq.reading import sha256_of

DATA_FILES = "data_files"
"""Detail of a policy's record: names of the files beside its own that hold a part of it."""

_KEYS = {"location", "offset", "length", "checksum"}
"""Keys of a tensor's entry; its checksum is not read, because the hash covers the data."""

ONE_FILE = "export it again with external_data=False"
"""Mend of a policy whose further files can't be used."""

_NUMBER = re.compile(r"[0-9]{1,18}")
_SEPARATORS = frozenset("/\\:")


def with_data(onnx: Any, model: Any, folder: Path, source: str) -> dict[str, bytes]:
    """Move the numbers that lie in other files into the model's own tensors.

    Args:
        onnx: The library.
        model: The model, which is changed; its fields are checked (`onnx_load.check_fields`).
        folder: Folder of the model's file.
        source: Name of the file in messages.

    Returns:
        The bytes of each other file by its name, in the order of the names; none of a model that
        holds all its numbers.

    Raises:
        UserError: If a file is missing, not in the folder or too large, or a range does not fit.
    """
    data: dict[str, bytes] = {}
    filled = 0
    for tensor in _tensors(model.graph):
        words = {entry.key: entry.value for entry in tensor.external_data}
        is_outside = tensor.data_location == onnx.TensorProto.EXTERNAL
        del tensor.external_data[:]
        tensor.ClearField("data_location")
        if not is_outside:
            continue
        name = words.get("location", "")
        if not words.keys() <= _KEYS:
            unknown = one_line(", ".join(sorted(words.keys() - _KEYS)), 60)
            raise UserError(f"{source} has external data with {unknown}: {ONE_FILE}")
        if name not in data:
            left = MOST_BYTES - sum(map(len, data.values()))
            data[name] = read_content(data_file(folder, name, source), left)
        size = onnx.helper.tensor_dtype_to_np_dtype(tensor.data_type).itemsize
        size *= math.prod(tensor.dims)
        begin = _whole(words.get("offset", "0"))
        length = _whole(words.get("length", str(len(data[name]) - begin)))
        if min(begin, length) < 0 or length != size or begin + size > len(data[name]):
            raise UserError(
                f"{source} has a tensor of {size:,} bytes that {one_line(name, 60)} does not hold: "
                f"copy both files again, or {ONE_FILE}"
            )
        filled += size
        if filled > MOST_BYTES:
            raise UserError(f"{source} has weights of more than {MOST_BYTES:,} bytes: {ONE_FILE}")
        plain = {"name": tensor.name, "dims": tensor.dims, "data_type": tensor.data_type}
        content = data[name][begin : begin + size]
        tensor.CopyFrom(onnx.TensorProto(**plain, raw_data=content))
    return dict(sorted(data.items()))


def data_file(folder: Path, name: str, source: str) -> Path:
    """Return the path of a file with weights of a policy.

    Args:
        folder: Folder of the policy's file.
        name: Name of the file, as the policy says it.
        source: Name of the policy in messages.

    Raises:
        UserError: If there is no such file, or it is not one of the folder itself.
    """
    says = f"{source} keeps its weights in {one_line(name, 60) or 'no file'}"
    is_plain = name not in ("", ".", "..") and name.isprintable() and not _SEPARATORS & set(name)
    if not is_plain or len(name.encode()) > 255:
        raise UserError(f"{says}, which is no file of its own folder: {ONE_FILE}")
    path = folder / name
    if not path.exists():
        raise UserError(f"{says}, which is not beside it: copy both files, or {ONE_FILE}")
    if path.resolve().parent != folder.resolve():
        raise UserError(f"{says}, a link that leaves its folder: {ONE_FILE}")
    return path.resolve()


def sha256_of_parts(content: bytes, data: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of a policy of one file or several.

    Args:
        content: Bytes of the policy's file.
        data: Bytes of the files beside it, of `with_data`.

    Returns:
        The file's own hash; of several files `sha256sum FILE ... | cut -c-64 | sha256sum`.
    """
    if not data:
        return sha256_of(content)
    return sha256_of("".join(f"{sha256_of(part)}\n" for part in (content, *data.values())))


def _tensors(graph: Any) -> Iterator[Any]:
    """Yield the tensors of a graph and of the graphs in it."""
    waiting = [graph]
    while waiting:
        graph = waiting.pop()
        yield from graph.initializer
        for attribute in (attribute for node in graph.node for attribute in node.attribute):
            if attribute.HasField("t"):
                yield attribute.t
            if attribute.HasField("g"):
                waiting.append(attribute.g)


def _whole(text: str) -> int:
    """Return the number that a text says; -1, which fits nowhere, of any other text."""
    return int(text) if _NUMBER.fullmatch(text) else -1
