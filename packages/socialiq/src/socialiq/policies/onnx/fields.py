"""Fields of an ONNX file that a policy may have, checked before any library parses the file.

In Protocol Buffers, messages of two bytes each can ask for millions of objects, so fields are
counted on the wire first. A field outside this table (external data, sparse initialisers,
functions, sub-graphs) refuses the file; the message has its number in onnx.proto.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from socialiq.errors import UserError

MOST_FIELDS = 20_000

_LEAF = None
_Message = Mapping[int, "_Message | None"]

_ENTRY: _Message = {1: _LEAF, 2: _LEAF}  # StringStringEntryProto, OperatorSetIdProto
_DIMENSION: _Message = {1: _LEAF, 2: _LEAF, 3: _LEAF}
_TENSOR_TYPE: _Message = {1: _LEAF, 2: {1: _DIMENSION}}
_TYPE: _Message = {1: _TENSOR_TYPE, 6: _LEAF}
_VALUE: _Message = {1: _LEAF, 2: _TYPE, 3: _LEAF, 4: _ENTRY}
_TENSOR: _Message = dict.fromkeys((1, 2, 4, 5, 7, 8, 9, 10, 12), _LEAF)
_ATTRIBUTE: _Message = dict.fromkeys((1, 2, 3, 4, 7, 8, 13, 20), _LEAF) | {5: _TENSOR}
_NODE: _Message = dict.fromkeys((1, 2, 3, 4, 6, 7), _LEAF) | {5: _ATTRIBUTE, 9: _ENTRY}
_GRAPH: _Message = {1: _NODE, 2: _LEAF, 5: _TENSOR, 10: _LEAF, 16: _ENTRY} | dict.fromkeys(
    (11, 12, 13), _VALUE
)
_MODEL: _Message = dict.fromkeys(range(1, 7), _LEAF) | {7: _GRAPH, 8: _ENTRY, 14: _ENTRY}

_REFUSED = {
    ("tensor", 13): "external data",
    ("tensor", 14): "external data",
    ("graph", 15): "sparse initialisers",
    ("attribute", 6): "sub-graphs",
    ("attribute", 11): "sub-graphs",
    ("attribute", 22): "sparse tensors",
    ("model", 20): "training steps",
    ("model", 25): "functions",
}
_NAMES = {
    id(message): name
    for name, message in (
        ("tensor", _TENSOR),
        ("graph", _GRAPH),
        ("attribute", _ATTRIBUTE),
        ("model", _MODEL),
        ("node", _NODE),
    )
}


def check_fields(content: bytes, source: str) -> None:
    """Refuse a file with unknown or too many fields; cheap in time and memory.

    Args:
        content: The file.
        source: Its name in messages.

    Raises:
        UserError: At the first such field, or where the file is damaged.
    """
    try:
        counted = 0
        waiting = [(_MODEL, 0, len(content))]
        while waiting:
            message, start, end = waiting.pop()
            for number, begin, after in _fields(content, start, end):
                counted += 1
                if counted > MOST_FIELDS:
                    raise UserError(f"{source} has more than {MOST_FIELDS} fields: simplify it")
                if number not in message:
                    raise _refusal(source, message, number)
                inner = message[number]
                if inner is not None:
                    waiting.append((inner, begin, after))
    except (IndexError, ValueError) as error:
        raise UserError(f"{source} is damaged or not an ONNX file: export it again") from error


def _refusal(source: str, message: _Message, number: int) -> UserError:
    name = _NAMES.get(id(message), "type")
    what = _REFUSED.get((name, number), f"field {number} of a {name}")
    return UserError(f"{source} has {what}: export a plain network that holds its own weights")


def _fields(content: bytes, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield number, begin and end of each field of a message, by Protocol Buffers' wire format.

    Raises:
        ValueError: If one reaches beyond the message, or is of a kind that ONNX doesn't use.
        IndexError: If the file ends within a number.
    """
    place = start
    while place < end:
        key, begin = _varint(content, place)
        kind = key & 7
        if kind == 0:
            _, after = _varint(content, begin)
        elif kind == 2:
            length, begin = _varint(content, begin)
            after = begin + length
        elif kind in (1, 5):
            after = begin + (8 if kind == 1 else 4)
        else:
            raise ValueError("group")
        if after > end:
            raise ValueError("beyond the message")
        yield key >> 3, begin, after
        place = after


def _varint(content: bytes, place: int) -> tuple[int, int]:
    """Return a number of at most ten bytes, and the place after it."""
    number = 0
    for count in range(10):
        byte = content[place + count]
        number |= (byte & 127) << (7 * count)
        if byte < 128:
            return number, place + count + 1
    raise ValueError("number of more than ten bytes")
