"""Options of a world in SUMO, and the departures of an episode, all drawn by its seed."""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from typing import Any, Literal, get_args
from xml.sax.saxutils import quoteattr

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.options import Schema
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.sumo.demand import read_demand
from socialiq.worlds.sumo.network import CLASSES, VEHICLE, WALKING, read_network

Following = Literal["Krauss", "IDM"]
MOST_RATE = 10.0  # departures per second of a class, one a sub-step


_ClassOptions: Any = make_dataclass(
    "_ClassOptions",
    [
        (f"{kind}_{name}", float, default)
        for kind, row in CLASSES.items()
        for name, default in (("rate", row.rate), ("weight", 1.0))
        if row != VEHICLE
    ],
    frozen=True,
)


@dataclass(frozen=True)
class SumoOptions(EffectOptions, _ClassOptions):
    """Options of a world in SUMO; those of effects are `EffectOptions`.

    Each class of people (`network.CLASSES`) has a rate and a weight, as vehicles have.

    Raises:
        UserError: If a value is not supported.
    """

    net: str = "crossing"  # of `NETS`, or the path of a network
    demand: str = ""  # path of a file of routes in SUMO's XML, in the place of the drawn traffic
    # edge on which the ego enters; by default of the way that turns left most, in left-hand traffic
    # right most, and of these of the lowest priority, from the south
    start: str = ""
    end: str = ""  # edge on which it leaves
    duration: float = 20.0  # s after which an episode times out
    warm_up: float = 15.0  # s of traffic before the ego enters
    vehicle_rate: float = VEHICLE.rate  # departures per second, over all entries
    following: Following = "Krauss"  # SUMO's model of car-following
    # schema of the observation: rows as at the intersection, which show no pedestrians, or the
    # vector along the ego's route that is the same for every road
    observation: Schema = "rows"
    vehicle_weight: float = 1.0  # of a class in every effect on it

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("following", self.following, get_args(Following))
        one_of("observation", self.observation, get_args(Schema))
        for name in (f"{kind}_rate" for kind in CLASSES):
            if not 0 <= getattr(self, name) <= MOST_RATE:
                raise UserError(f"{name} must lie between 0 and {MOST_RATE:g} per second")
        if not 0 <= self.warm_up <= 3600:
            raise UserError(f"warm_up must lie between 0 and 3600 s, got {self.warm_up}")
        self.decisions(self.road)
        if not all(np.isfinite(weight) for weight in self.by_class):
            raise UserError("weights of classes must be finite numbers")

    @property
    def road(self) -> Options:
        """Options of the ego and of r_env: those of the intersection."""
        return Options(duration=self.duration)

    @property
    def by_class(self) -> tuple[float, ...]:
        """Weight of each class."""
        return tuple(getattr(self, f"{kind}_weight") for kind in CLASSES)


EGO = "ego"
_FROM_JUNCTION = 35.0  # m, mean of the ego's front, as at the intersection; sd 5 m
_EGO_STREAM = 3  # number of its random stream (`road_users.InSumo`)
_SPEED = 10.0  # m/s, of the ego
_NEAREST_DOOR = 5.0  # m from a junction to the nearest place where pedestrians start
_DOORS = 30.0  # m along which these places lie
_FOLLOWING = {
    "Krauss": "",
    # The drivers of highway-env: T 1.5 s, 7 m between centres, 6 and 3 m/s², exponent 4.
    "IDM": ' tau="1.5" minGap="2" accel="6" decel="3" delta="4"',
}


