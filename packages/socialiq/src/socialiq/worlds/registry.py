"""Worlds by name, their options from keyword arguments, and worlds of other distributions.

Another distribution adds its worlds by an entry point of the group `socialiq.worlds`: its name is a
kind of file (`storage.kind_of`), its object a function from such a file's path to a `World`.
"""

import dataclasses
import typing
from collections.abc import Mapping
from functools import cache, lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, TypeVar

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.storage import kind_of
from socialiq.worlds import CONTINUOUS, SUMO_NET, WORLD_FILE, crossing5, crossing7, crosswalk7
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.highway.effects import CAUSED, EffectOptions
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.world import RoadWorld, world_of
from socialiq.worlds.intersection import world as intersection
from socialiq.worlds.intersection.crosswalk import CROSSWALK, CrosswalkOptions
from socialiq.worlds.intersection.options import ContinuousOptions, FleetOptions
from socialiq.worlds.world import World

Kind = TypeVar("Kind")
WORLDS = {
    "crossing5": crossing5,
    "crossing7": crossing7,
    "crosswalk7": crosswalk7,
    "intersection": intersection,
}
_OVER_ROADS = "intersection" + CROSSWALK
WITH_CYCLISTS = _OVER_ROADS + "-bicycles"
WEIGHED = {
    f"{world}-{angle}": {"class_angle": float(angle)}
    for world in ("crosswalk7", _OVER_ROADS)
    for angle in range(0, 91, 15)
} | {WITH_CYCLISTS: {"cyclist_rate": 0.1}}
"""Options that names stand for: a fixed class angle in degrees, or cyclists."""
CROSSWALKS = ("crosswalk7", *(name for name in WEIGHED if name.startswith("crosswalk7")))
"""Gridworlds with pedestrians."""
WALKED = (_OVER_ROADS, _OVER_ROADS + CAUSED, *(name for name in WEIGHED if name not in CROSSWALKS))
"""Intersections with pedestrians."""
GRIDWORLDS = ("crossing5", "crossing7", *CROSSWALKS)
INTERSECTIONS = ("intersection", "intersection" + CAUSED, *CONTINUOUS, *WALKED)
NAMES = (*GRIDWORLDS, *INTERSECTIONS)
"""Every world of `make`."""

SENSED = ("shift", "front_end")
"""Options of `INTERSECTIONS` beside the fields of theirs: arguments of `Intersection.shifted`."""

GROUP = "socialiq.worlds"
_OF_RECORDINGS = "socialiq_recordings.world.gym:load_world"
_FILES = (".safetensors", ".xml", ".csv")


