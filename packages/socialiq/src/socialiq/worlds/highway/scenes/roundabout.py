"""highway-env's roundabout: two lanes round a circle, and four arms."""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.highway.network import (
    APPROACH,
    CONFLICT,
    EXIT,
    Lane,
    Network,
    arc,
    sine,
    straight,
)
from socialiq.worlds.highway.scene import NORMAL, Road, Scene, entry, sight

RADII = 20.0, 24.0  # m
ALPHA = 24  # degrees between the middle of an arm and its way in or out
ACCESS = 170.0  # m from the centre to the end of an arm
BEND = 85.0  # m of a whole swing of an arm
SWING = 5.0  # m
BENT_IN = 0.2 * BEND  # m of the swing on the way in
BENT_OUT = BEND - BENT_IN
DESTINATIONS = ["exr", "sxr", "nxr", "nxs"]  # the last is the ego's
ARRIVAL = 25.0  # m along the exit

_ARCS = (
    ("se", "ex", 90 - ALPHA, ALPHA),
    ("ex", "ee", ALPHA, -ALPHA),
    ("ee", "nx", -ALPHA, -90 + ALPHA),
    ("nx", "ne", -90 + ALPHA, -90 - ALPHA),
    ("ne", "wx", -90 - ALPHA, -180 + ALPHA),
    ("wx", "we", -180 + ALPHA, -180 - ALPHA),
    ("we", "sx", 180 - ALPHA, 90 + ALPHA),
    ("sx", "se", 90 + ALPHA, 90 - ALPHA),
)  # from and to in degrees, clockwise as drawn from east; driven the other way


def network() -> Network:
    """Return circle and arms; of each arm the way in, straight then bent, and the way out."""
    roads = Network()
    for radius in RADII:
        for start, end, first, last in _ARCS:
            phases = float(np.deg2rad(first)), float(np.deg2rad(last))
            roads.add(start, end, Lane(arc((0.0, 0.0), radius, *phases, -1), CONFLICT))
    half, pulsation = BEND / 2, 2 * math.pi / BEND
    shift_in, shift_out = -math.pi / 2, -math.pi / 2 + pulsation * BENT_OUT
    for arm, turned in (("s", _south), ("e", _east), ("n", _north), ("w", _west)):
        lane = straight(turned(2.0, ACCESS), turned(2.0, half))
        roads.add(f"{arm}er", f"{arm}es", Lane(lane, APPROACH))
        ends = turned(2.0 + SWING, half), turned(2.0 + SWING, half - BENT_IN)
        roads.add(f"{arm}es", f"{arm}e", Lane(sine(*ends, SWING, pulsation, shift_in), CONFLICT))
        ends = turned(-2.0 - SWING, -half + BENT_OUT), turned(-2.0 - SWING, half)
        roads.add(f"{arm}x", f"{arm}xs", Lane(sine(*ends, SWING, pulsation, shift_out), EXIT))
        lane = straight(turned(-2.0, half), turned(-2.0, ACCESS))
        roads.add(f"{arm}xs", f"{arm}xr", Lane(lane, EXIT))
    return roads


def _south(x: float, y: float) -> tuple[float, float]:
    return x, y


def _east(x: float, y: float) -> tuple[float, float]:
    return y, -x


def _north(x: float, y: float) -> tuple[float, float]:
    return -x, -y


def _west(x: float, y: float) -> tuple[float, float]:
    return -y, x


def scene() -> Scene:
    """Return the scene: three others on the circle, one on the eastern arm; the ego goes north."""
    roads = network()
    circle, southern, eastern = (
        roads.lane(*nodes, 0) for nodes in (("we", "sx"), ("ser", "ses"), ("eer", "ees"))
    )
    random = {
        "along_spread": 2.0, "speed_spread": 2.0, "spread": NORMAL,
        "destination": 0, "destinations": 3, "exponent": True,
    }  # fmt: skip
    entries = [
        entry(southern, 125.0, 8.0, destination=DESTINATIONS.index("nxs")),
        entry(circle + 1, 5.0, 16.0, **random),
        entry(circle, 20.0, 16.0, **random),
        entry(circle, -20.0, 16.0, **random),
        entry(eastern, 50.0, 16.0, **random),
    ]
    road = Road(
        lanes=roads.lanes(["ser", "ses", "se", "ex", "ee", "nx", "nxs", "nxr"]),
        successors=roads.successors(),
        routes=roads.routes(DESTINATIONS),
        entries=np.stack(entries),
        obstacles=np.zeros((0, 2)),
        sight=sight(x=100.0, y=100.0, vx=15.0, vy=15.0, arrival=ARRIVAL, relative=False),
    )
    defaults = {"duration": 11.0, "target_speeds": (0.0, 8.0, 16.0), "progress_unit": 50.0}
    config = {"incoming_vehicle_destination": None}
    return Scene(
        "roundabout", road, defaults, "highway_env.envs.roundabout_env:RoundaboutEnv", config
    )