class Scene:
    """Network, options, the ego's way, and the ways of all other road users.

    Raises:
        UserError: If there is no network, or no way between the edges that are named.
    """

    def __init__(self, options: SumoOptions) -> None:
        self.options = options
        self.network = read_network(options.net)
        self.user_demand = read_demand(options.demand) if options.demand else None
        self.seconds = options.warm_up + options.decisions(options.road)
        self.pairs = {
            kind: self.network.walks(kind) if kind in WALKING else list(self.network.routes(kind))
            for kind in CLASSES
        }
        self.entries = set(self.network.ends("vehicle")[0])
        ways = self.network.routes()
        asked = options.start, options.end
        chosen = {
            ends: way
            for ends, way in ways.items()
            if all(name in ("", end) for name, end in zip(asked, ends, strict=True))
        }
        if not chosen:
            examples = ", ".join(f"{begin} to {end}" for begin, end in list(ways)[:6])
            raise UserError(
                f"no way of a car from '{options.start}' to '{options.end}' in "
                f"{self.network.file.name}: choose one of {examples}{', ...' * (len(ways) > 6)}"
            )
        self.way = max(chosen.values(), key=self._turn)

    def _turn(self, way: list[str]) -> tuple[float, int, float]:
        """Return how far a way turns across oncoming traffic, how little it may claim, and north.

        The first is the sine of its angle to the left, or to the right in left-hand traffic.
        """
        (a, b), (c, d) = (self.network.edges[way[end]].tail for end in (0, -1))
        first = (b - a) / np.hypot(*(b - a))
        last = (d - c) / np.hypot(*(d - c))
        sine = round(float(first[0] * last[1] - first[1] * last[0]), 6)
        return self.network.right * sine, -self.network.edges[way[0]].priority, float(first[1])

    def begin(self, seed: int) -> float:
        """Return the time of SUMO at which an episode begins, before its warm-up, s."""
        return self.user_demand.begin(seed, self.seconds) if self.user_demand else 0.0

    def front(self, seed: int) -> float:
        """Return where the ego's front enters its first edge, m."""
        length = self.network.edges[self.way[0]].length
        spread = float(np.random.default_rng([seed, _EGO_STREAM]).normal(0.0, 5.0))
        return round(min(max(length - _FROM_JUNCTION + spread, VEHICLE.length), length), 2)

    def demand(self, seed: int, with_ego: bool) -> str:
        """Return the traffic of an episode as SUMO's XML, with the ego or without.

        Each class has a random stream of its own, and each second draws the same numbers, so the
        rate of a class doesn't move another's departures. No type has a random part.
        """
        begin = self.begin(seed)
        options = self.options
        departures = self.user_demand.within(begin, self.seconds) if self.user_demand else []
        seconds = 0 if self.user_demand else int(np.ceil(self.seconds))
        for kind, pairs in self.pairs.items():
            stream = np.random.default_rng([seed, CLASSES[kind].number])
            rate = getattr(options, f"{kind}_rate")
            for second in range(seconds if pairs else 0):
                count = stream.poisson(rate)
                draws = stream.random((int(MOST_RATE), 4))
                for place, (when, where, *rest) in enumerate(draws[:count]):
                    at = second + round(when, 1)
                    ends = pairs[int(where * len(pairs))]
                    name = f"{kind}{second}.{place}"
                    departures.append((at, self._departure(kind, name, at, ends, *rest)))
        if with_ego:
            place = f'departLane="best" departPos="{self.front(seed)}" departSpeed="{_SPEED:g}"'
            enters = begin + options.warm_up
            line = f'<vehicle id="{EGO}" type="{EGO}" depart="{enters}" {place} '
            route = quoteattr(" ".join(self.way))
            line += f'insertionChecks="none"><route edges={route}/></vehicle>'
            departures.append((enters, line))
        lines = [line for _, line in sorted(departures)]
        return "\n".join(["<routes>", *self._types(), *lines, "</routes>"])

    def _types(self) -> list[str]:
        following = self.options.following
        of_cars = f' width="2" carFollowModel="{following}"{_FOLLOWING[following]}'
        lines = [
            f'<vType id="{row.name}" vClass="{row.lanes}" length="{row.length:g}" sigma="0" '
            f'speedDev="0"{of_cars * (row.lanes == VEHICLE.lanes)}/>'
            for row in (*CLASSES.values(), VEHICLE._replace(name=EGO))
        ]
        return lines + (self.user_demand.types if self.user_demand else [])

    def _departure(
        self, kind: str, name: str, at: float, ends: tuple[str, str], pace: float, door: float
    ) -> str:
        way = f"from={quoteattr(ends[0])} to={quoteattr(ends[1])}"
        who = f'id="{name}" type="{kind}" depart="{at:.1f}" speedFactor="{0.8 + 0.4 * pace:.4f}"'
        if kind not in WALKING:
            return f'<trip {who} {way} departLane="best" departSpeed="max"/>'
        begin = self._beside(ends[0], _NEAREST_DOOR + _DOORS * door)
        end = self._beside(ends[1], _NEAREST_DOOR + _DOORS / 2)
        return f'<person {who} departPos="{begin}"><walk {way} arrivalPos="{end}"/></person>'

    def _beside(self, edge: str, away: float) -> float:
        """Return the place on a sidewalk that is so far from the junction, m."""
        length = self.network.edges[edge].length
        away = min(away, length - 0.1)
        return round(length - away if edge in self.entries else away, 2)
