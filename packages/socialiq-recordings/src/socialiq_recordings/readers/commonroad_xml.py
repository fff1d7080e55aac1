"""Streaming reader of CommonRoad XML, with its kinds of obstacles and numbers of signs."""

import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, runtime_checkable
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import open_file
from socialiq_recordings.recording import RoadUser
from socialiq_recordings.road.network import Colour, Sign

VERSIONS = ("2017a", "2017b", "2018a", "2018b", "2020a")
IN_SECONDS = ("2017a", "2017b")
"""Versions in which some files give times in seconds, with a decimal point."""

TYPES = {
    "car": RoadUser.CAR,
    "taxi": RoadUser.CAR,
    "parkedVehicle": RoadUser.CAR,
    "truck": RoadUser.TRUCK,
    "bus": RoadUser.BUS,
    "motorcycle": RoadUser.MOTORCYCLE,
    "bicycle": RoadUser.BICYCLE,
    "pedestrian": RoadUser.PEDESTRIAN,
    "priorityVehicle": RoadUser.OTHER,
    "train": RoadUser.OTHER,
    "unknown": RoadUser.OTHER,
}
"""Classes of road users. An emergency vehicle is not a car: others make way for it."""

SIGNS = {
    "205": Sign.YIELD,
    "206": Sign.STOP,
    "301": Sign.PRIORITY,
    "306": Sign.PRIORITY,
    "R1-1": Sign.STOP,
    "R1-2": Sign.YIELD,
    "r1": Sign.YIELD,
    "r2": Sign.STOP,
}
"""Numbers of right-of-way signs, as Germany (and the fictitious country ZAM), the USA,
Australia and Spain number them; no number has different meanings in two countries."""

SPEED_LIMITS = ("274", "R2-1", "R15", "r301", "3.24", "C43", "B14", "B31", "Ρ-32")
"""Signs whose value is a speed limit, in m/s."""

COLOURS = {
    "green": Colour.GREEN,
    "yellow": Colour.YELLOW,
    "red": Colour.RED,
    "redYellow": Colour.RED_YELLOW,
    "inactive": Colour.INACTIVE,
}
"""Colours of a light by their words in the file."""

State = dict[str, "str | tuple[str, str]"]
"""Texts of a state by the element's name; two for an interval."""

_CHUNK = 1 << 18
_MOST_BYTES = 8 << 20  # of a state or an element without its states: a lanelet of 80,000 points
_MOST_DEPTH = 64
_STATES = ("state", "initialState")
_VALUES = ("orientation", "time", "velocity", "slipAngle", "velocityY")
_LEAVES = ("exact", "x", "y", "intervalStart", "intervalEnd")
_REGIONS = ("rectangle", "circle", "polygon", "lanelet")


@runtime_checkable
class Consumer(Protocol):
    """Protocol of a receiver of a file's elements."""

    def root(self, name: str, attributes: dict[str, str]) -> None:
        """Receive the first element.

        Args:
            name: Name of the element.
            attributes: Its attributes.
        """

    def state(self, state: State) -> None:
        """Receive a state; `element` follows after the last state of its obstacle or problem."""

    def element(self, element: Element) -> None:
        """Receive a complete child of the first element, without its states."""


def read(path: Path, consumer: Consumer) -> str:
    """Pass a file's elements to a consumer, and return the file's SHA-256.

    Raises:
        UserError: If the file is missing, empty, not XML, declares a document type, or holds an
            element of excessive size. The line has the file's line.
    """
    digest = hashlib.sha256()
    stream = _Stream(path, consumer)
    with open_file(path) as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
            stream.feed(chunk)
    stream.end()
    return digest.hexdigest()


