"""Scenes of highway-env: roads, who enters them, the ego's task, what is observed and rewarded."""

import functools
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import one_of
from socialiq.worlds.highway import network
from socialiq.worlds.highway.crossings import Crossings, crossings_of, crosswalk, mirrored_ways
from socialiq.worlds.highway.network import (
    APPROACH,
    CONFLICT,
    EXIT,
    Lane,
    Network,
    Point,
    sine,
    straight,
)

ACTIONS = ("lane_left", "idle", "lane_right", "faster", "slower")
"""Actions: to the next lane, keep, or one target speed up or down from the present speed."""

LANE_LEFT, IDLE, LANE_RIGHT, FASTER, SLOWER = range(len(ACTIONS))

SIDES = "lane_left", "lane_right"
ROUTE_ACTIONS = ("slower", "idle", "faster", *SIDES)
"""Actions on every road with the schema `route`."""

SIDEWAYS = np.array([(0, -1), (0, 0), (0, 1), (1, 0), (-1, 0)])
"""Change of the target speed's and of the target lane's number by each of `ACTIONS`."""

ENTRY = np.dtype(
    [
        ("lane", np.int64),  # first of those to draw from
        ("lanes", np.int64),  # 1: not drawn
        ("along", np.float64),  # m
        ("along_spread", np.float64),
        ("speed", np.float64),  # m/s
        ("speed_spread", np.float64),
        ("spread", np.int64),  # NONE, UNIFORM or NORMAL
        ("target_speed", np.float64),  # m/s; 0: its speed
        ("destination", np.int64),  # -1: none, no route is planned
        ("destinations", np.int64),  # so many from there are drawn from; 1: not drawn
        ("exponent", np.bool_),  # whether the driver's is drawn
        ("changes", np.bool_),  # whether the driver changes lanes
    ],
    align=True,
)
"""One vehicle that enters at the start, in order; the first is the ego."""

NONE, UNIFORM, NORMAL = range(3)

SIGHT = np.dtype(
    [
        ("relative", np.bool_),  # rows of others relative to the ego
        ("x", np.float64),  # m, seen as 1
        ("y", np.float64),
        ("vx", np.float64),  # m/s, seen as 1
        ("vy", np.float64),
        ("arrival", np.float64),  # m along an exit beyond which the ego has arrived
        ("by_route", np.bool_),  # whether progress is along each vehicle's route, else the ego's
        ("side_x", np.float64),  # -1 in a mirror image that turns x round, else 1
        ("side_y", np.float64),
    ],
    align=True,
)
"""Scales of the observation, the measure of progress, and whether the road is mirrored."""


class Road(NamedTuple):
    """Tables of a road as the compiled core reads them; `road_of` makes them."""

    lanes: np.ndarray  # LANE records
    successors: np.ndarray  # first lanes of the roads that follow each road, (roads, most)
    # first lanes of the roads of a way by road and destination, (roads, destinations, most)
    routes: np.ndarray
    connected: np.ndarray  # CONNECTED records of each lane, itself first, (lanes, most)
    entries: np.ndarray  # ENTRY records of those that begin with the episode, the ego's first
    # lane by which others arrive later and agents begin, by arms of origin and exit, (arms, arms);
    # none: agents are the first entries
    arrivals: np.ndarray
    # cosine and sine of the turn, from east to north, of the view of agents of each arm, (arms, 2)
    frames: np.ndarray
    obstacles: np.ndarray  # centres of the standing obstacles, (obstacles, 2), m
    # change of the target speed's and of the target lane's number by each action, (actions, 2)
    actions: np.ndarray
    sight: np.ndarray  # SIGHT record in an array of one
    crossings: Crossings  # ways of people over it

    @property
    def speed_limit(self) -> float:
        """Speed limit of the lane by which the ego enters, m/s."""
        lane = self.arrivals[0, 0] if len(self.arrivals) else self.entries[0]["lane"]
        return float(self.lanes[lane]["speed_limit"])


