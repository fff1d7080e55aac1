"""Scenes of highway-env: roads, who enters them, the ego's task, what is observed and rewarded."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import one_of
from socialiq.worlds.highway import network
from socialiq.worlds.highway.network import APPROACH, CONFLICT, EXIT, Lane, Network, sine, straight
from socialiq.worlds.highway.options import DRIVER, FLAGS, MOTION, PUSH

ACTIONS = ("lane_left", "idle", "lane_right", "faster", "slower")
"""Actions: to the next lane, keep, or one target speed up or down from the present speed."""

LANE_LEFT, IDLE, LANE_RIGHT, FASTER, SLOWER = range(len(ACTIONS))

CAR = np.dtype(
    [
        *MOTION,
        *DRIVER,
        ("timer", np.float64),  # s since the driver last thought of changing lanes
        *PUSH,
        ("identity", np.int32),  # its entry; obstacles follow
        ("lane", np.int16),  # closest lane
        ("target_lane", np.int16),  # lane it steers along
        ("route", np.int16),  # road at which its way began, -1 without a way
        ("destination", np.int16),
        ("leg", np.int16),  # completed roads of its way
        ("obstacle", np.bool_),
        *FLAGS,
    ],
    align=True,
)
"""Record of a vehicle or of an obstacle, which stands and drives nowhere."""

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
        ("arrival", np.float64),  # m along an exit at which the ego has arrived
    ],
    align=True,
)
"""Scales of the observation, and the place of arrival."""


class Road(NamedTuple):
    """Tables of a scene as the compiled core reads them."""

    lanes: np.ndarray  # LANE records
    successors: np.ndarray  # roads that follow each road, (roads, most)
    routes: np.ndarray  # roads of a way by road and destination, (roads, destinations, most)
    entries: np.ndarray  # ENTRY records, the ego's first
    obstacles: np.ndarray  # centres of the standing obstacles, (obstacles, 2), m
    sight: np.ndarray  # SIGHT record in an array of one


class Scene(NamedTuple):
    """One scene."""

    name: str  # its name
    road: Road  # its tables
    defaults: Mapping[str, Any]  # values of the options in the place of the intersection's
    real: str = ""  # class of highway-env, `module:name`; empty if it has none
    # highway-env's configuration, beyond clock, actions and observation
    config: Mapping[str, Any] = MappingProxyType({})


def entry(lane: int, along: float, speed: float, **further: Any) -> np.ndarray:
    """Return an ENTRY record with the given fields."""
    record = np.zeros((), ENTRY)
    fields = {"lane": lane, "lanes": 1, "along": along, "speed": speed, "changes": True}
    for name, value in (fields | {"destination": -1, "destinations": 1} | further).items():
        record[name] = value
    return record


def sight(
    x: float, y: float, vx: float, vy: float, arrival: float = np.inf, *, relative: bool
) -> np.ndarray:
    """Return a SIGHT record in an array of one."""
    return np.array([(relative, x, y, vx, vy, arrival)], SIGHT)


MERGE_LENGTHS = 150.0, 80.0, 80.0, 150.0  # before, converging, merging, after, m
_RAMP, _RAMP_SWING = 6.5 + 4 + 4, 3.25  # m: y of its beginning, half of its way sideways
_RAMP_PULSATION = 2 * math.pi / (2 * MERGE_LENGTHS[1])  # rad/m
_LANES = 0.0, 4.0  # y of the left and of the right lane of merge and two_way, m


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
    motorway, ramp = roads.lane("a", "b", 0), roads.lane("j", "k", 0)
    spread = {"lanes": 2, "along_spread": 5.0, "speed_spread": 1.0, "spread": UNIFORM}
    traffic = [(90.0, 29.0), (70.0, 31.0), (5.0, 31.5)]
    entries = [
        entry(motorway + 1, 30.0, 30.0),
        *(entry(motorway, along, speed, **spread) for along, speed in traffic),
        entry(ramp, 110.0, 20.0, target_speed=30.0),
    ]
    road = Road(
        lanes=roads.lanes(["a", "b", "c", "d"]),
        successors=roads.successors(),
        routes=roads.routes([]),
        entries=np.stack(entries),
        obstacles=np.array([[merged, ramp_end]]),
        sight=sight(400.0, 20.0, 40.0, 40.0, arrival=370.0 - merged, relative=True),
    )
    defaults = {"duration": 40.0, "target_speeds": (20.0, 25.0, 30.0), "progress_unit": 93.0}
    return Scene("merge", road, defaults, "highway_env.envs.merge_env:MergeEnv")


_ALPHA = 24  # degrees between the middle of an arm and its way in or out
_ACCESS = 170.0  # m from the centre to the end of an arm
_BEND, _SWING = 85.0, 5.0  # m: length and half width of a whole swing of an arm
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
    half, pulsation, bent_out = _BEND / 2, 2 * math.pi / _BEND, _BEND - _BENT_IN
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
    road = Road(
        lanes=roads.lanes(["ser", "ses", "se", "ex", "ee", "nx", "nxs", "nxr"]),
        successors=roads.successors(),
        routes=roads.routes(_DESTINATIONS),
        entries=np.stack(entries),
        obstacles=np.zeros((0, 2)),
        sight=sight(100.0, 100.0, 15.0, 15.0, arrival=25.0, relative=False),
    )
    defaults = {"duration": 11.0, "target_speeds": (0.0, 8.0, 16.0), "progress_unit": 50.0}
    config = {"incoming_vehicle_destination": None}
    real = "highway_env.envs.roundabout_env:RoundaboutEnv"
    return Scene("roundabout", road, defaults, real, config)


def _two_way() -> Scene:
    """Return highway-env's two-way road: the ego overtakes where others come towards it."""
    roads, length = Network(), 800.0
    for y in _LANES:
        roads.add("a", "b", Lane(straight((0.0, y), (length, y)), CONFLICT))
    roads.add("b", "a", Lane(straight((length, _LANES[0]), (0.0, _LANES[0])), CONFLICT))
    right, oncoming = roads.lane("a", "b", 1), roads.lane("b", "a", 0)
    driver = {"along_spread": 10.0, "spread": NORMAL, "changes": False}
    ahead = [entry(right, 70.0 + 40.0 * i, 24.0, speed_spread=2.0, **driver) for i in range(3)]
    against = [
        entry(oncoming, 200.0 + 100.0 * i, 20.0, speed_spread=5.0, **driver) for i in range(2)
    ]
    road = Road(
        lanes=roads.lanes(["a", "b"]),
        successors=roads.successors(),
        routes=roads.routes([]),
        entries=np.stack([entry(right, 30.0, 30.0), *ahead, *against]),
        obstacles=np.zeros((0, 2)),
        sight=sight(200.0, 20.0, 80.0, 40.0, relative=True),
    )
    defaults = {"duration": 15.0, "target_speeds": (20.0, 25.0, 30.0), "progress_unit": 93.0}
    return Scene("two_way", road, defaults, "highway_env.envs.two_way_env:TwoWayEnv")


_SCENES = {"merge": _merge, "roundabout": _roundabout, "two_way": _two_way}
SCENES = tuple(_SCENES)


def scene_of(name: str) -> Scene:
    """Return a scene by name; refuse an unknown one."""
    one_of("scene", name, SCENES)
    return _SCENES[name]()
