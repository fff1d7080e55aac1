"""Grammar of worlds: `NAME or FILE [, key=value ...]`, parsed here for every command and function.

A name is one of `NAMES`, a network of SUMO, a file of `socialiq data world`, a Gymnasium id or
MODULE:ID. Keys are fields of the world's options and the short words of `kinds_of`. Values are
numbers, true, false or text; commas within [...] belong to a value. A word without a value is a
shift by its name, as `intersection,people=0.1,late`.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import tomllib
import typing
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, get_args

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.settings import assignments, parse_options, typed
from socialiq.storage import is_file
from socialiq.worlds import ENVIRONMENT_PATTERN, files
from socialiq.worlds.catalogue import (
    FAULTS,
    FIRST_RATE,
    GRIDS,
    INTERSECTION,
    NAMES,
    OF_CONSTRUCTOR,
    OF_PEOPLE,
    OLD,
    PLAIN,
    WORDS,
    in_sumo,
    is_road,
    kinds_of,
    reason_against,
    unknown_option,
)
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.highway.effects import EffectOptions, check_agents
from socialiq.worlds.highway.kinds import kind_with, parts_of, refuse_incomplete
from socialiq.worlds.highway.options import RoadOptions, Schema
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.highway.shifts import OR, SHIFTS
from socialiq.worlds.highway.world import OF_FILES, RoadWorld, SceneWorld, sensed_of, world_of
from socialiq.worlds.intersection.generated import ROAD, scene_of_layout
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.world import World

_CONTROL = {"discrete": "", "continuous": "continuous", "steering": "continuous_steering"}
"""Values of `control`, and of the field `actions` that they stand for."""

_VALUES = {
    "reward": ("thesis", "caused"),
    "control": tuple(_CONTROL),
    "observation": get_args(Schema),
}
"""Values of words of a road that only have some."""

_USUALLY_EMPTY = ("actions", "reward", "shift", "front_end", "agents", "ends", "frame")


class Written(NamedTuple):
    """World as a text names it."""

    name: str  # of `NAMES` or `SUMO_IDS`, a path, an id, MODULE:ID or MODULE:FUNCTION
    options: dict[str, Any]  # by field, or of `WORDS`; keyword arguments of an environment

    @property
    def in_sumo(self) -> bool:
        """Whether SUMO simulates it."""
        return in_sumo(self.name)

    @property
    def is_built(self) -> bool:
        """Whether this package builds it as a `World`; `build` does."""
        return self.name in NAMES or files.is_world_file(self.name)

    @property
    def control(self) -> str:
        """Value of `actions` of continuous actions, "" for discrete ones."""
        return self.options.get("actions", "")

    @property
    def caused(self) -> bool:
        """Whether r_social is what the ego causes."""
        return self.options.get("reward") == "caused"

    @property
    def walks(self) -> bool:
        """Whether people walk or ride in it."""
        return self.name == "crosswalk7" or not OF_PEOPLE.isdisjoint(self.options)

    def __str__(self) -> str:
        words = [f"{key}={_text(value)}" for key, value in self.options.items()]
        return ",".join([self.name, *words])


def _text(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"[{','.join(map(_text, value))}]"
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return f"[{text}]" if "," in text else text


def parse(text: str, further: Mapping[str, Any] | None = None) -> Written:
    """Return the name and the options of a world.

    Args:
        text: The world: `NAME or FILE [, key=value ...]`, or a name of 0.3.0.
        further: Options by key that are laid over those of the text.

    Raises:
        UserError: If a key or a value is not one of the world's.
    """
    name, words = _split(text)
    if name in OLD:
        name, before = _split(OLD[name])
        words = before + words
    of_text = {key: _Text(value) for key, value in _assigned(name, words)}
    options = _resolved(name, of_text) | _resolved(name, further or {})
    if name in NAMES and options.get("agents") == 1:
        options |= dict.fromkeys(("agents", "ends", "frame"), "")
    usual: dict[str, Any] = dict.fromkeys(_USUALLY_EMPTY, "") | {"left_hand": False}
    left_out = {key for key in usual if name in NAMES and options.get(key) == usual[key]}
    return Written(name, {k: v for k, v in options.items() if k not in left_out})


class _Text(str):
    """Value that a text gives, which gets the type of its field."""

    __slots__ = ()


def set_options(words: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Return the options that `--set KEY=VALUE ...` gives, which `parse` lays over a text's."""
    values = assignments([word for several in words for word in several])
    return {key: _Text(value) for key, value in values.items()}