def road_of(
    network: Network,
    sight: np.ndarray,
    entries: Sequence[np.ndarray] = (),
    *,
    task: Sequence[str] = (),
    destinations: Sequence[str] = (),
    arrivals: Sequence[Sequence[int]] = (),
    frames: Sequence[Point] = (),
    obstacles: Sequence[Point] = (),
    actions: np.ndarray = SIDEWAYS,
    speed_limit: float = 20.0,
    ways: Sequence[np.ndarray] = (),
) -> Road:
    """Return the tables of a road.

    Args:
        network: Roads and lanes.
        sight: SIGHT record in an array of one.
        entries: ENTRY records of the vehicles that begin with the episode, the ego's first.
        task: Nodes of the ego's way, along which its progress is measured.
        destinations: Nodes to which vehicles drive.
        arrivals: Lanes by which others arrive later, by arms of origin and exit.
        frames: Cosine and sine of the turn of the view of each arm's agents.
        obstacles: Centres (x, y) of standing obstacles, m.
        actions: Change of the target speed's and of the target lane's number by each action.
        speed_limit: Speed limit, m/s.
        ways: WAY records of the ways of people, those on foot first.
    """
    lanes = network.lanes(task, speed_limit)
    routes = network.routes(destinations)
    return Road(
        lanes=lanes,
        successors=network.successors(),
        routes=routes,
        connected=network.connected(),
        entries=np.array(list(entries), ENTRY),
        arrivals=np.array(arrivals, np.int64).reshape(len(arrivals), len(arrivals)),
        frames=np.array(frames, np.float64).reshape(-1, 2),
        obstacles=np.array(obstacles, np.float64).reshape(-1, 2),
        actions=actions,
        sight=sight,
        crossings=crossings_of(lanes, routes, ways, bool(destinations)),
    )


def mirrored(road: Road) -> Road:
    """Return the tables of a road's mirror image, on which traffic keeps to the other side.

    The image is that in the line through the origin along which the ego enters. Lanes keep their
    numbers, so that the same draws give the mirror image of an episode.
    """
    number = road.arrivals[0, 0] if len(road.arrivals) else road.entries[0]["lane"]
    heading = float(road.lanes[number]["heading"])
    sides = (1.0, -1.0) if abs(math.cos(heading)) > 0.5 else (-1.0, 1.0)
    sight = road.sight.copy()
    sight["side_x"], sight["side_y"] = sides
    return road._replace(
        lanes=network.mirrored(road.lanes, sides),
        obstacles=road.obstacles * sides,
        frames=road.frames * (1.0, -1.0),
        crossings=road.crossings._replace(ways=mirrored_ways(road.crossings.ways, sides)),
        actions=road.actions * (1, -1),
        sight=sight,
    )


class Scene(NamedTuple):
    """One scene."""

    name: str  # its name
    road: Road  # its tables
    defaults: Mapping[str, Any]  # values of the options in the place of the intersection's
    real: str = ""  # class of highway-env, `module:name`; empty if it has none
    # highway-env's configuration, beyond clock, actions and observation
    config: Mapping[str, Any] = MappingProxyType({})
    circle: float = 0.0  # inner radius of a circle round the origin to which the ego gives way, m
    edge: float = 0.0  # m from the origin to the stop lines of a crossing at which it gives way
    actions: tuple[str, ...] = ACTIONS  # names of the actions, in the order of the road's table
    back_end: str = ""  # class of the back end highway_env, `module:name`; empty if it has none
    left_hand: bool = False  # whether traffic keeps to the left

    # A scene is equal to itself alone: its tables are arrays.
    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @property
    def bends(self) -> bool:
        """Whether the ego's way may have a bend: that of the table's task, or else any way."""
        on_way = np.isfinite(self.road.lanes["before"])
        straight_lanes = self.road.lanes["straight"]
        return not (straight_lanes[on_way] if on_way.any() else straight_lanes).all()


@functools.cache
def other_side(scene: Scene) -> Scene:
    """Return a scene's mirror image, whose traffic keeps to the other side; see `mirrored`."""
    road = mirrored(scene.road)
    return scene._replace(road=road, left_hand=not scene.left_hand, real="", back_end="")


