"""Demand of a user: a file of routes of SUMO, read as explicit departures without chance.

The format is https://sumo.dlr.de/docs/Definition_of_Vehicles%2C_Vehicle_Types%2C_and_Routes.html.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, tostring

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import read_text
from socialiq.worlds.sumo.allowed import DEMAND, copy_allowed
from socialiq.worlds.sumo.network import CLASSES, LARGEST, WALKING, root_of, sha256_of_text

MOST_DEPARTURES = 1_000_000
_PERSONS = {"person": "person", "personFlow": "person"}
_DEPARTING = {"trip": "trip", "vehicle": "vehicle", "flow": "", **_PERSONS}
_INSIDE = ("route", "walk", "personTrip", "stop", "param")
_OF_FLOWS = ("begin", "end", "number", "period", "vehsPerHour", "perHour")


class Departure(NamedTuple):
    """Road user that departs."""

    time: float  # s
    kind: str  # class
    line: str  # its XML


class Demand(NamedTuple):
    """Demand of a file.

    Attributes:
        types: XML of types and routes.
        departures: Everybody, by time.
        sha256: Hash of the file's bytes, as they were read.
        left_out: What SUMO doesn't get of the file (`allowed`): counts by name.
    """

    types: list[str]
    departures: list[Departure]
    sha256: str
    left_out: Counter[str]

    def begin(self, seed: int, seconds: float) -> float:
        """Return when an episode of so many seconds begins, drawn by its seed, s."""
        first = self.departures[0].time
        last = self.departures[-1].time
        stream = np.random.default_rng([seed, len(_DEPARTING)])
        return float(np.floor(first + stream.random() * max(last - seconds - first, 0.0)))

    def within(self, begin: float, seconds: float) -> list[tuple[float, str]]:
        """Return departures from a time on, for so many seconds."""
        return [(row.time, row.line) for row in self.departures if 0 <= row.time - begin < seconds]


def read_demand(file: str) -> Demand:
    """Read a file of trips, vehicles, flows and persons.

    Drivers don't dawdle and flows depart at equal intervals, so that an episode repeats.

    Raises:
        UserError: If it is no such file, or part of it is left to chance or is not supported.
    """
    path = Path(file)
    return _demand(path, read_text(path, LARGEST))


@lru_cache(maxsize=8)
def _demand(path: Path, text: str) -> Demand:
    remedy = "name a file of trips, vehicles, flows and persons"
    types = list[str]()
    departures = list[Departure]()
    kinds = dict[str, str]()  # class of each type
    riding = {row.lanes: row.name for row in reversed(CLASSES.values()) if row.name not in WALKING}
    left_out = Counter[str]()
    for original in root_of(path, text, "routes", remedy):
        tag = original.tag
        name = original.get("id", "")
        where = f"{path}: <{one_line(tag)}> '{one_line(name)}'"
        inside = [child.tag for child in original if child.tag not in _INSIDE]
        if tag not in DEMAND or (tag in _DEPARTING and inside):
            unread = one_line((inside if tag in DEMAND else [tag])[0])
            raise UserError(f"{where} has <{unread}>, which is not read: leave it out")
        element = copy_allowed(original, DEMAND[tag], left_out)
        if tag in ("vType", "route"):
            if tag == "vType":
                kinds[name] = riding.get(element.get("vClass", ""), "vehicle")
                element.attrib |= {"id": f"of.{name}", "sigma": "0", "speedDev": "0"}
            types.append(tostring(element, "unicode"))
            continue
        if any("random" in part.attrib.values() for part in element.iter()):
            raise UserError(f"{where} is left to chance: give a number in the place of random")
        kind = WALKING[0] if element.tag in _PERSONS else "vehicle"
        if own := element.get("type"):
            kind = kind if element.tag in _PERSONS else kinds.get(own, "vehicle")
        element.set("type", f"of.{own}" if own in kinds else kind)
        try:
            for time in _times(element):
                line = _line(element, f"{kind}{len(departures)}", time)
                departures.append(Departure(time, kind, line))
        except (KeyError, ValueError, ZeroDivisionError) as error:
            raise UserError(
                f"{where} has no times of departure as numbers ({one_line(str(error))}): give "
                "depart, or of a flow begin, end and number, period or vehsPerHour"
            ) from error
    if not departures:
        raise UserError(f"{path} has no departures: add trips, vehicles, flows or persons")
    return Demand(types, sorted(departures), sha256_of_text(text), left_out)


def _times(element: Element) -> Iterator[float]:
    """Yield when the road users of an element depart, s."""
    if "flow" not in element.tag.lower():
        yield float(element.attrib["depart"])
        return
    begin, end = (float(element.attrib[name]) for name in _OF_FLOWS[:2])
    rate = element.get("vehsPerHour") or element.get("perHour")
    if "number" in element.attrib:
        period = (end - begin) / int(element.attrib["number"])
    else:
        period = 3600 / float(rate) if rate else float(element.attrib["period"])
    if not 0 < (end - begin) / period < MOST_DEPARTURES:
        raise ValueError(f"0 to {MOST_DEPARTURES:,} departures")
    yield from np.arange(begin, end - 1e-9, period).tolist()


def _line(element: Element, name: str, time: float) -> str:
    """Return the XML of one road user of an element."""
    tag = _DEPARTING[element.tag] or ("trip" if "from" in element.attrib else "vehicle")
    own = {key: value for key, value in element.attrib.items() if key not in _OF_FLOWS}
    single = Element(tag, own | {"id": name, "depart": f"{time:.2f}"})
    single.extend(list(element))
    return tostring(single, "unicode").strip()
