"""Networks of SUMO: edges, ways of each class of road user through them, and mistakes in them.

The format is that of netconvert (https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html).
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import read_text
from socialiq.worlds import SUMO_NET

NETS = {name: Path(__file__).parent / "nets" / f"{name}.net.xml" for name in ("crossing", "row")}
"""Networks that ship, by name."""

CLASSES = {"vehicle": "passenger", "bicycle": "bicycle", "pedestrian": "pedestrian"}
"""Classes of road users: SUMO's name of each."""

_LARGEST = 1 << 26  # bytes
MOST_ROUTES = 1000  # ways of an ego that are searched


class Edge(NamedTuple):
    """Edge between two junctions, in SUMO's coordinates."""

    begin: str  # junction
    end: str
    priority: int
    length: float  # m
    classes: frozenset[str]  # of CLASSES that may use a lane of it
    tail: tuple[np.ndarray, np.ndarray]  # last two points of the lane of vehicles, m


class Network(NamedTuple):
    """Network of roads.

    Attributes:
        file: Its file.
        edges: Edges by identity, without those within junctions.
        after: Edges that follow an edge, by class.
        junctions: Kind and position (m) of each junction at which edges meet.
        crossings: Number of crossings for pedestrians at each junction.
    """

    file: Path
    edges: Mapping[str, Edge]
    after: Mapping[str, Mapping[str, list[str]]]
    junctions: Mapping[str, tuple[str, np.ndarray]]
    crossings: Mapping[str, int]

    def ends(self, kind: str) -> tuple[list[str], list[str]]:
        """Return edges of a class on which it enters the network, and those on which it leaves."""
        usable = [name for name, edge in self.edges.items() if kind in edge.classes]
        follows = {name for names in self.after[kind].values() for name in names}
        last = [name for name in usable if not self.after[kind][name]]
        return [name for name in usable if name not in follows], last

    def routes(self, kind: str = "vehicle") -> dict[tuple[str, str], list[str]]:
        """Return ways of fewest edges from the first to the last edge, never to the own arm."""
        ways, (first, last) = dict[tuple[str, str], list[str]](), self.ends(kind)
        for begin in first:
            before, waiting = {begin: ""}, deque([begin])
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

    def walks(self) -> list[tuple[str, str]]:
        """Return pairs of edges at the rim with a sidewalk, of different arms."""
        first, last = self.ends("vehicle")
        if not any(self.crossings.values()):
            return []
        rims = {name: self.edges[name].begin for name in first}
        rims |= {name: self.edges[name].end for name in last}
        walkable = [name for name in rims if "pedestrian" in self.edges[name].classes]
        return [
            pair for pair in itertools.permutations(walkable, 2) if rims[pair[0]] != rims[pair[1]]
        ]


@lru_cache(maxsize=8)
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
    root = root_of(file, "net", "run netconvert on it")
    try:
        network = _network(file, root)
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


def root_of(file: Path, tag: str, remedy: str) -> Element:
    """Return the first element of a file of XML; `UserError` with a remedy if it is another."""
    try:
        root = fromstring(read_text(file, _LARGEST))
    except (ParseError, ValueError) as error:
        raise UserError(f"{file} is not XML: {one_line(str(error))}") from error
    if root.tag != tag:
        raise UserError(f"{file} has no <{tag}> but <{one_line(root.tag)}>: {remedy}")
    return root


def _network(file: Path, root: Element) -> Network:
    edges, lanes = dict[str, Edge](), dict[tuple[str, str], frozenset[str]]()
    crossings = dict[str, int]()
    for element in root.iter("edge"):
        name, function = element.attrib["id"], element.get("function", "normal")
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
            (points[-2], points[-1]),
        )
    after = {kind: {name: list[str]() for name in edges} for kind in CLASSES}
    for link in root.iter("connection"):
        source, target = link.attrib["from"], link.attrib["to"]
        if source in edges and target in edges and link.get("dir") != "t":
            ends = (source, link.attrib["fromLane"]), (target, link.attrib["toLane"])
            for kind in lanes[ends[0]] & lanes[ends[1]]:
                after[kind][source].append(target)
    junctions = {
        element.attrib["id"]: (element.attrib["type"], _place(element))
        for element in root.iter("junction")
        if element.attrib["type"] not in ("internal", "dead_end")
    }
    return Network(file, edges, after, junctions, crossings)


def _place(junction: Element) -> np.ndarray:
    return np.array([float(junction.attrib["x"]), float(junction.attrib["y"])])


def _allowed(lane: Element) -> frozenset[str]:
    allow, disallow = lane.get("allow", "").split(), lane.get("disallow", "").split()
    allowed = set(CLASSES) if not allow or "all" in allow else set[str]()
    allowed |= {kind for kind, name in CLASSES.items() if name in allow}
    refused = {kind for kind, name in CLASSES.items() if name in disallow or "all" in disallow}
    return frozenset(allowed - refused)
