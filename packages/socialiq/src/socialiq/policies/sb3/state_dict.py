"""Tensors of a `torch.save` file, without torch and without unpickling.

Such a file is a zip: one member for the bytes of each storage, and `data.pkl`, which describes how
the tensors are made of them. That pickle is a program for a small stack machine, whose full
language can call any function of any module; loading it runs its author's code (Python's manual
warns so). But a network needs few opcodes: build an ordered dictionary, and rebuild tensors on
stored bytes. So `pickletools` reads the program opcode by opcode, and the machine here has these
opcodes only. Its "functions" are the marks below: nothing is imported, called or looked up by name.
"""

from __future__ import annotations

import enum
import math
import pickletools
import re
from typing import Any, NamedTuple

import numpy as np

from socialiq.foreign import one_line
from socialiq.policies.sb3.archive import Archive

MOST_OPCODES = 20_000
MOST_PROGRAM_BYTES = 1024 * 1024
MOST_TENSOR_BYTES = 16 * 1024 * 1024
MOST_DIMENSION = 16_384

_MEMBER = re.compile(r"\d{1,4}")


class _Known(enum.Enum):
    """Names that the program may contain."""

    DICTIONARY = "collections OrderedDict"
    TENSOR = "torch._utils _rebuild_tensor_v2"
    FLOATS = "torch FloatStorage"


class _Storage(NamedTuple):
    """A run of float32 numbers in a member of the archive."""

    member: str
    length: int


class Stored(NamedTuple):
    """Position of a tensor, its shape checked against its strides."""

    member: str
    length: int
    offset: int
    shape: tuple[int, ...]


_MARK = object()
_CONSTANTS = {"NEWFALSE": False, "NEWTRUE": True, "NONE": None}
_NUMBERS = ("BININT", "BININT1", "BININT2")
_SMALL_TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_PUTS, _GETS = ("BINPUT", "LONG_BINPUT"), ("BINGET", "LONG_BINGET")


class _Refused(Exception):
    """The program has another opcode or name; the text names it."""