def installed(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, those of a backport of importlib too."""
    entries = entry_points(group=group)
    return {entry.name: EntryPoint(entry.name, entry.value, group) for entry in entries}


@cache
def _loaders() -> dict[str, EntryPoint]:
    """Return what reads a world from a file, by the kind of the file."""
    return {WORLD_FILE: EntryPoint(WORLD_FILE, _OF_RECORDINGS, GROUP)} | installed(GROUP)


def is_world_file(name: str) -> bool:
    """Whether a name is that of a file that holds a world, as `socialiq data world` makes it."""
    return kind_of(Path(name)) in _loaders()


def loaded(entry: EntryPoint, file: str) -> Any:
    """Return the object of an entry point, which reads a file; its distribution may be missing."""
    try:
        return entry.load()
    except ModuleNotFoundError as error:
        missing = entry.module.partition(".")[0].replace("_", "-")
        raise UserError(f"{file} needs {missing}: pip install {missing}") from error


_NO_WORLD = (
    "a recording can't be driven in: its neighbours do not react, so their losses of speed "
    "are fixed whatever the policy does, and the angle would be biased; name a world that "
    "reacts (intersection, or one that `socialiq data world` makes of it)"
)


def refuse_file(name: str) -> None:
    """Refuse a name of a file that holds no world."""
    is_file = name.lower().endswith(_FILES) and not name.endswith(SUMO_NET)
    if is_file and not is_world_file(name):
        raise UserError(_NO_WORLD)


def open_world(name: str, **options: Any) -> World:
    """Return any world: one of `NAMES` or a scene with options, or one from a file, which has none.

    Raises:
        UserError: If the world, an option or a value is unknown, or a file holds no world, is
            damaged, or lacks its distribution.
    """
    loader = _loaders().get(kind_of(Path(name)))
    if loader is None and not name.lower().endswith(_FILES):
        if (scene := name.removesuffix(CAUSED)) not in SCENES:
            return make(name, **options)
        effects, options = _effects_of(name, options)
        return dataclasses.replace(world_of(scene, **options), effects=effects)
    if options:
        raise UserError(
            f"the world of a file takes no options, got {', '.join(options)}: "
            "`socialiq data world` makes another world"
        )
    if loader is None:
        raise UserError(_NO_WORLD)
    return loaded(loader, one_line(name))(name)


def make(name: str, **options: Any) -> GridWorld | intersection.Intersection:
    """Build a world of `NAMES`, with fields of its `Options` as keyword arguments.

    Raises:
        UserError: If the world, an option or an option's value is unknown.
    """
    one_of("world", name, NAMES)
    effects, options = _effects_of(name, options)
    sensed = {} if name in GRIDWORLDS else {key: options.pop(key, "") for key in SENSED}
    for key, value in sensed.items():
        if not isinstance(value, str):
            raise UserError(f"{key} must be text, as latency=1, got {value!r}")
    chosen = parse_options(name, _kind(name), _implied(name) | options)
    if name in GRIDWORLDS:
        return _grid(_plain(name), chosen, repr(chosen))
    return intersection.Intersection(chosen, effects).shifted(*sensed.values())


def _effects_of(
    name: str, options: Mapping[str, Any]
) -> tuple[EffectOptions | None, dict[str, Any]]:
    """Return the effects that a world's name asks for, and the options that are not of them."""
    if not name.endswith(CAUSED):
        return None, dict(options)
    names = {field.name for field in dataclasses.fields(EffectOptions)}
    chosen = {option: value for option, value in options.items() if option in names}
    of_road = {option: value for option, value in options.items() if option not in names}
    return parse_options(name, EffectOptions, chosen), of_road


def _implied(name: str) -> dict[str, Any]:
    """Return the options that a world's name stands for."""
    return CONTINUOUS.get(name, {}) | WEIGHED.get(name, {})


def _plain(name: str) -> str:
    """Return the name of `WORLDS` of a world of discrete actions."""
    return name.rpartition("-")[0] if name in WEIGHED else name.removesuffix(CAUSED)


def _kind(name: str) -> Any:
    """Return the class of a world's options."""
    if name in WALKED:
        return CrosswalkOptions
    return ContinuousOptions if name in CONTINUOUS else WORLDS[_plain(name)].Options


@lru_cache(maxsize=32)
def _grid(name: str, options: Any, _written: str) -> GridWorld:
    """Return one gridworld for equal options, which compiles once; the text tells 1 from 1.0."""
    return WORLDS[name].make(options)


def spelled_out(name: str, options: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return a world's name and options as a declaration has them: class weights are an option."""
    if name not in (*CROSSWALKS, *WALKED):
        return name, dict(options)
    weights = {"class_angle": _kind(name).class_angle}
    return _plain(name), {**weights, **WEIGHED.get(name, {}), **options}


def make_grid(name: str, **options: Any) -> GridWorld:
    """Build a gridworld, a world whose states can be enumerated; refuse others as `make` does."""
    if name in WORLDS and name not in GRIDWORLDS:
        raise UserError(
            f"the states of {name} can't be listed, so nothing about it is exact: "
            f"choose one of {', '.join(GRIDWORLDS)}"
        )
    one_of("world", name, GRIDWORLDS)
    world = make(name, **options)
    assert isinstance(world, GridWorld)
    return world


def make_fleet(name: str = "intersection", agents: int = 2, **options: Any) -> RoadWorld:
    """Build a road on which several vehicles of an episode are controlled.

    The intersection and every scene have `highway.options.AgentOptions` beside their own; those of
    `intersection.options.MULTI_AGENT` make highway-env's multi-agent environments.

    Raises:
        UserError: If the road, an option or a value is unknown, or there are too many agents.
    """
    one_of("road", name, ("intersection", *SCENES))
    options = {"agents": agents} | options
    if name != "intersection":
        return world_of(name, **options)
    return intersection.Intersection(parse_options(name, FleetOptions, options))


def default_options(name: str) -> dict[str, Any]:
    """Return the default of every option of a world of `NAMES` that its name doesn't give."""
    implied = _implied(name)
    kinds = (_kind(name), EffectOptions) if name.endswith(CAUSED) else (_kind(name),)
    fields = {field.name: field.default for kind in kinds for field in dataclasses.fields(kind)}
    fields |= dict.fromkeys(SENSED if name in INTERSECTIONS else (), "")
    return {option: default for option, default in fields.items() if option not in implied}


def continuous_options(name: str) -> ContinuousOptions:
    """Return the options of a world of `worlds.CONTINUOUS`."""
    one_of("world with continuous actions", name, tuple(CONTINUOUS))
    return ContinuousOptions(**CONTINUOUS[name])


def parse_options(world: str, kind: type[Kind], values: Mapping[str, Any]) -> Kind:
    """Return a world's options, of a dataclass, from values by name of the field.

    Raises:
        UserError: If a field is unknown, or a value that its Literal type doesn't list.
    """
    kinds = typing.get_type_hints(kind)
    fields = tuple(field.name for field in dataclasses.fields(kind))  # pyright: ignore[reportArgumentType]
    for option in values:
        one_of(f"option of {world}", option, fields)
    for option, value in values.items():
        allowed = typing.get_args(kinds[option])
        if typing.get_origin(kinds[option]) is typing.Literal and value not in allowed:
            raise UserError(
                f"unknown value '{value}' for {option} of {world}: "
                f"choose one of {', '.join(map(str, allowed))}"
            )
        if isinstance(value, str) and kinds[option] in (bool, float, int):
            raise UserError(
                f"{option} of {world} is a text, '{value}': give a number, true or false"
            )
    return kind(**values)