def _split(text: str) -> tuple[str, list[str]]:
    """Return the name and the words behind it; commas in brackets belong to a word."""
    text = text.strip()
    if "," not in text or is_file(text):
        return text, []
    name, *words = (word.strip() for word in re.split(r",(?![^\[]*\])", text))
    return name, words


def _assigned(name: str, words: list[str]) -> list[tuple[str, str]]:
    """Return keys and values; names of shifts, and words between `OR`, are one value of `shift`."""
    shifts = list[str]()
    values = dict[str, str]()
    kinds = kinds_of(name)
    fields = kinds.fields if kinds else {}
    on_road = is_road(name)
    for word in words:
        key, sign, value = (part.strip() for part in word.partition("="))
        if not word:
            raise UserError(f"{one_line(name)}: a comma has no word behind it: leave it out")
        if key != "shift" and (word in SHIFTS or OR in word):
            if kinds is not None and not on_road:
                raise UserError(
                    f"{name} has no {one_line(word, 80)}: {reason_against(name, 'noise')}"
                )
            shifts.append(word)
            continue
        if not (sign and key and value):
            raise UserError(
                f"'{one_line(word, 80)}' is no KEY=VALUE of {one_line(name, 80)}: write for "
                "instance people=0.1; `socialiq worlds` lists worlds and keys"
            )
        key = key.replace("-", "_")
        if key in values:
            raise UserError(f"{key} is given twice: leave one out")
        values[key] = value[1:-1] if key in ("shift", "front_end") and value[0] == "[" else value
        if on_road and key in FAULTS - fields.keys():
            shifts.append(f"{key}={values.pop(key)}")
    if shifts:
        values["shift"] = ",".join(filter(None, [values.get("shift", ""), *shifts]))
    return list(values.items())