def read_state_dict(content: bytes, source: str) -> dict[str, np.ndarray]:
    """Return the named float32 tensors of a `torch.save` file.

    Args:
        content: The file.
        source: Its name in messages.

    Raises:
        UserError: If it is damaged, too large, or has anything but a dictionary of tensors.
    """
    archive = Archive(content, source)
    programs = [name for name in archive.names if name.endswith("/data.pkl")]
    if len(programs) != 1:
        raise archive.refusal("has no single data.pkl")
    root = programs[0].removesuffix("data.pkl")
    # torch before 2.1 wrote no such member. Numbers in the wrong byte order could be finite, so the
    # member is checked.
    order = f"{root}byteorder"
    if order in archive.names and archive.read(order, 16) != b"little":
        raise archive.refusal("holds big-endian numbers")
    try:
        stored = _Machine().run(archive.read(programs[0], MOST_PROGRAM_BYTES))
    except _Refused as error:
        raise archive.refusal(f"holds more than tensors ({error})") from error
    except (ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
        raise archive.refusal("has a damaged data.pkl") from error
    # Several tensors may share one storage, so the bytes of both are bounded.
    lengths = {one.member: one.length for one in stored.values()}
    sizes = [math.prod(one.shape) for one in stored.values()]
    if 4 * max(sum(lengths.values()), sum(sizes)) > MOST_TENSOR_BYTES:
        raise archive.refusal(f"has tensors of more than {MOST_TENSOR_BYTES:,} bytes")
    raw = {member: archive.read(f"{root}data/{member}", 4 * lengths[member]) for member in lengths}
    return {name: _tensor(archive, raw[one.member], one) for name, one in stored.items()}


def _tensor(archive: Archive, raw: bytes, stored: Stored) -> np.ndarray:
    size = math.prod(stored.shape)
    if len(raw) != 4 * stored.length or stored.offset + size > stored.length:
        raise archive.refusal("has a tensor larger than its bytes")
    flat = np.frombuffer(raw, "<f4", size, 4 * stored.offset)
    return flat.reshape(stored.shape).astype(np.float32)


class _Machine:
    """The pickle machine's stack and memo, with the few opcodes that a dictionary needs."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}

    def run(self, program: bytes) -> dict[str, Stored]:
        """Return the dictionary that a program makes.

        Raises:
            _Refused: At the first opcode or name that is not known.
        """
        for number, (opcode, argument, _) in enumerate(pickletools.genops(program)):
            if number >= MOST_OPCODES:
                raise _Refused(f"more than {MOST_OPCODES} opcodes")
            self.step(opcode.name, argument)
        (found,) = self.stack
        if not isinstance(found, dict):
            raise _Refused("something other than a dictionary")
        for name, value in found.items():
            if not isinstance(value, Stored):
                raise _Refused(f"{one_line(name, 60)} is not a tensor")
        return found

    def step(self, name: str, argument: Any) -> None:
        """Run one opcode, as Python's pickletools documents it."""
        if name in _NUMBERS or name == "BINUNICODE":
            self.stack.append(argument)
        elif name in _CONSTANTS:
            self.stack.append(_CONSTANTS[name])
        elif name in _SMALL_TUPLES:
            self.stack.append(tuple(self._pop(_SMALL_TUPLES[name])))
        elif name in _PUTS:
            self.memo[argument] = self.stack[-1]
        elif name in _GETS:
            self.stack.append(self.memo[argument])
        elif name == "GLOBAL":
            self.stack.append(_known(argument))
        elif name in _BUILDERS:
            _BUILDERS[name](self)
        elif name not in ("PROTO", "STOP"):
            raise _Refused(f"opcode {name}")

    def _pop(self, count: int) -> list[Any]:
        if count > len(self.stack):
            raise IndexError("empty stack")
        cut = len(self.stack) - count
        taken = self.stack[cut:]
        del self.stack[cut:]
        return taken

    def _to_mark(self) -> list[Any]:
        taken = []
        while (one := self.stack.pop()) is not _MARK:
            taken.append(one)
        return taken[::-1]

    def mark(self) -> None:
        """Remember this place of the stack."""
        self.stack.append(_MARK)

    def to_tuple(self) -> None:
        """Push a tuple of everything from the mark on."""
        self.stack.append(tuple(self._to_mark()))

    def dictionary(self) -> None:
        """Push an empty dictionary."""
        self.stack.append({})

    def set_item(self) -> None:
        """Set one name to its value."""
        self._fill(self._pop(2))

    def set_items(self) -> None:
        """Set names to values, from the mark on."""
        self._fill(self._to_mark())

    def _fill(self, pairs: list[Any]) -> None:
        target = self.stack[-1]
        if not isinstance(target, dict) or len(pairs) % 2:
            raise _Refused("items set on something else")
        for name, value in zip(pairs[::2], pairs[1::2], strict=True):
            if not isinstance(name, str) or name in target:
                raise _Refused("a name that is not text, or occurs twice")
            target[name] = value

    def build(self) -> None:
        """Accept attributes of the dictionary: only `_metadata`, torch's versions of modules."""
        target, attributes = self._pop(2)
        if not isinstance(target, dict) or not isinstance(attributes, dict):
            raise _Refused("attributes of something else")
        if set(attributes) != {"_metadata"}:
            raise _Refused("attributes other than _metadata")
        self.stack.append(target)

    def persistent(self) -> None:
        """Push a storage: ("storage", kind, member, device, length)."""
        (words,) = self._pop(1)
        tag, kind, member, _device, length = words
        if tag != "storage" or kind is not _Known.FLOATS:
            raise _Refused("a storage of other numbers than float32")
        if not _MEMBER.fullmatch(member) or type(length) is not int or length < 0:
            raise _Refused("a storage without a place")
        self.stack.append(_Storage(member, length))

    def reduce(self) -> None:
        """Push the result of a call: an empty dictionary, or a tensor."""
        function, arguments = self._pop(2)
        if function is _Known.DICTIONARY and arguments == ():
            self.stack.append({})
        elif function is _Known.TENSOR:
            self.stack.append(_stored(arguments))
        else:
            raise _Refused("a call")


_BUILDERS = {
    "MARK": _Machine.mark,
    "TUPLE": _Machine.to_tuple,
    "EMPTY_DICT": _Machine.dictionary,
    "SETITEM": _Machine.set_item,
    "SETITEMS": _Machine.set_items,
    "BUILD": _Machine.build,
    "BINPERSID": _Machine.persistent,
    "REDUCE": _Machine.reduce,
}


def _known(name: str) -> _Known:
    try:
        return _Known(name)
    except ValueError as error:
        raise _Refused(f"the name {one_line(name, 60)}") from error


def _stored(arguments: Any) -> Stored:
    """Return a tensor of (storage, offset, shape, strides, requires_grad, hooks)."""
    storage, offset, shape, strides, _gradient, hooks = arguments
    if not isinstance(storage, _Storage) or hooks != {}:
        raise _Refused("a tensor with hooks or without a storage")
    if not isinstance(shape, tuple) or not isinstance(strides, tuple):
        raise _Refused("a tensor without a shape")
    numbers = (offset, *shape, *strides)
    if any(type(number) is not int or number < 0 for number in numbers):
        raise _Refused("a tensor whose shape is not integers")
    if len(shape) > 2 or max(shape, default=0) > MOST_DIMENSION:
        raise _Refused(f"a tensor of shape {one_line(str(shape), 60)}")
    rows = tuple(math.prod(shape[place + 1 :]) for place in range(len(shape)))
    if strides != rows:
        raise _Refused("a tensor that is not stored row by row")
    return Stored(storage.member, storage.length, offset, shape)
