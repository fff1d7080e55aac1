"""`world sumo`: a network of SUMO checked and described."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.drivers import Demand
from socialiq.cli.output import Printing, listed, print_json, print_table
from socialiq.worlds.road_users import ON_FOOT, RIDES, ROAD_USERS
from socialiq.worlds.sumo.isolated import episode_of, isolation_for
from socialiq.worlds.sumo.network import CLASSES, read_network
from socialiq.worlds.sumo.simulation import class_of
from socialiq.worlds.sumo.traffic import Scene, SumoOptions

_MOST_WAYS = 50
_MOST_NAMES = 8


@dataclass(frozen=True)
class WorldSumo(Printing):
    """Check and describe a network of SUMO, and play an episode in it.

    It prints the junctions with their approaches and crossings, the side of the traffic, the ways
    that an ego can drive, how many road users of each class entered in the episode, and what of the
    network is not used.

    Example: socialiq world sumo city.net.xml
    """

    net: Annotated[str, tyro.conf.Positional]
    """crossing or row, which ship, or a file that ends in .net.xml, as netconvert writes it."""
    traffic: tyro.conf.OmitArgPrefixes[Demand] = field(default_factory=Demand)
    start: str = ""
    """Edge on which the ego enters; by default that of the way that turns left most, in left-hand
    traffic right most."""
    end: str = ""
    """Edge on which the ego leaves."""
    seed: int = 0
    """Seed of the episode."""

    def run(self) -> int:
        """Check and print."""
        network = read_network(self.net)
        options = {"net": self.net, "start": self.start, "end": self.end, **self.traffic.options}
        scene = Scene(SumoOptions(**options))
        played = episode_of(scene, self.seed).without
        entered = {kind: sum(class_of(name) == kind for name in played) for kind in CLASSES}
        junctions = [
            {
                "junction": name,
                "kind": kind,
                "approaches": sum(edge.end == name for edge in network.edges.values()),
                "crossings": network.crossings.get(name, 0),
            }
            for name, (kind, _) in network.junctions.items()
        ]
        ways = [
            {"start": begin, "end": end, "edges": len(way)}
            for (begin, end), way in network.routes().items()
        ]
        notes = self.unused(scene)
        if self.json:
            result: dict[str, Any] = {"junctions": junctions, "ways": ways, "ego": scene.way}
            departing = {"demand": self.demanded(scene)} if scene.user_demand else {}
            facts = {"left_hand": network.left_hand, "isolation": isolation_for(scene).kind}
            print_json(result | departing | {"entered": entered, "not_used": notes} | facts)
            return 0
        print_table(junctions)
        print_table(ways[:_MOST_WAYS], f"ways of an ego ({len(ways)}), here {' '.join(scene.way)}")
        print_table(listed(entered, "entered in 45 s"))
        kind, why = isolation_for(scene)
        side = "left: policies observe the mirror image" if network.left_hand else "right"
        facts = {
            "traffic keeps to the": side,
            "isolation of SUMO": f"{kind} ({why})" if why else kind,
        }
        print_table(listed(facts))
        if scene.user_demand:
            print_table(listed(self.demanded(scene), f"in {self.traffic.demand}"))
        if notes:
            print_table([{"not used": note} for note in notes])
        return 0

    def demanded(self, scene: Scene) -> dict[str, int]:
        """Return how many road users of each class the demand has."""
        departures = scene.user_demand.departures if scene.user_demand else []
        return {kind: sum(row.kind == kind for row in departures) for kind in CLASSES}

    def unused(self, scene: Scene) -> list[str]:
        """Return what the world leaves out of the network, and why."""
        network = scene.network
        walking = "netconvert --sidewalks.guess --crossings.guess"
        missing = {
            ON_FOOT: f"sidewalks or crossings are missing ({walking})",
            RIDES: "no way of theirs leads through",
        }
        notes = {
            **{
                f"{user.sumo.name}s: {missing[user.motion]}": not scene.pairs[user.sumo.name]
                for user in ROAD_USERS
                if user.sumo.name
            },
            "traffic lights: others obey them, policies don't observe them": any(
                kind.startswith("traffic_light") for kind, _ in network.junctions.values()
            ),
        }
        cars = [name for name, edge in network.edges.items() if "vehicle" not in edge.classes]
        closed = f"edges without a lane for cars: {', '.join(cars[:5])}"
        unused = [note for note, holds in (notes | {closed: bool(cars)}).items() if holds]
        for file, left_out in self.left_out(scene).items():
            names = [f"{name} ({count})" for name, count in left_out.most_common(_MOST_NAMES)]
            more = f" and {len(left_out) - len(names)} further kinds" * (len(left_out) > len(names))
            unused.append(f"{file}: SUMO does not get {', '.join(names)}{more}")
        return unused

    def left_out(self, scene: Scene) -> dict[str, Counter[str]]:
        """Return what SUMO doesn't get of each file, without files that it gets whole."""
        counts = {scene.network.file.name: scene.network.left_out}
        if scene.user_demand:
            counts[Path(scene.options.demand).name] = scene.user_demand.left_out
        return {file: left_out for file, left_out in counts.items() if left_out}
