"""Tensors of a `torch.save` file, without torch and without unpickling.

Such a file is a zip: one member for the bytes of each storage, and `data.pkl`, which describes how
the tensors are made of them. Members are read by name into memory, never extracted; counts and
sizes are bounded before anything is unpacked, so a small file cannot fill the memory.

The pickle is a program for a small stack machine, whose full language can call any function of any
module; loading it runs its author's code (Python's manual warns so). But a network needs few
opcodes: build an ordered dictionary, and rebuild tensors on stored bytes. So `pickletools` reads
the program opcode by opcode, and the machine here has these opcodes only. Its "functions" are the
marks below: no module is imported, and no function is called or looked up by name.
"""

import enum
import io
import math
import pickletools
import re
import struct
import zipfile
import zlib
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line

MOST_MEMBERS = 1_000
"""More than a network of a hundred layers has."""

_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    NotImplementedError,
    OSError,
    OverflowError,
    RuntimeError,
    ValueError,
)
"""Exceptions that `zipfile` raises on a crafted file, by its source."""


class Archive:
    """A zip in memory, called `source` in messages; only what Stable-Baselines3 writes."""

    def __init__(self, content: bytes, source: str) -> None:
        self.source = source
        # An archive may hold others, whose entries are counted too. The count comes first because
        # `zipfile` makes an object for each entry of the directory.
        entry = b"PK\x01\x02"  # begins every entry of a zip's directory (APPNOTE.TXT 4.3.12)
        if content.count(entry) > 3 * MOST_MEMBERS:
            raise self.refusal(f"has more than {MOST_MEMBERS} members")
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(content))
        except _DAMAGE as error:
            raise self.refusal("is damaged or not a zip archive") from error
        members = self._zip.infolist()
        self.names = tuple(member.filename for member in members)
        if len(members) > MOST_MEMBERS:
            raise self.refusal(f"has more than {MOST_MEMBERS} members")
        # Of two members of one name, two programs may read different ones.
        if len(set(self.names)) < len(members):
            raise self.refusal("has two members of one name")
        for member in members:
            name = member.orig_filename
            folders = name.replace("\\", "/").split("/")
            absolute = ":" in folders[0] or name[:1] in ("/", "\\")
            if absolute or "\x00" in name or ".." in folders:
                raise self.refusal("has a member whose path leads outside the archive")
            plain = member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
            if not plain or member.flag_bits & 1:  # bit 0: encrypted
                raise self.refusal("has a member that is encrypted or of a rare compression")

    def read(self, name: str, most: int) -> bytes:
        """Read one member.

        Args:
            name: Name of the member.
            most: Largest number of its bytes.

        Raises:
            UserError: If the archive has no such member, or it is larger or damaged.
        """
        if name not in self.names:
            raise self.refusal(f"has no member {name}")
        if self._zip.getinfo(name).file_size > most:
            raise self.refusal(f"has a member {name} of more than {most:,} bytes")
        try:
            with self._zip.open(name) as file:
                content = file.read(most + 1)  # one more than it has: the checksum comes last
        except _DAMAGE as error:
            raise self.refusal(f"has a damaged member {name}") from error
        return content

    def refusal(self, fault: str) -> UserError:
        """Return the error with a fault of this archive."""
        return UserError(f"{self.source} {fault}: restore the file or save the policy again")


MOST_OPCODES = 20_000
MOST_PROGRAM_BYTES = 1024 * 1024
MOST_TENSOR_BYTES = 16 * 1024 * 1024
MOST_DIMENSION = 16_384


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


class _Refused(Exception):
    """The program has another opcode or name; the text names it."""


def read_state_dict(content: bytes, source: str) -> dict[str, np.ndarray]:
    """Return the named float32 tensors of a `torch.save` file, called `source` in messages.

    Raises:
        UserError: If it is damaged, too large, or has anything but a dictionary of tensors.
    """
    if content.startswith(b"\x80\x02"):
        raise UserError(f"{source} is of torch before 1.6: load the policy and save it again")
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
    lengths = {tensor.member: tensor.length for tensor in stored.values()}
    sizes = [math.prod(tensor.shape) for tensor in stored.values()]
    if 4 * max(sum(lengths.values()), sum(sizes)) > MOST_TENSOR_BYTES:
        raise archive.refusal(f"has tensors of more than {MOST_TENSOR_BYTES:,} bytes")
    raw = {member: archive.read(f"{root}data/{member}", 4 * lengths[member]) for member in lengths}
    tensors = {}
    for (name, tensor), size in zip(stored.items(), sizes, strict=True):
        content = raw[tensor.member]
        offset = tensor.offset
        if len(content) != 4 * tensor.length or offset + size > tensor.length:
            raise archive.refusal("has a tensor larger than its bytes")
        flat = np.frombuffer(content, "<f4", size, 4 * offset)
        tensors[name] = flat.reshape(tensor.shape).astype(np.float32)
    return tensors


