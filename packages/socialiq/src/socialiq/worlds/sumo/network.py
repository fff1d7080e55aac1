"""Networks of SUMO: edges, ways of each class of road user through them, and mistakes in them.

The format is that of netconvert (https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html).
"""

from __future__ import annotations

import hashlib
import itertools
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, ParseError, fromstring, tostring

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import read_text
from socialiq.worlds import SUMO_NET
from socialiq.worlds.road_users import ON_FOOT, ROAD_USERS, InSumo
from socialiq.worlds.sumo.allowed import NETWORK, copy_allowed

NETS = {name: Path(__file__).parent / "nets" / f"{name}.net.xml" for name in ("crossing", "row")}
"""Networks that ship, by name."""

VEHICLE = InSumo("vehicle", lanes="passenger", rate=0.3, length=5.0)
_ROWS = (VEHICLE, *(user.sumo for user in ROAD_USERS if user.sumo.name))
CLASSES = {row.name: row for row in sorted(_ROWS, key=lambda row: row.number)}
"""Classes of road users by name."""

WALKING = tuple(user.sumo.name for user in ROAD_USERS if user.motion == ON_FOOT)
"""Classes of people who are persons of SUMO. Those who ride are vehicles of SUMO."""

LARGEST = 1 << 26  # bytes
MOST_ROUTES = 1000  # ways of an ego that are searched
_TRUE = ("true", "1", "yes", "on", "x", "t")  # words that SUMO reads as true


class Edge(NamedTuple):
    """Edge between two junctions, in SUMO's coordinates."""

    begin: str  # junction
    end: str
    priority: int
    length: float  # m
    classes: frozenset[str]  # of CLASSES that may use a lane of it
    line: np.ndarray  # points of the lane of vehicles, m, (point, 2)

    @property
    def tail(self) -> tuple[np.ndarray, np.ndarray]:
        """Last two points of the lane of vehicles, m."""
        return self.line[-2], self.line[-1]


class Network(NamedTuple):
    """Network of roads.

    Attributes:
        edges: Edges by identity, without those within junctions.
        after: Edges that follow an edge, by class.
        junctions: Kind and position (m) of each junction at which edges meet.
        crossings: Number of crossings for pedestrians at each junction.
        left_hand: Whether traffic keeps to the left.
        file: Its file.
        sha256: Hash of the file's bytes, as they were read.
        xml: What SUMO gets of the file (`allowed`).
        left_out: What SUMO doesn't get of it: counts by name.
    """

    edges: Mapping[str, Edge]
    after: Mapping[str, Mapping[str, list[str]]]
    junctions: Mapping[str, tuple[str, np.ndarray]]
    crossings: Mapping[str, int]
    left_hand: bool
    file: Path
    sha256: str
    xml: str
    left_out: Counter[str]

    @property
    def right(self) -> float:
        """Factor of directions to the right that mirrors left-hand traffic: -1 there, else 1."""
        return -1.0 if self.left_hand else 1.0

    def ends(self, kind: str) -> tuple[list[str], list[str]]:
        """Return edges of a class on which it enters the network, and those on which it leaves."""
        usable = [name for name, edge in self.edges.items() if kind in edge.classes]
        follows = {name for names in self.after[kind].values() for name in names}
        last = [name for name in usable if not self.after[kind][name]]
        return [name for name in usable if name not in follows], last

    def routes(self, kind: str = "vehicle") -> dict[tuple[str, str], list[str]]:
        """Return ways of fewest edges from the first to the last edge, never to the own arm."""
        ways = dict[tuple[str, str], list[str]]()
        first, last = self.ends(kind)
        for begin in first:
            before = {begin: ""}
            waiting = deque([begin])
            while waiting:
                here = waiting.popleft()
                for name in self.after[kind][here]:
                    if name not in before:
                        before[name] = here
                        waiting.append(name)
            for end in last:
                if end in before and self.edges[end].end != self.edges[begin].begin:
                    way = [end]
                    while way[0] != begin:
                        way.insert(0, before[way[0]])
                    ways[begin, end] = way
            if len(ways) >= MOST_ROUTES:
                break
        return {ends: way for ends, way in ways.items() if len(way) > 1}

    def line_of(self, way: Sequence[str]) -> list[np.ndarray]:
        """Return the points of each edge of a way, and of the bends between them, in turn, m.

        A bend is a quadratic Bézier curve, whose middle point lies where the edges would meet.
        """
        lines = [self.edges[name].line for name in way]
        pieces = [lines[0]]
        for before, after in itertools.pairwise(lines):
            begin = before[-1]
            end = after[0]
            leaving = (begin - before[-2]) / np.hypot(*(begin - before[-2]))
            reach = float((end - begin) @ leaving)
            share = np.linspace(0.0, 1.0, 21)[:, None]
            corner = begin + max(reach, 0.0) * leaving
            bend = (1 - share) ** 2 * begin + 2 * share * (1 - share) * corner + share**2 * end
            pieces += [bend, after]
        return pieces

    def walks(self, kind: str) -> list[tuple[str, str]]:
        """Return pairs of edges at the rim with a sidewalk for a class, of different arms."""
        first, last = self.ends("vehicle")
        if not any(self.crossings.values()):
            return []
        rims = {name: self.edges[name].begin for name in first}
        rims |= {name: self.edges[name].end for name in last}
        walkable = [name for name in rims if kind in self.edges[name].classes]
        return [
            pair for pair in itertools.permutations(walkable, 2) if rims[pair[0]] != rims[pair[1]]
        ]