@functools.cache
def along_route(scene: Scene) -> Scene:
    """Return a scene as the schema `route` has it: absolute rows, and `ROUTE_ACTIONS`.

    Scales of a scene of highway-env become large enough for its whole road and all speeds.

    Args:
        scene: Scene whose rows of others may be relative to the ego. Actions that it lacks change
            lanes, which have no effect there.
    """
    lanes = scene.road.lanes
    seen = scene.road.sight.copy()
    if not len(scene.road.arrivals):
        seen["relative"] = False
        for axis in "xy":
            ends = lanes[f"low_{axis}"], lanes[f"high_{axis}"]
            seen[axis] = 100.0 * math.ceil((np.abs(ends).max() + _BEYOND) / 100.0)
            seen[f"v{axis}"] = _FASTEST
    left = 1 if scene.left_hand else -1
    changes = {"lane_left": (0, left), "lane_right": (0, -left)}
    changes |= dict(zip(scene.actions, scene.road.actions.tolist(), strict=True))
    actions = np.array([changes[name] for name in ROUTE_ACTIONS])
    road = scene.road._replace(sight=seen, actions=actions)
    return scene._replace(road=road, actions=ROUTE_ACTIONS, real="", back_end="")


def entry(lane: int, along: float, speed: float, **further: Any) -> np.ndarray:
    """Return an ENTRY record.

    Args:
        lane: Number of the lane on which the vehicle enters.
        along: Coordinate along the lane, m.
        speed: Speed at entry, m/s.
        **further: Values of other fields; without them there is one lane, no spread, no
            destination, and the driver changes lanes.
    """
    record = np.zeros((), ENTRY)
    fields = {"lane": lane, "lanes": 1, "along": along, "speed": speed, "changes": True}
    for name, value in (fields | {"destination": -1, "destinations": 1} | further).items():
        record[name] = value
    return record


def sight(
    x: float,
    y: float,
    vx: float,
    vy: float,
    arrival: float = np.inf,
    *,
    relative: bool,
    by_route: bool = False,
) -> np.ndarray:
    """Return a SIGHT record in an array of one.

    Args:
        x: Distance that is observed as 1, m.
        y: The same to the south, m.
        vx: Speed that is observed as 1, m/s.
        vy: The same to the south, m/s.
        arrival: Metres along an exit beyond which the ego has arrived; infinite: it never arrives.
        relative: Whether the rows of other vehicles are relative to the ego.
        by_route: Whether progress is measured along each vehicle's route; else along the ego's way.
    """
    return np.array([(relative, x, y, vx, vy, arrival, by_route, 1.0, 1.0)], SIGHT)


_BEYOND = 200.0  # m behind the end of a road to which a vehicle may drive
_FASTEST = 50.0  # m/s, more than any vehicle drives
MERGE_LENGTHS = 150.0, 80.0, 80.0, 150.0  # before, converging, merging, after, m
_RAMP = 6.5 + 4 + 4  # m, y of the beginning of the ramp
_RAMP_SWING = 3.25  # m, half of its way sideways
_RAMP_PULSATION = 2 * math.pi / (2 * MERGE_LENGTHS[1])  # rad/m
_LANES = 0.0, 4.0  # y of the left and of the right lane of merge and two_way, m
_MIDDLE = 2.0  # y between them, m
_HALF_ROAD = 5.0  # m, half a crosswalk over both
_TWO_WAY_CROSSWALK = 200.0  # m along the two-way road


