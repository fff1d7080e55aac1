"""Every world by its name: its options, and why one lacks an option that another has."""

from __future__ import annotations

import dataclasses
import difflib
import functools
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from socialiq.foreign import one_line
from socialiq.worlds import (
    IDS,
    OLD_IDS,
    SCENE_IDS,
    SUMO_IDS,
    SUMO_NET,
    crossing5,
    crossing7,
    crosswalk7,
    files,
)
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.kinds import PARTS
from socialiq.worlds.highway.options import RoadOptions
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.shifts import Shift
from socialiq.worlds.highway.world import SENSED
from socialiq.worlds.intersection.generated import ROAD, GeneratedOptions
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.road_users import ROAD_USERS

GRIDS: dict[str, Any] = {"crossing5": crossing5, "crossing7": crossing7, "crosswalk7": crosswalk7}
INTERSECTION = "intersection"
ROADS = (INTERSECTION, *SCENES, ROAD)
KNOWN = (*GRIDS, INTERSECTION)
"""Worlds whose rewards, traffic and kinds of episodes audits know."""
NAMES = (*GRIDS, *ROADS)
"""Every world that this package builds without SUMO."""


def _old_names() -> Iterator[tuple[str, str]]:
    """Yield each name of 0.3.0 that spells options, and how it is written now."""
    angles = range(0, 91, 15)
    walked = f"{INTERSECTION},people=0.1"
    steering = f"{INTERSECTION},control=steering"
    yield from ((f"crosswalk7-{angle}", f"crosswalk7,class_angle={angle}") for angle in angles)
    yield from ((f"{name}-caused", f"{name},reward=caused") for name in (INTERSECTION, *SCENES))
    yield "intersection-continuous", f"{INTERSECTION},control=continuous"
    yield "intersection-continuous-steering", steering
    yield "intersection-continuous-steering-offroad", f"{steering},offroad_terminal=true"
    yield "intersection-crosswalk", walked
    yield "intersection-crosswalk-caused", f"{walked},reward=caused"
    for angle in angles:
        yield f"intersection-crosswalk-{angle}", f"{walked},class_angle={angle}"
    yield "intersection-crosswalk-bicycles", f"{walked},cyclists=0.1"


OLD = dict(_old_names())
"""Names of 0.3.0 that spell options. Declarations keep them; commands forward them."""


class Kinds(NamedTuple):
    """Dataclasses of a world's options, and its short words."""

    plain: type[Any]  # of the world without any of the following
    further: tuple[type[Any], ...] = ()  # whose fields change the kind of the world
    short: Mapping[str, str] = {}  # field of each short word

    @property
    def fields(self) -> dict[str, tuple[dataclasses.Field[Any], type[Any]]]:
        """Every option with its dataclass, by name."""
        kinds = (self.plain, *self.further)
        by_name: dict[str, Any] = {}
        for kind in kinds:
            for field in dataclasses.fields(kind):
                by_name.setdefault(field.name, (field, kind))
        return by_name


_RATES = {user.key: user.rate for user in ROAD_USERS}
"""Options of the rates at which people arrive, by their short names."""

FIRST_RATE = ROAD_USERS[0].rate
"""Option of the rate of the class whose people may always arrive."""

_SHORT = {"exit": "destination", **_RATES}
FAULTS = {field.name for field in dataclasses.fields(Shift)} - {"exit"}
WORDS = ("reward", "control", *SENSED)
"""Options of roads that are no field of a dataclass."""


OF_CONSTRUCTOR = ("angle", "back_end", "clock", "render_mode")
"""Keyword arguments of environments, which are no options of their world."""


PLAIN = {INTERSECTION: Options, ROAD: GeneratedOptions}
"""Options of the roads that differ from those of scenes."""


@functools.cache
def kinds_of(name: str) -> Kinds | None:
    """Return the options of a named world; None for a file or an environment."""
    if name in GRIDS:
        walks = {"people": "pedestrian_probability"} if name == "crosswalk7" else {}
        return Kinds(GRIDS[name].Options, (), walks)
    if name in ROADS:
        short = _RATES if name in SCENES else _SHORT
        return Kinds(PLAIN.get(name, RoadOptions), (*PARTS, EffectOptions), short)
    if name in SUMO_IDS or name.endswith(SUMO_NET):
        from socialiq.worlds.sumo.traffic import SumoOptions  # it reads XML

        short = {user.key: f"{user.sumo.name}_rate" for user in ROAD_USERS if user.sumo.name}
        return Kinds(SumoOptions, (), short)
    return None