class _Machine:
    """The pickle machine's stack and memo, with the few opcodes that a dictionary needs."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}

    def run(self, program: bytes) -> dict[str, Stored]:
        """Return the dictionary that a program makes."""
        for number, (opcode, argument, _) in enumerate(pickletools.genops(program)):
            if number >= MOST_OPCODES:
                raise _Refused(f"more than {MOST_OPCODES} opcodes")
            self.step(opcode.name, argument)
        (tensors,) = self.stack
        if not isinstance(tensors, dict):
            raise _Refused("something other than a dictionary")
        for name, value in tensors.items():
            if not isinstance(value, Stored):
                raise _Refused(f"{one_line(name, 60)} is not a tensor")
        return tensors

    def step(self, name: str, argument: Any) -> None:
        """Run one opcode, as Python's pickletools documents it.

        Args:
            name: Name of the opcode.
            argument: Its argument, as `pickletools.genops` gives it.
        """
        push = self.stack.append
        match name:
            case "BININT" | "BININT1" | "BININT2" | "BINUNICODE":
                push(argument)
            case "NEWFALSE" | "NEWTRUE" | "NONE":
                push({"NEWFALSE": False, "NEWTRUE": True, "NONE": None}[name])
            case "EMPTY_TUPLE" | "TUPLE1" | "TUPLE2" | "TUPLE3":
                push(tuple(self._pop(0 if name == "EMPTY_TUPLE" else int(name[-1]))))
            case "BINPUT" | "LONG_BINPUT":
                self.memo[argument] = self.stack[-1]
            case "BINGET" | "LONG_BINGET":
                push(self.memo[argument])
            case "GLOBAL":
                if argument not in {mark.value for mark in _Known}:
                    raise _Refused(f"the name {one_line(argument, 60)}")
                push(_Known(argument))
            case "MARK":
                push(_MARK)
            case "TUPLE":
                push(tuple(self._to_mark()))
            case "EMPTY_DICT":
                push({})
            case "SETITEM":
                self._fill(self._pop(2))
            case "SETITEMS":
                self._fill(self._to_mark())
            case "BUILD":
                target, attributes = self._pop(2)
                if not isinstance(target, dict) or not isinstance(attributes, dict):
                    raise _Refused("attributes of something else")
                if set(attributes) != {"_metadata"}:  # torch's versions of modules
                    raise _Refused("attributes other than _metadata")
                push(target)
            case "BINPERSID":
                ((tag, kind, member, _device, length),) = self._pop(1)
                if tag != "storage" or kind is not _Known.FLOATS:
                    raise _Refused("a storage of other numbers than float32")
                if not re.fullmatch(r"\d{1,20}", member) or type(length) is not int or length < 0:
                    raise _Refused("a storage without a place")
                push(_Storage(member, length))
            case "REDUCE":
                push(_called(*self._pop(2)))
            case "PROTO" | "STOP":
                pass
            case _:
                raise _Refused(f"opcode {name}")

    def _pop(self, count: int) -> list[Any]:
        if count > len(self.stack):
            raise IndexError("empty stack")
        cut = len(self.stack) - count
        values = self.stack[cut:]
        del self.stack[cut:]
        return values

    def _to_mark(self) -> list[Any]:
        values = []
        while (value := self.stack.pop()) is not _MARK:
            values.append(value)
        return values[::-1]

    def _fill(self, pairs: list[Any]) -> None:
        target = self.stack[-1]
        if not isinstance(target, dict) or len(pairs) % 2:
            raise _Refused("items set on something else")
        for name, value in zip(pairs[::2], pairs[1::2], strict=True):
            if not isinstance(name, str) or name in target:
                raise _Refused("a name that is not text, or occurs twice")
            target[name] = value


def _called(function: Any, arguments: Any) -> Any:
    """Return the result of a call: an empty dictionary, or a tensor."""
    if function is _Known.DICTIONARY and arguments == ():
        return {}
    if function is not _Known.TENSOR:
        raise _Refused("a call")
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
    if strides != tuple(math.prod(shape[axis + 1 :]) for axis in range(len(shape))):
        raise _Refused("a tensor that is not stored row by row")
    return Stored(storage.member, storage.length, offset, shape)