def _merge() -> Scene:
    """Return highway-env's merge: two lanes of a motorway, and a third that ends."""
    roads = Network()
    before, converging, merged, end = (sum(MERGE_LENGTHS[:count]) for count in range(1, 5))
    for y in _LANES:
        roads.add("a", "b", Lane(straight((0.0, y), (converging, y)), APPROACH))
        roads.add("b", "c", Lane(straight((converging, y), (merged, y)), CONFLICT))
        roads.add("c", "d", Lane(straight((merged, y), (end, y)), EXIT))
    roads.add("j", "k", Lane(straight((0.0, _RAMP), (before, _RAMP)), APPROACH, forbidden=True))
    middle = _RAMP - _RAMP_SWING
    swing = sine((before, middle), (converging, middle), _RAMP_SWING, _RAMP_PULSATION, math.pi / 2)
    roads.add("k", "b", Lane(swing, APPROACH, forbidden=True))
    ramp_end = middle + _RAMP_SWING * math.sin(_RAMP_PULSATION * MERGE_LENGTHS[1] + math.pi / 2)
    last = straight((converging, ramp_end), (converging + MERGE_LENGTHS[2], ramp_end))
    roads.add("b", "c", Lane(last, CONFLICT, forbidden=True))
    motorway = roads.lane("a", "b", 0)
    ramp = roads.lane("j", "k", 0)
    spread = {"lanes": 2, "along_spread": 5.0, "speed_spread": 1.0, "spread": UNIFORM}
    traffic = [(90.0, 29.0), (70.0, 31.0), (5.0, 31.5)]
    entries = [
        entry(motorway + 1, 30.0, 30.0),
        *(entry(motorway, along, speed, **spread) for along, speed in traffic),
        entry(ramp, 110.0, 20.0, target_speed=30.0),
    ]
    scales = sight(400.0, 20.0, 40.0, 40.0, arrival=370.0 - merged, relative=True)
    task = ["a", "b", "c", "d"]
    ways = crosswalk(merged + 30.0, _MIDDLE, math.pi / 2, _HALF_ROAD)
    road = road_of(roads, scales, entries, task=task, obstacles=[(merged, ramp_end)], ways=ways)
    defaults = {"duration": 40.0, "target_speeds": (20.0, 25.0, 30.0), "progress_unit": 93.0}
    return Scene("merge", road, defaults, "highway_env.envs.merge_env:MergeEnv")


_ALPHA = 24  # degrees between the middle of an arm and its way in or out
_ACCESS = 170.0  # m from the centre to the end of an arm
_BEND = 85.0  # m, length of a whole swing of an arm
_SWING = 5.0  # m, half width of a whole swing of an arm
_CROSSWALK = 34.0  # m from the centre to a crosswalk over an arm
_HALF_CROSSWALK = 6.0  # m, half its length: lanes lie 3 m beside the arm's middle there
_BENT_IN = 0.2 * _BEND  # m of the swing on the way in
_DESTINATIONS = ["exr", "sxr", "nxr", "nxs"]  # the last is the ego's
_ARMS = {"s": (1, 0), "e": (0, 1), "n": (-1, 0), "w": (0, -1)}  # cosine and sine of its turn
_ARCS = (
    ("se", "ex", 90 - _ALPHA, _ALPHA),
    ("ex", "ee", _ALPHA, -_ALPHA),
    ("ee", "nx", -_ALPHA, -90 + _ALPHA),
    ("nx", "ne", -90 + _ALPHA, -90 - _ALPHA),
    ("ne", "wx", -90 - _ALPHA, -180 + _ALPHA),
    ("wx", "we", -180 + _ALPHA, -180 - _ALPHA),
    ("we", "sx", 180 - _ALPHA, 90 + _ALPHA),
    ("sx", "se", 90 + _ALPHA, 90 - _ALPHA),
)  # from and to in degrees, clockwise as drawn from east; driven the other way


def _roundabout_roads() -> Network:
    """Return circle and arms; of each arm the way in, straight then bent, and the way out."""
    roads = Network()
    for radius in (20.0, 24.0):
        for start, end, first, last in _ARCS:
            phases = float(np.deg2rad(first)), float(np.deg2rad(last))
            roads.add(start, end, Lane(network.arc((0.0, 0.0), radius, *phases, -1), CONFLICT))
    half = _BEND / 2
    pulsation = 2 * math.pi / _BEND
    bent_out = _BEND - _BENT_IN
    way_in = _SWING, pulsation, -math.pi / 2
    way_out = _SWING, pulsation, -math.pi / 2 + pulsation * bent_out
    for arm in _ARMS:
        lane = straight(_turned(arm, 2.0, _ACCESS), _turned(arm, 2.0, half))
        roads.add(f"{arm}er", f"{arm}es", Lane(lane, APPROACH))
        ends = _turned(arm, 2.0 + _SWING, half), _turned(arm, 2.0 + _SWING, half - _BENT_IN)
        roads.add(f"{arm}es", f"{arm}e", Lane(sine(*ends, *way_in), CONFLICT))
        ends = _turned(arm, -2.0 - _SWING, bent_out - half), _turned(arm, -2.0 - _SWING, half)
        roads.add(f"{arm}x", f"{arm}xs", Lane(sine(*ends, *way_out), EXIT))
        lane = straight(_turned(arm, -2.0, half), _turned(arm, -2.0, _ACCESS))
        roads.add(f"{arm}xs", f"{arm}xr", Lane(lane, EXIT))
    return roads