def _resolved(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by field: short words are resolved, text gets the type of its field."""
    kinds = kinds_of(name)
    fields = kinds.fields if kinds else {}
    on_road = is_road(name)
    is_file = kinds is None and files.names_file(name)
    options = dict[str, Any]()
    shifts = list[str]()
    for key, value in values.items():
        field = kinds.short.get(key, key) if kinds else key
        if field in options:
            raise UserError(f"{key} and {field} are one option of {name}: leave one out")
        if on_road and key in FAULTS - fields.keys():
            shifts.append(f"{key}={value}")
        elif kinds and on_road and key == "control" and "actions" not in fields:
            raise UserError(unknown_option(name, key))
        elif on_road and key in (WORDS if kinds else OF_FILES):
            options |= _word(key, value)
        elif is_file and key not in OF_CONSTRUCTOR:
            if key in OF_FILES:
                files.refuse_file(name)
            files.refuse_options([key])
        elif kinds is None or key in OF_CONSTRUCTOR:
            options[key] = _guessed(value) if type(value) is _Text else value
        elif field not in fields:
            raise UserError(unknown_option(name, key))
        else:
            hints = typing.get_type_hints(fields[field][1])
            options[field] = value
            if type(value) is _Text:
                options[field] = typed(_unquoted(value), hints[field], key)
    if shifts:
        options["shift"] = ",".join(filter(None, [options.get("shift", ""), *shifts]))
    return options


def _word(key: str, value: Any) -> dict[str, Any]:
    """Return the options that a word of a road stands for."""
    if not isinstance(value, str):
        raise UserError(f"{key} must be text, as latency=1, got {value!r}")
    value = str(value)
    if key in _VALUES:
        one_of(key, value, _VALUES[key])
    if key == "control":
        return {"actions": _CONTROL[value]}
    if key == "reward":
        value = value.replace("thesis", "")
    return {} if (key, value) == ("observation", "rows") else {key: value}


def _unquoted(text: str) -> str:
    is_quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "\"'"
    return str(text[1:-1] if is_quoted else text)


def _guessed(text: str) -> Any:
    """Return a value for a keyword argument whose type is not known, as TOML writes it."""
    for number in (int, float):
        try:
            return number(text) if text.isascii() and "_" not in text else str(text)
        except ValueError:
            continue
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return str(text)


def build(name: str, options: Mapping[str, Any] | None = None) -> World:
    """Return the world of a text, with further options by key.

    Raises:
        UserError: If the world, a key or a value is unknown, or options don't go together.
    """
    return build_written(parse(name, options))


_TEXTS: dict[str, str] = {}
"""Texts of worlds by their description; equal descriptions are those of identical worlds."""


def build_written(written: Written) -> World:
    """Return the world that is written; see `build`."""
    name, options = written
    if name in GRIDS:
        chosen = parse_options(name, GRIDS[name].Options, options)
        world: World = _grid(name, chosen, repr(chosen))
    elif name in NAMES:
        world = _road(name, options)
    elif files.names_file(name):
        values = dict(options)
        sensed = sensed_of(values)
        schema = values.pop("observation", "rows")
        files.refuse_options(values)
        world = files.load_world(name).showing(schema).shifted(**sensed)
    elif written.in_sumo or re.fullmatch(ENVIRONMENT_PATTERN, name):
        raise UserError(
            f"unknown world '{one_line(name, 80)}': choose one of {', '.join(NAMES)}; "
            "`socialiq.make_environment` makes an environment"
        )
    else:
        one_of("world", name, NAMES)
        raise AssertionError(name)
    _TEXTS[world.description] = str(written)
    return world


def text_of(world: str | World) -> str:
    """Return how a world is written that `build` made; a text is returned as it is.

    Raises:
        UserError: If the world was made in another way.
    """
    if isinstance(world, str):
        return world
    if world.description not in _TEXTS:
        raise UserError(f"no text names this {one_line(world.name)}: make it by socialiq.world")
    return _TEXTS[world.description]


def _road(name: str, options: Mapping[str, Any]) -> RoadWorld:
    """Return the intersection or a scene with options by field."""
    values = dict(options)
    sensed = sensed_of(values)
    measured = {field.name for field in dataclasses.fields(EffectOptions)}
    of_effects = {key: values.pop(key) for key in tuple(values) if key in measured}
    effects = None
    if values.pop("reward", "thesis") == "caused":
        effects = parse_options(name, EffectOptions, of_effects)
    elif of_effects:
        raise UserError(f"{next(iter(of_effects))} is of what an ego causes: add reward=caused")
    kind = kind_with(PLAIN.get(name, RoadOptions), parts_of(values))
    refuse_incomplete(kind, values)
    if issubclass(kind, PeopleOptions):
        values = {FIRST_RATE: 0.0} | values
    if name == INTERSECTION:
        world: RoadWorld = Intersection(parse_options(name, kind, values), effects)
    elif name == ROAD:
        chosen = parse_options(name, kind, values)
        world = SceneWorld(chosen, effects, scene=scene_of_layout(chosen.layout))
    else:
        world = dataclasses.replace(world_of(name, **values), effects=effects)
    if effects is not None:
        check_agents(world.options)
    return world.shifted(**sensed)


@functools.lru_cache(maxsize=32)
def _grid(name: str, options: Any, _written: str) -> GridWorld:
    """Return one gridworld for equal options, which compiles once; the text tells 1 from 1.0."""
    return GRIDS[name].make(options)


def road_of(options: RoadOptions | None = None, effects: EffectOptions | None = None) -> RoadWorld:
    """Return the intersection with options in a dataclass, by default those of the thesis.

    Args:
        options: Options of the intersection, of any of their kinds.
        effects: Options of a reward of what the ego causes; None for Eq 4.2.
    """
    return Intersection(Options() if options is None else options, effects)  # pyright: ignore[reportArgumentType]