def base(text: str) -> str:
    """Return the name of a world without its options, the present one where it is old."""
    name = text.partition(",")[0].strip()
    return OLD.get(name, name).partition(",")[0]


def scene_named(text: str) -> str | None:
    """Return the scene of a world or of a Gymnasium id; None if it is another world's."""
    name = base(text)
    return next((scene for scene, identity in SCENE_IDS.items() if name in (scene, identity)), None)


_ROAD_IDS = frozenset((IDS[INTERSECTION], *SCENE_IDS.values(), *OLD_IDS.values()))


def is_road(name: str) -> bool:
    """Whether a name, a Gymnasium id or a file is that of a road of this package or a recording."""
    return name in ROADS or name in _ROAD_IDS or files.is_world_file(name)


def in_sumo(text: str) -> bool:
    """Whether SUMO simulates a world, or that of a Gymnasium id."""
    name = base(text)
    return name in SUMO_IDS or name in SUMO_IDS.values() or name.endswith(SUMO_NET)


OF_PEOPLE = {*_RATES.values()}


_SENSORS = {"shift", "front_end", *FAULTS}
NATURE = (
    (
        tuple(GRIDS),
        _SENSORS,
        "a gridworld has no sensors: its policies observe the state itself",
    ),
    (tuple(GRIDS), {"observation", "see_behind"}, "its policies observe the state of its cells"),
    (tuple(GRIDS), {"actions", "control"}, "its actions are moves between cells, not continuous"),
    (tuple(GRIDS), {"agents", "ends", "frame"}, "its other vehicles are rules, not agents"),
    (tuple(GRIDS), {"reward"}, "its r_social counts what the ego causes already"),
    (("crossing5", "crossing7"), {"people", "class_angle"}, "people walk in crosswalk7"),
    (tuple(GRIDS), {*_RATES} - {"people"}, "a bicycle would move as a vehicle from cell to cell"),
    (tuple(GRIDS), {"exit", "destination"}, "its ego drives straight on"),
    (tuple(GRIDS), {"left_hand"}, "its roads have one lane, on neither side"),
    (SCENES, {"exit", "destination"}, "its ego has one way"),
    (NAMES, {"demand", "net", "start", "end"}, "demand is of SUMO: choose sumo or a network"),
    (SCENES, {"spawn_probability", "initial_vehicle_count"}, "all its vehicles begin with it"),
    (tuple(SUMO_IDS), _SENSORS, "SUMO tells each vehicle's true place"),
    (tuple(SUMO_IDS), {"reward"}, "its r_social is what the ego causes already"),
    (tuple(SUMO_IDS), {"agents", "ends", "frame"}, "SUMO drives all vehicles but one"),
    (tuple(SUMO_IDS), {"actions", "control"}, "its ego keeps to the way of its edges"),
    (tuple(SUMO_IDS), {"exit", "destination"}, "its ways have edges: give start= and end="),
)
"""Reasons, by worlds and keys, why a world lacks what another one has."""


def reason_against(name: str, key: str) -> str:
    """Return why a world lacks a key that another one has; "" if that is not known."""
    table = "sumo" if name.endswith(SUMO_NET) else name
    return next((why for names, keys, why in NATURE if table in names and key in keys), "")


def keys_of(name: str) -> tuple[str, ...]:
    """Return every key of a named world: short words, words of roads, then fields."""
    kinds = kinds_of(name)
    if kinds is None:
        return ()
    words = WORDS if name in ROADS else ()
    return tuple(dict.fromkeys([*kinds.short, *words, *kinds.fields]))


def unknown_option(name: str, key: str) -> str:
    """Return the line that refuses a key of a named world, and names keys that it has.

    Args:
        name: Name of the world.
        key: The key.
    """
    kinds = kinds_of(name)
    assert kinds is not None
    key = one_line(key, 80)
    if why := reason_against(name, key):
        return f"{name} has no {key}: {why}"
    keys = keys_of(name)
    near = difflib.get_close_matches(key, keys, 1)
    known = [field.name for field in dataclasses.fields(kinds.plain)]
    words = [key for key in keys if key in kinds.short or key in WORDS]
    meant = f"did you mean {near[0]}? " if near else ""
    further = "; `socialiq worlds` lists more" if kinds.further else ""
    return (
        f"unknown option of {name} '{key}': {meant}choose one of {', '.join([*known, *words])}"
        f"{further}"
    )
