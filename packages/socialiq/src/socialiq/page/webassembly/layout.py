"""Layout of the core's memory and its constants, for the page; each of them is written once."""

import base64
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway import options as roads
from socialiq.worlds.highway.core import geometry
from socialiq.worlds.highway.crossings import HALF_WIDTH
from socialiq.worlds.highway.network import LANE_WIDTH
from socialiq.worlds.highway.options import (
    ENV_SIGNALS,
    EPISODE,
    SETTINGS,
    SIGNALS,
    VEHICLE,
    Contact,
    settings_of,
)
from socialiq.worlds.intersection.core.geometry import BESIDE, LANES, MIDDLE
from socialiq.worlds.intersection.options import ACTIONS, CrosswalkOptions, Options, buffers_of
from socialiq.worlds.road_users import INFLUENCE, PERSON, ROAD_USERS

CORE = Path(__file__).with_name("core.wasm")
"""The built core that ships with the package."""

_RECORDS = {
    "vehicle": VEHICLE,
    "person": PERSON,
    "influence": INFLUENCE,
    "episode": EPISODE,
    "settings": SETTINGS,
}
_OF_LANE = ("straight", "length", "x", "y", "along_x", "along_y", "radius", "phase", "sense")
_COMMANDS = ("RESET", "DECIDE", "DECIDE_AND_RESET", "ANNOTATE", "SKIP")


def layout(options: Options) -> dict[str, Any]:
    """Return what a program that loads the core has to know of a scenario, JSON-compatible.

    `records`: size and fields (type, offset) of each kind of record; `arrays`: name, type and shape
    for an episode, in the order of the entry point's arguments; `settings`, as base64; names and
    numbers.
    """
    buffers = buffers_of(options, 1, traced=True)
    arrays = [_array(name, array.dtype, array.shape) for name, array in buffers._asdict().items()]
    for name, kind in ARGUMENTS.items():
        arrays.append(_array(name, kind, (options.agents if name == "actions" else 1,)))
    return {
        "records": {
            name: {
                "size": kind.itemsize,
                "fields": {
                    field: (str(dtype[0].base), dtype[1])
                    for field, dtype in (kind.fields or {}).items()
                },
            }
            for name, kind in _RECORDS.items()
        },
        "arrays": arrays,
        "settings": base64.b64encode(settings_of(options).tobytes()).decode(),
        "commands": {name.lower(): getattr(roads, name) for name in _COMMANDS},
        "endings": {kind.name.lower(): int(kind) for kind in Ending},
        "contacts": {kind.name.lower(): int(kind) for kind in Contact},
        "actions": ACTIONS,
        "signals": SIGNALS,
        "env_signals": len(ENV_SIGNALS),
        "weights": [getattr(options, f"{name}_weight") for name in SIGNALS],
        "frames": options.frames,
        "decisions": options.decisions,
        "decision_seconds": 1 / options.policy_frequency,
        "agents": options.agents,
        "capacity": options.capacity,
        "persons": options.persons,
        "observed": options.observed_rows,
        "people": _people(options) if isinstance(options, CrosswalkOptions) else None,
        "vehicle_length": geometry.VEHICLE_LENGTH,
        "vehicle_width": geometry.VEHICLE_WIDTH,
        "lane_width": LANE_WIDTH,
        "conflict_distance": options.conflict_distance,
        "lanes": [{name: lane[name].item() for name in _OF_LANE} for lane in LANES],
    }


def _people(options: CrosswalkOptions) -> dict[str, Any]:
    """Return the classes of people, and the places where they move, m."""
    return {
        "classes": [user.plural for user in ROAD_USERS],
        "crosswalk": [MIDDLE - HALF_WIDTH, MIDDLE + HALF_WIDTH],
        "bicycles": BESIDE if options.rides else None,
    }


def _array(name: str, kind: np.dtype, shape: tuple[int, ...]) -> dict[str, Any]:
    record = next((key for key, dtype in _RECORDS.items() if dtype == kind), None)
    return {"name": name, "type": record or kind.name, "bytes": kind.itemsize, "shape": shape}


ARGUMENTS = {
    "commands": np.dtype(np.int8),
    "entropy": np.dtype(np.uint64),
    "seeded": np.dtype(np.bool_),
    "actions": np.dtype(np.int64),
    "settings": SETTINGS,
}
"""Name and type of each; there is one record of settings for all. The numbers of rows, of traced
rows, of agents, of an episode's vehicles and people, and of observed rows follow."""