def _turned(arm: str, x: float, y: float) -> tuple[float, float]:
    cos, sin = _ARMS[arm]
    return cos * x + sin * y, cos * y - sin * x


def _crosswalk(arm: str) -> list[np.ndarray]:
    """Return the ways of the crosswalk over an arm of the roundabout, back and forth."""
    x, y = _turned(arm, 0.0, _CROSSWALK)
    east, south = _turned(arm, 1.0, 0.0)
    return crosswalk(x, y, math.atan2(south, east), _HALF_CROSSWALK)


def _roundabout() -> Scene:
    """Return highway-env's roundabout: two lanes round a circle, and four arms."""
    roads = _roundabout_roads()
    circle, southern, eastern = (
        roads.lane(*nodes, 0) for nodes in (("we", "sx"), ("ser", "ses"), ("eer", "ees"))
    )
    random = {
        "along_spread": 2.0, "speed_spread": 2.0, "spread": NORMAL,
        "destination": 0, "destinations": 3, "exponent": True,
    }  # fmt: skip
    entries = [
        entry(southern, 125.0, 8.0, destination=_DESTINATIONS.index("nxs")),
        entry(circle + 1, 5.0, 16.0, **random),
        entry(circle, 20.0, 16.0, **random),
        entry(circle, -20.0, 16.0, **random),
        entry(eastern, 50.0, 16.0, **random),
    ]
    scales = sight(100.0, 100.0, 15.0, 15.0, arrival=25.0, relative=False)
    task = ["ser", "ses", "se", "ex", "ee", "nx", "nxs", "nxr"]
    ways = [way for arm in _ARMS for way in _crosswalk(arm)]
    road = road_of(roads, scales, entries, task=task, destinations=_DESTINATIONS, ways=ways)
    defaults = {"duration": 11.0, "target_speeds": (0.0, 8.0, 16.0), "progress_unit": 50.0}
    config = {"incoming_vehicle_destination": None}
    real = "highway_env.envs.roundabout_env:RoundaboutEnv"
    return Scene("roundabout", road, defaults, real, config, circle=20.0)


def _two_way() -> Scene:
    """Return highway-env's two-way road: the ego overtakes where others come towards it."""
    roads = Network()
    length = 800.0
    for y in _LANES:
        roads.add("a", "b", Lane(straight((0.0, y), (length, y)), CONFLICT))
    roads.add("b", "a", Lane(straight((length, _LANES[0]), (0.0, _LANES[0])), CONFLICT))
    right = roads.lane("a", "b", 1)
    oncoming = roads.lane("b", "a", 0)
    driver = {"along_spread": 10.0, "spread": NORMAL, "changes": False}
    ahead = [entry(right, 70.0 + 40.0 * i, 24.0, speed_spread=2.0, **driver) for i in range(3)]
    against = [
        entry(oncoming, 200.0 + 100.0 * i, 20.0, speed_spread=5.0, **driver) for i in range(2)
    ]
    scales = sight(200.0, 20.0, 80.0, 40.0, relative=True)
    ways = crosswalk(_TWO_WAY_CROSSWALK, _MIDDLE, math.pi / 2, _HALF_ROAD)
    entries = [entry(right, 30.0, 30.0), *ahead, *against]
    road = road_of(roads, scales, entries, task=["a", "b"], ways=ways)
    defaults = {"duration": 15.0, "target_speeds": (20.0, 25.0, 30.0), "progress_unit": 93.0}
    return Scene("two_way", road, defaults, "highway_env.envs.two_way_env:TwoWayEnv")


_SCENES = {"merge": _merge, "roundabout": _roundabout, "two_way": _two_way}
SCENES = tuple(_SCENES)


@functools.cache
def scene_of(name: str) -> Scene:
    """Return a scene by name; refuse an unknown one."""
    one_of("scene", name, SCENES)
    return _SCENES[name]()