def whole_number(text: str) -> int:
    """Return a whole number of at most 64 bits.

    Raises:
        ValueError: If the text is none, or the number is larger.
    """
    if not re.fullmatch(r"\s*[+-]?\d{1,1000}\s*", text, re.ASCII):
        raise ValueError(f"'{one_line(text, 20)}' is not a whole number")
    number = int(text)
    if not -(2**63) <= number < 2**63:
        raise ValueError(f"{one_line(text, 20)} has more than 64 bits")
    return number


class _Stream:
    def __init__(self, path: Path, consumer: Consumer) -> None:
        self._path = path
        self._consumer = consumer
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartDoctypeDeclHandler = self._refuse_doctype
        self._depth = self._total = self._bytes = self._finished = 0
        self._builder = TreeBuilder()
        self._texts: list[str] = []
        self._state_end = self._end_of_state()
        self._outside_states()

    def feed(self, chunk: bytes) -> None:
        before = self._finished
        self._total += len(chunk)
        self._parse(chunk, False)
        self._bytes = 0 if self._finished > before else self._bytes + len(chunk)
        if self._bytes > _MOST_BYTES:
            raise self._error(f"one element is larger than {_MOST_BYTES >> 20} MiB")

    def end(self) -> None:
        if not self._total:
            raise UserError(f"{self._path} is empty: name a CommonRoad file")
        self._parse(b"", True)

    def _parse(self, chunk: bytes, last: bool) -> None:
        try:
            self._parser.Parse(chunk, last)
        except expat.ExpatError as error:
            reason = f"not XML ({expat.ErrorString(error.code)})"
            raise self._error(reason, "restore the file") from error
        except (LookupError, ValueError) as error:  # of `encoding` in the first line
            raise self._error(one_line(str(error), 80), "save the file as UTF-8") from error

    def _error(self, reason: str, correction: str = "this is not a recording") -> UserError:
        line = self._parser.CurrentLineNumber
        return UserError(f"{self._path}, line {line}: {reason}: {correction}")

    def _refuse_doctype(self, *_: object) -> None:
        raise self._error(
            "declares a document type, which could make the reader expand or fetch without end",
            "remove <!DOCTYPE ...>; CommonRoad has none",
        )

    def _outside_states(self) -> None:
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if self._depth == 0:
            # Only a state inside a state can invalidate the count of open elements.
            if self._finished:
                raise self._error("a state inside a state")
            self._consumer.root(name, attributes)
        elif self._depth == 1:
            self._builder = TreeBuilder()
        elif self._depth > _MOST_DEPTH:
            raise self._error("elements nested too deep")
        elif name in _STATES:
            # A state's attributes are not needed, and most of a file is states: while a state is
            # read, these handlers are not called.
            self._parser.StartElementHandler = None
            self._parser.EndElementHandler = self._state_end
            self._parser.CharacterDataHandler = self._texts.append
            return
        self._depth += 1
        self._builder.start(name, attributes)

    def _text(self, text: str) -> None:
        if self._depth > 1:
            self._builder.data(text)

    def _end(self, name: str) -> None:
        self._depth -= 1
        if self._depth < 0:
            raise self._error("a state inside a state")
        if self._depth:
            self._builder.end(name)
        if self._depth == 1:
            self._finished += 1
            self._consumer.element(self._builder.close())

    def _end_of_state(self) -> Callable[[str], None]:
        """Return the handler of the end of an element inside a state; the inner loop of reading."""
        texts = self._texts
        consumer = self._consumer
        state: State = {}

        def end(name: str) -> None:
            if name in _LEAVES:
                state[name] = "".join(texts)
            elif name in _VALUES:
                if "exact" in state:
                    state[name] = state.pop("exact")
                elif "intervalStart" in state and "intervalEnd" in state:
                    state[name] = state.pop("intervalStart"), state.pop("intervalEnd")  # type: ignore[assignment]
            elif name in _STATES:
                consumer.state(state)
                state.clear()
                self._finished += 1
                self._outside_states()
            elif name in _REGIONS:
                state["region"] = name
            elif name != "point" and name != "position":
                state.pop("exact", None)
            texts.clear()

        return end