def read_network(net: str) -> Network:
    """Read a network: the name of one that ships, or a file.

    Raises:
        UserError: If the file is no network of SUMO, or vehicles can't cross a junction in it.
    """
    file = NETS.get(net, Path(net))
    if net not in NETS and not net.endswith(SUMO_NET):
        raise UserError(
            f"unknown network '{one_line(net)}': choose one of {', '.join(NETS)}, or name a file "
            f"that ends in {SUMO_NET}, as netconvert writes it"
        )
    return _network(file, read_text(file, LARGEST))


@lru_cache(maxsize=8)
def _network(file: Path, text: str) -> Network:
    left_out = Counter[str]()
    root = copy_allowed(root_of(file, text, "net", "run netconvert on it"), NETWORK, left_out)
    try:
        network = _read(
            root,
            file=file,
            sha256=sha256_of_text(text),
            xml=tostring(root, "unicode"),
            left_out=left_out,
        )
    except (KeyError, ValueError, IndexError) as error:
        raise UserError(
            f"{file} lacks {one_line(str(error))} somewhere: write it with netconvert again"
        ) from error
    if not network.routes():
        raise UserError(
            f"{file} has no way on which a car enters, crosses a junction and leaves: let roads "
            "end at its rim (netconvert --no-turnarounds)"
        )
    return network


def root_of(file: Path, text: str, tag: str, remedy: str) -> Element:
    """Return the first element of a file of XML.

    Args:
        file: The file, for messages.
        text: Its content.
        tag: Name that the first element must have.
        remedy: What to do if it has another name.

    Raises:
        UserError: If the text is not XML, or the first element has another name.
    """
    try:
        root = fromstring(text)
    except (ParseError, ValueError) as error:
        raise UserError(f"{file} is not XML: {one_line(str(error))}") from error
    if root.tag != tag:
        raise UserError(f"{file} has no <{tag}> but <{one_line(root.tag)}>: {remedy}")
    return root


def sha256_of_text(text: str) -> str:
    """Return the SHA-256 of the bytes of a file of UTF-8 text."""
    return hashlib.sha256(text.encode()).hexdigest()


def _read(root: Element, **origin: Any) -> Network:
    """Return a network of its edges, followers, junctions and crossings, and of its source."""
    edges = dict[str, Edge]()
    lanes = dict[tuple[str, str], frozenset[str]]()
    crossings = dict[str, int]()
    for element in root.iter("edge"):
        name = element.attrib["id"]
        function = element.get("function", "normal")
        if function == "crossing":
            junction = name.rpartition("_")[0][1:]
            crossings[junction] = crossings.get(junction, 0) + 1
        if function != "normal":
            continue
        used = {lane.attrib["index"]: _allowed(lane) for lane in element.iter("lane")}
        lanes |= {(name, index): classes for index, classes in used.items()}
        cars = [lane for lane in element.iter("lane") if "vehicle" in used[lane.attrib["index"]]]
        lane = (cars or list(element.iter("lane")))[0]
        points = [np.array(point.split(",")[:2], float) for point in lane.attrib["shape"].split()]
        edges[name] = Edge(
            element.attrib["from"],
            element.attrib["to"],
            int(element.get("priority", -1)),
            float(lane.attrib["length"]),
            frozenset().union(*used.values()),
            np.array(points),
        )
    after = {kind: {name: list[str]() for name in edges} for kind in CLASSES}
    for link in root.iter("connection"):
        source = link.attrib["from"]
        target = link.attrib["to"]
        if source in edges and target in edges and link.get("dir") != "t":
            ends = (source, link.attrib["fromLane"]), (target, link.attrib["toLane"])
            for kind in lanes[ends[0]] & lanes[ends[1]]:
                after[kind][source].append(target)
    junctions = {
        element.attrib["id"]: (element.attrib["type"], _place(element))
        for element in root.iter("junction")
        if element.attrib["type"] not in ("internal", "dead_end")
    }
    left_hand = root.get("lefthand", "").lower() in _TRUE
    return Network(edges, after, junctions, crossings, left_hand, **origin)


def _place(junction: Element) -> np.ndarray:
    return np.array([float(junction.attrib["x"]), float(junction.attrib["y"])])


def _allowed(lane: Element) -> frozenset[str]:
    allow = lane.get("allow", "").split()
    disallow = lane.get("disallow", "").split()
    allowed = set(CLASSES) if not allow or "all" in allow else set[str]()
    allowed |= {kind for kind, row in CLASSES.items() if row.lanes in allow}
    refused = {kind for kind, row in CLASSES.items() if {row.lanes, "all"} & {*disallow}}
    return frozenset(allowed - refused)
